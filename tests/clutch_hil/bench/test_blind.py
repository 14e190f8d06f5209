"""Blind recordings: the run tells nothing of the truth, the truth file tells everything, and a change of either is found."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from clutch_hil.bench.in_process import Played, play
from clutch_hil.bench.metadata import make_run_metadata
from clutch_hil.bench.recording import Recording
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.sealed import SEAL, SealedRecording
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.unseal import describe_truth, read_truth
from clutch_hil.command import make_application
from plant_sim.effects.catalogue import load_effects
from plant_sim.node.injection import Injection, switch_on
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.runs import read_run
from protocols.node import load_node

SEED = 471_147_118  # long enough that no checksum holds its digits by chance
INJECTED = "oil.sump_temperature"
FILE = "secret-scenario"  # a name that may tell
METADATA = {
    "settings": {"rate": "1000", "seed": str(SEED), "plant_parameters": f"{FILE}.toml", "mode": "in process"},
    "scenario": FILE,
    "parameter_changes": [{"node": "plant", "name": INJECTED}],
    "timing": {"plant": {"injections": [{"name": INJECTED}]}, "controller": {"rows": 3}},
}


@pytest.fixture(scope="module")
def played() -> tuple[Played, dict]:
    hidden = switch_on("piston_seal_friction")
    parameters = wet_clutch.load_nominal().with_values(hidden)
    injections = (Injection({INJECTED: 83.25}, at=0.5, until=0.8), Injection(switch_on("internal_leakage"), at=0.6))
    plant = PlantNode(1000, parameters, load_profile("engagement", 1.0), SEED, injections=injections, blind=True)
    controller = load_node("controller")()
    run = play(plant, controller)
    scenario = replace(Scenario.of(RunSettings()), plant=parameters)
    values = {"controller": controller.parameters.as_values()}
    metadata = make_run_metadata(scenario, values, plant.injected_changes, "in process")
    return run, metadata | METADATA


def record(path: Path, played: tuple[Played, dict], kind: type[Recording] = SealedRecording) -> Path:
    run, metadata = played
    with kind(path, run.plant_columns, run.controller_columns, 1000) as recording:
        recording.add(run.plant, *run.controllers)
        recording.finish(metadata)
    return path


def read_contents(path: Path) -> tuple[pa.Table, dict]:
    """Table and metadata of a file."""
    metadata = pq.ParquetFile(path).metadata.metadata
    return pq.read_table(path), {key: value for key, value in metadata.items() if not key.startswith(b"ARROW")}


@pytest.fixture
def run(tmp_path: Path, played: tuple[Played, dict]) -> Path:
    return record(tmp_path / "run.parquet", played)


def test_nothing_of_the_truth_is_in_the_run(run: Path) -> None:
    """Neither a column nor a word of the metadata, nor a byte of the file, nor a number of a hidden column."""
    file = pq.ParquetFile(run)
    text = json.dumps({k.decode(): v.decode() for k, v in (file.metadata.metadata or {}).items()})
    shown = read_run(run)
    for secret in (*(f"{name}." for name in load_effects()), "truth_", "injection", "83.25", str(SEED), FILE):
        assert secret not in text
        assert secret.encode() not in run.read_bytes()
    _, whole = read_truth(run)
    hidden = [whole[name] for name in whole.columns if name.startswith("truth_")]
    for name, column in shown.columns.items():
        assert not any(np.array_equal(column, truth) for truth in hidden if np.ptp(truth)), name
    assert shown.metadata["plant_parameters"][INJECTED] == 70.0
    assert set(shown.metadata["plant_parameters"]) == {
        name for name in wet_clutch.load_nominal() if name.partition(".")[0] not in load_effects()
    }


def test_the_run_is_the_same_to_the_byte_whatever_the_truth_is(tmp_path: Path, played: tuple[Played, dict]) -> None:
    """Other numbers in the hidden columns, other effects, injections, seeds: only the truth file's sum differs."""
    data, metadata = played
    other = data.plant.copy()
    other[:, [i for i, column in enumerate(data.plant_columns) if column.name.startswith("truth_")]] *= 1.5
    parameters = {name: value for name, value in metadata["plant_parameters"].items() if "." in name} | {
        f"{name}.{p.name}": p.typical for name, effect in load_effects().items() for p in effect.parameters
    }
    lies = {"effects": [], "injections": [], "scenario": "x", "notes": "y", "plant_parameters": parameters}
    lies |= {"settings": {"rate": "1000", "mode": "in process"}, "parameter_changes": [], "timing": {}}
    files = [
        record(tmp_path / name / "run.parquet", both)
        for name, both in (("a", played), ("b", (replace(data, plant=other), metadata | lies)))
    ]
    sums = [read_run(file).metadata[SEAL]["sha256"] for file in files]
    assert sums[0] != sums[1]
    without = [file.read_bytes().replace(sum.encode(), b"") for file, sum in zip(files, sums, strict=True)]
    assert without[0] == without[1]


def test_the_truth_file_is_the_run_that_is_not_blind(tmp_path: Path, run: Path, played: tuple[Played, dict]) -> None:
    openly = read_run(record(tmp_path / "open.parquet", played, Recording))
    truth, whole = read_truth(run)
    assert truth == tmp_path / "run.truth.parquet"
    assert whole.metadata == openly.metadata
    assert list(whole.columns) == list(openly.columns)
    for name in whole.columns:
        np.testing.assert_array_equal(whole[name], openly[name])
    assert [(i["name"], i["old"], i["new"], i["row"]) for i in whole.metadata["injections"]] == [
        (INJECTED, 70.0, 83.25, 500),
        *((i["name"], i["old"], i["new"], 600) for i in whole.metadata["injections"][1:-1]),
        (INJECTED, 83.25, 70.0, 800),
    ]
    assert whole.metadata["effects"] == ["piston_seal_friction"]


def test_the_truth_is_told_when_it_is_unsealed(run: Path) -> None:
    document, text, verdict, good = describe_truth(run, *read_truth(run))
    assert good
    assert document["settings"]["seed"] == str(SEED)
    assert "piston_seal_friction" in document["effects"]
    assert "internal_leakage" in text
    assert "83.25" in text
    assert "run and truth file are as recorded" in verdict


def test_a_truth_file_goes_to_a_folder_of_choice(tmp_path: Path, played: tuple[Played, dict]) -> None:
    data, metadata = played
    safe = tmp_path / "safe"
    path = tmp_path / "run.parquet"
    with SealedRecording(path, data.plant_columns, data.controller_columns, 1000, safe) as recording:
        recording.add(data.plant, *data.controllers)
        recording.finish(metadata)
    assert [file.name for file in tmp_path.iterdir() if file.is_file()] == ["run.parquet"]
    with pytest.raises(InputError, match=r"truth file .* does not exist; give its folder with --truth"):
        read_truth(path)
    assert read_truth(path, safe)[0] == safe / "run.truth.parquet"


def test_a_changed_truth_file_is_noticed(run: Path) -> None:
    truth = run.with_name("run.truth.parquet")
    content = bytearray(truth.read_bytes())
    content[len(content) // 2] ^= 1
    truth.write_bytes(content)
    with pytest.raises(InputError, match="has been changed since the run was recorded: its SHA-256 differs"):
        read_truth(run)


@pytest.mark.parametrize("column", ["cylinder_pressure_bar", "controller_phase"])
def test_a_changed_run_is_noticed(run: Path, column: str) -> None:
    table, metadata = read_contents(run)
    values = table[column].to_numpy().copy()
    values[-1] = np.nextafter(values[-1], np.inf)
    changed = table.set_column(table.column_names.index(column), table.field(column), [values])
    pq.write_table(changed.replace_schema_metadata(metadata), run)
    with pytest.raises(InputError, match=f"has been changed since it was recorded: the column {column}"):
        read_truth(run)


def test_changed_metadata_are_noticed(run: Path) -> None:
    table, metadata = read_contents(run)
    pq.write_table(table.replace_schema_metadata(metadata | {b"notes": b'"nothing was injected"'}), run)
    with pytest.raises(InputError, match="its metadata entry notes differs from its truth file"):
        read_truth(run)


def test_the_truth_of_another_run_is_noticed(tmp_path: Path, run: Path, played: tuple[Played, dict]) -> None:
    record(tmp_path / "other.parquet", (played[0], played[1] | {"scenario": "other"}))
    shutil.copy(tmp_path / "other.truth.parquet", tmp_path / "run.truth.parquet")
    with pytest.raises(InputError, match="SHA-256 differs"):
        read_truth(run)


def test_a_run_that_is_cut_with_its_seal_kept_is_noticed(run: Path) -> None:
    table, metadata = read_contents(run)
    pq.write_table(table.slice(0, table.num_rows - 1).replace_schema_metadata(metadata), run)
    assert SEAL in read_run(run).metadata
    with pytest.raises(InputError, match="has been changed since it was recorded: the column time_s"):
        read_truth(run)


@pytest.mark.parametrize("metadata", [None, {SEAL: '"run.truth.parquet"'}])
def test_a_missing_seal_is_noticed_where_the_truth_file_is(run: Path, metadata: dict | None) -> None:
    pq.write_table(read_contents(run)[0].replace_schema_metadata(metadata), run)
    done = CliRunner().invoke(make_application(), ["unseal", str(run)])
    assert isinstance(done.exception, InputError)  # exit code 2
    assert "has been changed since it was recorded: its seal is missing, but its truth file" in str(done.exception)
    run.with_name("run.truth.parquet").rename(run.with_name("away"))
    with pytest.raises(InputError, match="is not sealed"):
        read_truth(run)


def test_an_open_run_is_not_unsealed(tmp_path: Path, played: tuple[Played, dict]) -> None:
    with pytest.raises(InputError, match="is not sealed: it was recorded without --blind"):
        read_truth(record(tmp_path / "open.parquet", played, Recording))


def test_a_recording_that_fails_leaves_neither_file(tmp_path: Path, played: tuple[Played, dict]) -> None:
    data, _ = played
    short = replace(data, plant=data.plant[:1], controllers=(data.controllers[0][:1],))
    with pytest.raises(InputError, match="ended after 1 samples"):
        record(tmp_path / "run.parquet", (short, {}))
    assert not list(tmp_path.iterdir())


def test_a_truth_file_does_not_stay_without_its_run(tmp_path: Path, played: tuple[Played, dict]) -> None:
    (tmp_path / "run.parquet").mkdir()  # in the way
    with pytest.raises(InputError, match="cannot be written"):
        record(tmp_path / "run.parquet", played)
    assert [path.name for path in tmp_path.iterdir()] == ["run.parquet"]


def test_a_truth_file_is_never_written_over(tmp_path: Path, played: tuple[Played, dict]) -> None:
    (tmp_path / "run.truth.parquet").touch()
    with pytest.raises(InputError, match="exists already"):
        record(tmp_path / "run.parquet", played)


# ---- a blind plant ----


def make_blind_plant() -> PlantNode:
    return PlantNode(parameters=wet_clutch.load_nominal().with_values(switch_on("internal_leakage")), blind=True)


def test_a_blind_plant_runs_as_another_and_does_not_say_what_it_is() -> None:
    injections = (Injection({INJECTED: 80.0} | switch_on("friction_level"), at=0.01),)
    nodes = [PlantNode(injections=injections, blind=hidden) for hidden in (False, True)]
    for _ in range(20):
        for node in nodes:
            node.step([])
    assert nodes[0].make_row() == nodes[1].make_row()
    assert nodes[1].parameters[INJECTED].value == 70.0
    assert "friction_level.level" not in nodes[1].parameters


def test_a_blind_plant_takes_an_injection_and_does_not_tell_what_was_before() -> None:
    (change,) = make_blind_plant().accept({INJECTED: 80.0}, {"for": 1.0})
    assert change == {"name": INJECTED, "unit": "degC", "old": None, "new": 80.0, "at": 0.0, "ramp": 0.0, "row": 0}


def test_a_blind_plant_does_not_tell_what_else_is_to_come() -> None:
    node = PlantNode(injections=[Injection({INJECTED: 90.0}, at=2.0)], blind=True)
    accepted = node.accept({INJECTED: 80.0}, {"at": 1.0})
    assert [(change["at"], change["new"]) for change in accepted] == [(1.0, 80.0)]


def test_a_blind_plant_tells_what_any_plant_would_refuse_and_hides_why_only_it_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from tests.plant_sim.test_injection import _refuse_exclusive

    with pytest.raises(InputError, match="did you mean friction_level"):
        make_blind_plant().accept({"friction_levle.level": 0.5}, {})
    with pytest.raises(InputError, match="is outside"):
        make_blind_plant().accept({"friction_level.level": 50.0}, {})
    monkeypatch.setattr("plant_sim.effects.table._check_exclusions", _refuse_exclusive)
    with pytest.raises(InputError, match="a blind plant does not give the reason"):
        make_blind_plant().accept({"friction_level.level": 0.5}, {})


def test_a_blind_plant_is_tuned_in_what_it_tells_alone() -> None:
    node = make_blind_plant()
    node.tune({INJECTED: 80.0})
    assert node.parameters[INJECTED].value == 80.0
    with pytest.raises(InputError, match=r"'internal_leakage\.conductance' is unknown"):
        node.tune({"internal_leakage.conductance": 0.0})
