"""The bench from Python: runs in memory are those of the command, sweeps the same wherever they are computed."""

import csv
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from typer.testing import CliRunner

import clutch_hil as ch
from clutch_hil.bench.sweeps import executors
from clutch_hil.bench.sweeps.executors import compute
from clutch_hil.command import make_application
from tests.processes import PATIENCE

SHORT = {"profile": "engagement", "seconds": 1.5}  # s: long enough to engage


@contextmanager
def dask_cluster(workers: int) -> Iterator[Any]:
    """A cluster of one process a worker; at its end every killed worker is there again.

    Dask starts a killed worker anew, and a cluster that closes meanwhile raises "can only join a started process".
    """
    from distributed import Client, LocalCluster

    with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster
        with Client(cluster) as client:
            client.wait_for_workers(workers, timeout=PATIENCE)


def test_every_public_name_is_there() -> None:
    assert all(getattr(ch, name) is not None for name in ch.__all__)
    assert dir(ch) == sorted(ch.__all__)
    assert len(dir(ch)) <= 25
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = ch.simulat


def test_importing_it_loads_nothing_heavy() -> None:
    code = "import sys, clutch_hil; print([n for n in ('scipy.stats', 'matplotlib', 'pyarrow', 'rerun') if n in sys.modules])"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
    )


def test_a_run_in_memory_is_that_of_the_command(tmp_path: Path) -> None:
    run = ch.simulate(**SHORT, seed=3, plant={"friction_level.level": 0.9}, effects=["internal_leakage"])
    leak = run.metadata["plant_parameters"]["internal_leakage.conductance"]
    (tmp_path / "rig.toml").write_text(f"[friction_level]\nlevel = 0.9\n[internal_leakage]\nconductance = {leak}\n")
    done = CliRunner().invoke(
        make_application(),
        ["simulate", "--profile", "engagement", "--seconds", "1.5", "--seed", "3", "--out", str(tmp_path / "runs"),
         "--plant-parameters", str(tmp_path / "rig.toml")],
    )  # fmt: skip
    assert done.exit_code in (0, 1), done.output
    (file,) = (tmp_path / "runs").glob("*.parquet")
    written = ch.read_run(file)
    assert list(written.columns) == list(run.columns)
    for name, column in run.columns.items():
        np.testing.assert_array_equal(written[name], column, err_msg=name)
    assert (written.units, written.meanings) == (run.units, run.meanings)
    assert written.metadata["plant_parameters"] == run.metadata["plant_parameters"]
    assert written.metadata["effects"] == run.metadata["effects"] == ["friction_level", "internal_leakage"]


def test_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    ch.simulate(**SHORT)
    assert list(tmp_path.iterdir()) == []


def test_a_run_is_written_and_read_again(tmp_path: Path) -> None:
    run = ch.simulate(**SHORT)
    ch.write_run(run, tmp_path / "run.parquet")
    again = ch.read_run(tmp_path / "run.parquet")
    np.testing.assert_array_equal(again["clutch_torque_nm"], run["clutch_torque_nm"])
    assert ch.measure_run(again).keys() == ch.measure_run(run).keys()


def test_parameters_of_the_controller_are_changed() -> None:
    runs = [ch.simulate(**SHORT, controller={"torque.integral_gain": gain}) for gain in (0.05, 0.4)]
    assert [run.metadata["controller_parameters"]["torque.integral_gain"] for run in runs] == [0.05, 0.4]
    assert not np.array_equal(runs[0]["valve_voltage_v"], runs[1]["valve_voltage_v"])


def test_a_scenario_is_simulated_with_its_own_settings() -> None:
    run = ch.simulate("creep", seconds=1.0)
    assert run.metadata["scenario"] == "creep"
    assert len(run["time_s"]) == run.metadata["sample_rate_hz"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"profile": "engagment"}, "profile 'engagment' does not exist"),
        ({"scenario": "no_such"}, "scenario 'no_such' is unknown"),
        ({"plant": {"clutch.colour": 1.0}}, "clutch.colour"),
        ({"plant": {"friction_level.level": 99.0}}, "friction_level.level"),
        ({"plant": {"friction_level.level": float("nan")}}, "friction_level.level"),
        ({"controller": {"torque.no_such": 1.0}}, "torque.no_such"),
        ({"effects": ["warp_drive"]}, "effect 'warp_drive' is unknown"),
        ({"effects": {"internal_leakage": {"size": 1.0}}}, "effect internal_leakage has no parameter 'size'"),
        ({"effects": ""}, "effect '' is unknown"),
        ({"rate": 0}, "rate"),
        ({"seed": -1}, "seed is -1; allowed are 0 and more, whole numbers"),
        ({"seed": 1.5}, "seed is 1.5"),
        ({"law": "both of them"}, "control law 'both of them' is unknown"),
        ({"temperature": float("nan")}, "oil temperature nan degC"),
        ({"seconds": -1.0}, "-1"),
        ({"scenario": "shift", "effects": ["friction_level"]}, "friction_level.level"),  # of which clutch?
    ],
)
def test_what_cannot_be_simulated_is_said_in_one_sentence(arguments: dict, sentence: str) -> None:
    with pytest.raises(ch.InputError) as error:
        ch.simulate(**arguments)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_a_grid_has_every_combination() -> None:
    assert ch.grid({"a": [1, 2], "b": [3.0, 4.0]}) == [
        {"a": 1.0, "b": 3.0}, {"a": 1.0, "b": 4.0}, {"a": 2.0, "b": 3.0}, {"a": 2.0, "b": 4.0},
    ]  # fmt: skip


def test_random_points_are_in_their_ranges_and_a_hypercube_is_even() -> None:
    ranges = {"a": (0.0, 1.0), "b": (-5.0, 5.0)}
    for points in (ch.random(ranges, 50, seed=2), ch.latin_hypercube(ranges, 50, seed=2)):
        assert all(low <= point[name] <= high for point in points for name, (low, high) in ranges.items())
    strata = sorted(int((point["b"] + 5.0) / 10.0 * 50) for point in ch.latin_hypercube(ranges, 50, seed=2))
    assert strata == list(range(50))
    assert ch.random(ranges, 5, seed=2) == ch.random(ranges, 5, seed=2) != ch.random(ranges, 5, seed=3)


@pytest.mark.parametrize(
    "samples",
    [
        lambda: ch.grid({"a": []}),
        lambda: ch.grid({str(i): range(100) for i in range(20)}),
        lambda: ch.random({}, 3),
        lambda: ch.random({"a": (0.0, 1.0)}, 0),
        lambda: ch.random({"a": (2.0, 1.0)}, 3),
        lambda: ch.latin_hypercube({"a": (0.0, float("inf"))}, 3),
        lambda: ch.latin_hypercube({"a": (0.0, 1.0)}, 10**12),
    ],
)
def test_samples_that_cannot_be_are_refused(samples) -> None:
    with pytest.raises(ch.InputError):
        samples()


def test_a_result_of_the_thesis_is_checked_without_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = ch.reproduce("fig 2.13")
    assert result.entry.name == "figure-2.13"
    assert result.holds
    assert result.picture is None
    assert str(result).endswith(result.verdict)
    assert result.sheet.figure.axes
    assert list(tmp_path.iterdir()) == []


def test_every_friction_model_is_played_by_one_function() -> None:
    curve = ch.friction.Stribeck(static_force=10.0)  # N, at every speed
    springs = {"stiffness": [2e5, 1e5], "weights": [0.5, 0.5]}  # N/m
    models = [
        ch.friction.Coulomb(curve),
        ch.friction.Dahl(coulomb_force=10.0, stiffness=1e6),
        ch.friction.LuGre(curve, stiffness=1e6),
        ch.friction.ElastoPlastic(curve, stiffness=1e6),
        ch.friction.Leuven(curve, stiffness=[2e5, 1e5], limits=[5.0, 5.0]),
        ch.friction.MaxwellSlip(stiffness=[2e5, 1e5], limits=[5.0, 5.0]),
        ch.friction.GMS(curve, **springs),
        ch.friction.XGMS(ch.friction.Amontons(0.1), **springs, attraction=100.0),
    ]
    position = np.linspace(0.0, 1e-2, 2001)  # m: far beyond the springs' 50 um
    for model in models:
        trace = ch.friction.simulate(model, position, dt=1e-3, load=100.0)
        assert trace.force.shape == position.shape
        assert trace.force[-1] == pytest.approx(10.0, rel=1e-3), model
        np.testing.assert_array_equal(trace.force, model.trace(position, 1e-3, 100.0).force)


SAMPLES = ch.grid({"friction_level.level": [0.8, 1.2], "controller.torque.integral_gain": [0.05, 0.4]})
KEPT = ("regime_error_nm", "rise_time_s", "fault", "peak_torque_nm")


@pytest.fixture(scope="module")
def table() -> pa.Table:
    return ch.sweep(SAMPLES, **SHORT, seeds=(1, 2), measures=KEPT[:3], workers=1)


def test_a_sweep_has_a_row_a_run_in_order(table: pa.Table) -> None:
    assert table.column_names == ["friction_level.level", "controller.torque.integral_gain", "seed", *KEPT[:3]]
    rows = table.to_pylist()
    expected = [
        (s["friction_level.level"], s["controller.torque.integral_gain"], seed) for s in SAMPLES for seed in (1, 2)
    ]
    assert [tuple(row.values())[:3] for row in rows] == expected
    one = ch.measure_run(
        ch.simulate(**SHORT, seed=2, plant={"friction_level.level": 1.2}, controller={"torque.integral_gain": 0.4})
    )
    np.testing.assert_equal({name: rows[-1][name] for name in KEPT[:3]}, {name: one[name] for name in KEPT[:3]})


def test_two_processes_compute_the_same_table(table: pa.Table) -> None:
    message: list[tuple[int, int]] = []
    again = ch.sweep(
        SAMPLES,
        **SHORT,
        seeds=(1, 2),
        measures=KEPT[:3],
        workers=2,
        progress=lambda done, of: message.append((done, of)),
    )
    assert again.equals(table) or again.to_pandas().equals(table.to_pandas())  # not-a-number equals itself there
    assert message == [(k, 8) for k in range(1, 9)]


def test_effects_of_a_sweep_are_on_in_every_run() -> None:
    """Also where they come from a generator, and one is named alone."""
    samples = ch.grid({"friction_level.level": [0.8, 1.2]})
    several = ch.sweep(samples, **SHORT, effects=(name for name in ["internal_leakage"]), workers=1)
    assert several.equals(ch.sweep(samples, **SHORT, effects="internal_leakage", workers=1))
    assert not several.equals(ch.sweep(samples, **SHORT, workers=1))


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


@pytest.mark.needs("distributed")
@pytest.mark.parametrize("workers", [1, 2, 4])
def test_a_dask_cluster_computes_the_same_table(table: pa.Table, workers: int) -> None:
    with dask_cluster(workers) as cluster:
        again = ch.sweep(SAMPLES, **SHORT, seeds=(1, 2), measures=KEPT[:3], address=cluster.scheduler_address)
    assert again.to_pandas().equals(table.to_pandas())


@pytest.mark.needs("distributed")
def test_cases_of_a_killed_dask_worker_are_done_again(table: pa.Table) -> None:
    with dask_cluster(2) as cluster:
        killed: list[int] = []

        def kill(done: int, of: int) -> None:
            if not killed:
                killed.append(next(iter(cluster.workers.values())).process.pid)
                os.kill(killed[0], signal.SIGKILL)

        again = ch.sweep(
            SAMPLES, **SHORT, seeds=(1, 2), measures=KEPT[:3], address=cluster.scheduler_address, progress=kill
        )
    assert killed
    assert again.to_pandas().equals(table.to_pandas())


@pytest.mark.needs("distributed")
def test_a_case_that_kills_every_dask_worker_is_named() -> None:
    with dask_cluster(1) as cluster:
        address = cluster.scheduler_address
        with pytest.raises(ch.InputError, match=f"case 7 killed every worker that computed it at {address}"):
            list(compute(os._exit, [7], address=address))


@pytest.mark.needs("distributed")
def test_a_cluster_that_ends_meanwhile_is_told() -> None:
    from distributed import LocalCluster

    cluster = LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None)
    results = compute(time.sleep, [0.1, 60.0], address=cluster.scheduler_address)
    next(results)
    cluster.close()
    with pytest.raises(ch.InputError, match="is gone; 1 of 2 cases are not computed"):
        next(results)


@pytest.mark.needs("distributed")
def test_a_cluster_begins_no_further_case_when_a_sweep_is_broken_off() -> None:
    with dask_cluster(1) as cluster:
        results = compute(time.sleep, [0.1, *[10.0] * 50], address=cluster.scheduler_address)
        next(results)
        began = time.monotonic()
        results.close()
        assert time.monotonic() - began < PATIENCE  # of 500 s


def test_processes_end_at_once_when_a_sweep_is_broken_off() -> None:
    results = compute(time.sleep, [0.1, 600.0, 600.0], workers=2)
    next(results)
    results.close()
    assert not multiprocessing.active_children()


def test_the_command_sweeps_as_python_does(tmp_path: Path) -> None:
    arguments = [
        "--profile",
        "engagement",
        "--seconds",
        "1.5",
        "--vary",
        "friction_level.level=0.8:1.2:2",
        "--seeds",
        "2",
    ]
    done = CliRunner().invoke(
        make_application(), ["simulate", *arguments, "--workers", "2", "--out", str(tmp_path), "--json"]
    )
    assert done.exit_code == 0, done.output
    samples = ch.grid({"friction_level.level": [0.8, 1.2]})
    table = ch.sweep(samples, **SHORT, seeds=(1, 2), measures=KEPT[:2], workers=1)
    runs = [list(row.values()) for row in table.to_pylist()]
    assert json.loads(done.stdout)["runs"] == runs
    (file,) = tmp_path.glob("*-sweep.csv")
    header, *rows = csv.reader(file.read_text().splitlines())
    assert header == table.column_names
    assert [list(map(float, row)) for row in rows] == runs


def _slow_square(value: float) -> float:
    time.sleep(0.3)
    return value * value


def test_cases_of_a_killed_process_are_done_again() -> None:
    results = compute(_slow_square, range(8), workers=2)
    outcome = dict([next(results)])
    children = Path(f"/proc/self/task/{threading.get_native_id()}/children").read_text().split()
    workers = [pid for pid in map(int, children) if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
    os.kill(workers[0], signal.SIGKILL)
    outcome |= dict(results)
    assert outcome == {k: k * k for k in range(8)}


def _die(value: float) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_cases_that_kill_every_worker_are_given_up() -> None:
    with pytest.raises(ch.InputError, match="workers died 3 times; 2 of 2 cases are not computed"):
        list(compute(_die, range(2), workers=1))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"samples": []}, "no samples"),
        ({"samples": SAMPLES, "seeds": []}, "no seeds"),
        ({"samples": SAMPLES, "seeds": [1, -1]}, "seed is -1"),
        ({"samples": [{"friction_level.level": 0.9}], "scenario": "shift"}, "friction_level.level"),  # of which clutch?
        ({"samples": SAMPLES, "profile": "no_such"}, "profile 'no_such' does not exist"),
        ({"samples": SAMPLES, "seconds": float("nan")}, "a run of nan s is not possible"),
        ({"samples": [{"a": 1.0}, {"b": 1.0}]}, "all samples need the same"),
        ({"samples": [{"friction_level.level": 99.0}]}, "friction_level.level"),
        ({"samples": [{"controller.no.such": 1.0}]}, "no.such"),
        ({"samples": SAMPLES, "measures": ["beauty"]}, "measure 'beauty' is unknown"),
        ({"samples": SAMPLES, "workers": 0}, "0 workers are not possible"),
        ({"samples": SAMPLES, "seeds": range(10**6)}, "runs are not possible; allowed are 1 to 1000000"),
        (
            {"samples": SAMPLES, "workers": 2, "address": "tcp://127.0.0.1:1"},
            "workers = 2 and a cluster at",
        ),
    ],
)
def test_a_sweep_that_cannot_be_is_refused_before_anything_is_computed(
    arguments: dict, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executors, "ProcessPoolExecutor", lambda *_, **__: pytest.fail("something is computed"))
    with pytest.raises(ch.InputError, match=sentence):
        ch.sweep(**arguments)


def test_a_broken_pool_is_what_the_library_says_of_a_dead_worker() -> None:
    assert issubclass(BrokenProcessPool, executors.BrokenExecutor)


@pytest.mark.parametrize("place", ["protocols/__init__.py", "plant_sim.py"])
def test_a_module_beside_a_script_that_hides_a_package_of_the_bench_is_named(tmp_path: Path, place: str) -> None:
    script, hiding = tmp_path / "script.py", tmp_path / place
    script.write_text("import clutch_hil\n", encoding="utf-8")
    hiding.parent.mkdir(exist_ok=True)
    hiding.touch()
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=PATIENCE, check=False)
    name = Path(place).parts[0].removesuffix(".py")
    assert f"ImportError: clutch_hil needs the package {name} next to it in " in done.stderr
    assert f"Python finds {hiding.resolve()}: rename that" in done.stderr
