"""What Python callers pass: a wrong argument is refused in one sentence, and what is allowed is taken."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import clutch_hil as ch
from clutch_hil.identify.controller_values import derive_controller_values
from plant_sim.rigs import wet_clutch
from protocols.node import load_node

SHORT = {"profile": "engagement", "seconds": 1.5}  # s: long enough to engage


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda run: ch.measure_run("run.parquet"), "run is 'run.parquet'; a Run is needed, as of read_run or simulate"),
        (lambda run: ch.draw_run("run.parquet"), "run is 'run.parquet'; a Run is needed"),
        (lambda run: ch.write_run(run.columns, "run.parquet"), "what is to be written to run.parquet is of the type dict"),
        (lambda run: ch.write_run(ch.Run(run.columns, {1: 2}), "run.parquet"), "metadata of run run.parquet have the key 1"),
        (lambda run: ch.read_run(None), "path is None; the path of a file is needed"),
        (lambda run: ch.draw_sweep("sweep.csv", "a", "b"), "the table is of the type str; the result of sweep is needed"),
        (lambda run: ch.draw_sweep(pa.table({"seed": [1]}), 3, "b"), "x is 3; allowed is a list"),
        (lambda run: ch.measure_run(ch.Run(run.columns, {"rig": ["x"]})), r"the metadata of the run have rig = \['x'\]"),
        (lambda run: ch.measure_run(ch.Run(dict.fromkeys(run.columns, np.full(9, np.inf)), {})), "measure [a-z_]* raises"),
        (
            lambda run: ch.draw_run(ch.Run({name: values[:1] for name, values in run.columns.items()}, {})),
            "the run has 1 sample; 2 or more are needed to draw it",
        ),
    ],
)  # fmt: skip
def test_what_is_no_run_or_no_table_is_refused_in_one_sentence(
    call: Any, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ch.InputError, match=sentence):
        call(ch.simulate(**SHORT))
    assert list(tmp_path.iterdir()) == []


def change_columns(run: ch.Run, change: Any) -> ch.Run:
    return ch.Run({name: change(values) for name, values in run.columns.items()}, run.metadata)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda values: values[:, None], "column 'time_s' has 2 dimensions of float64"),
        (lambda values: values.astype(str), "column 'time_s' has 1 dimensions of <U32"),
    ],
)
@pytest.mark.parametrize("use", [ch.measure_run, ch.draw_run, ch.find_discrepancy, ch.identify_clutch])
def test_columns_that_are_no_numbers_are_refused_in_one_sentence(use: Any, change: Any, sentence: str) -> None:
    with pytest.raises(ch.InputError, match=sentence):
        use(change_columns(ch.simulate(**SHORT), change))


def test_columns_may_be_lists_and_whole_numbers() -> None:
    run = ch.simulate(**SHORT)
    lists = change_columns(run, lambda values: values.tolist())
    assert repr(ch.measure_run(lists)) == repr(ch.measure_run(run))
    search = {"effects": ["torque_sensor_offset"], "force": True}
    assert str(ch.find_discrepancy(lists, **search)) == str(ch.find_discrepancy(run, **search))
    counts = np.round(run["clutch_torque_nm"])
    whole = ch.Run(run.columns | {"clutch_torque_nm": counts.astype(int)}, {})
    same = ch.Run(run.columns | {"clutch_torque_nm": counts}, {})
    assert str(ch.find_discrepancy(whole, **search)) == str(ch.find_discrepancy(same, **search))


PROGRESS: dict[str, Any] = {"progress": 5}


@pytest.mark.parametrize(
    "use",
    [
        lambda: ch.identify_clutch(["a.parquet"], **PROGRESS), lambda: ch.find_discrepancy(["a.parquet"], **PROGRESS),
        lambda: ch.identify_friction(["a.csv"], "gms", **PROGRESS), lambda: ch.sweep([{"oil.heat_transfer": 1.0}], **PROGRESS),
    ],
)  # fmt: skip
def test_what_is_no_function_is_refused_in_one_sentence(use: Any) -> None:
    with pytest.raises(ch.InputError, match=r"^progress is 5; allowed is a function$"):
        use()


@pytest.mark.parametrize(
    "use", [ch.find_discrepancy, ch.identify_clutch, lambda runs: ch.identify_friction(runs, "maxwell-slip")]
)
def test_what_is_no_list_of_runs_is_refused_in_one_sentence(use: Any) -> None:
    for wrong in (3, [3], [None]):
        with pytest.raises(ch.InputError, match=r"^runs (is|has) (3|None); allowed"):
            use(wrong)


@pytest.mark.parametrize(
    "metadata",
    [{"injections": [{"row": 3}]}, {"injections": "x"}, {"injections": [{"row": 3}], "sample_rate_hz": 0}],
)
def test_a_run_is_drawn_although_its_metadata_or_a_value_are_of_another_program(metadata: dict[str, Any]) -> None:
    run = ch.simulate(**SHORT)
    columns = run.columns | {"cylinder_pressure_bar": run["cylinder_pressure_bar"] + np.inf}
    ch.draw_run(ch.Run(columns, metadata))


TIME = np.arange(200) / 100.0
SLIDE = ch.Run({"time_s": TIME, "position_m": np.sin(TIME), "force_n": np.sign(np.cos(TIME))}, {})
PROPOSED = {"profile": "crawl", "settings": [60.0, 1000]}


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: ch.reproduce(6.12), "name is 6.12; a name is needed"),
        (lambda: ch.reproduce("fig 2.13", 5), "progress is 5; allowed is a function"),
        (lambda: ch.identify_clutch(SLIDE, rig=5), "rig is 5; a name is needed"),
        (lambda: ch.identify_clutch(SLIDE, force="no"), "force is 'no'; allowed are True and False"),
        (lambda: ch.identify_clutch(SLIDE, hold=["valve.gain"]), "hold is ['valve.gain']; allowed is a mapping"),
        (lambda: ch.identify_clutch(SLIDE, hold={"valve.gain": "2"}), "hold of valve.gain is '2'; a number is needed"),
        (lambda: ch.identify_clutch(SLIDE, bounds={"valve.gain": 2.0}), "bounds of valve.gain is 2.0; a low and a high"),
        (lambda: ch.identify_clutch(SLIDE, bounds={"valve.gain": (1.0, 2.0, 3.0)}), "a low and a high number are needed"),
        (lambda: ch.identify_clutch(SLIDE, bounds={"valve.gain": "23"}), "a low and a high number are needed"),
        (lambda: ch.identify_clutch(SLIDE, ties={"valve.gain": 5}), "ties of valve.gain is 5; a name is needed"),
        (lambda: ch.identify_friction(SLIDE, 3), "law is 3; a name is needed"),
        (lambda: ch.identify_friction(SLIDE, "gms", position=3), "position is 3; a name is needed"),
        (lambda: ch.identify_friction(SLIDE, "gms", map_name=3), "map_name is 3; a name is needed"),
        (lambda: ch.identify_friction(SLIDE, "gms", seed=-1), "seed is -1; allowed are 0 and more, whole numbers"),
        (lambda: ch.identify_friction(SLIDE, "gms", starts=2.5), "number of starts is 2.5; allowed are 1 and more"),
        (lambda: ch.identify_friction(SLIDE, "gms", elements="4"), "number of elements is '4'; allowed are 1 and more"),
        (lambda: ch.identify_friction(SLIDE, "gms", low_pass="5"), "low-pass is '5'; a number is needed"),
        (lambda: ch.identify_friction(SLIDE, "gms", terms=[2]), "terms is 2; a name is needed"),
        (lambda: ch.identify_friction(SLIDE, "gms", terms="drag"), "term 'drag' is unknown"),
        (lambda: ch.read_friction(None), "path is None; the path of a file is needed"),
        (lambda: ch.write_run(SLIDE, 5), "path of a run to be written is 5"),
        (lambda: ch.play_experiment("crawl-45", rate="fast"), "rate is 'fast'; a whole number is needed"),
        (lambda: ch.play_experiment(PROPOSED), "settings of the experiment are [60.0, 1000]"),
    ],
)  # fmt: skip
def test_an_argument_of_another_type_is_one_sentence(call: Callable[[], Any], sentence: str) -> None:
    with pytest.raises(ch.InputError) as error:
        call()
    assert sentence in str(error.value)


def test_numbers_of_numpy_are_numbers_in_what_is_written() -> None:
    """Their text is no TOML, so a controller lost the pressure at which its piston lands."""
    plant = {name: p.value for name, p in wet_clutch.load_nominal().items()}
    controller = load_node("controller")().parameters
    values = derive_controller_values({name: np.float64(value) for name, value in plant.items()}, plant, controller)
    assert values == derive_controller_values(plant, plant, controller)
