"""Recorded runs in the viewer, and as .rrd files."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.simulate import Simulation
from clutch_hil.live.run_replay import export_rrd, run_batches
from clutch_hil.live.viewer.rrd_reader import read_rrd
from clutch_hil.live.viewer.screen import Screen
from protocols.errors import InputError
from protocols.files.run import Run
from protocols.files.runs import read_run
from tests.clutch_hil.live.viewer.viewing import (
    View,
    connect_to_viewer,
    count_colours,
    find_refusal,
    free_port,
    make_shown_condition,
    read_reply,
    wait_until,
)

SECONDS = 3.0  # of a run: the clutch is engaged by then
COLOURS = 200  # in a picture with plots; an empty viewer has less than 60


@pytest.fixture(scope="module")
def run_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated run."""
    settings = RunSettings(
        1000, "engagement", SECONDS, None, None, 1, None, "both", True, tmp_path_factory.mktemp("run")
    )
    Simulation(Scenario.of(settings)).run(lambda done, total: None)
    (file,) = settings.out.glob("*.parquet")
    return file


def test_a_run_becomes_the_rows_of_its_nodes(run_file: Path) -> None:
    run = read_run(run_file)
    names = [column.name for batch in run_batches(run) for column in batch.columns]
    assert sorted(names) == sorted(run.columns)
    for batch in run_batches(run):
        assert batch.rate == pytest.approx(1000.0)
        assert all(column.name.startswith("controller_") == (batch.node == "controller") for column in batch.columns)
        for column in batch.columns:
            assert np.array_equal(batch[column.name], run[column.name], equal_nan=True)


def test_a_measured_run_without_a_controller_has_one_node(run_file: Path) -> None:
    measured = {name: values for name, values in read_run(run_file).columns.items() if "controller" not in name}
    assert {batch.node for batch in run_batches(Run(measured, {}))} == {"plant"}


def test_values_of_an_exported_run_are_those_of_the_run(run_file: Path, tmp_path: Path) -> None:
    run = read_run(run_file)
    export_rrd(run_file, tmp_path / "run.rrd")
    tables = read_rrd(tmp_path / "run.rrd")
    result = {name: table[name] for table in tables.values() for name in table}
    assert set(result) == set(run.columns)
    for name, values in run.columns.items():
        assert np.array_equal(result[name], values, equal_nan=True), name


def test_an_export_that_cannot_begin_leaves_no_file(
    run_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(screen: Screen) -> None:
        raise RuntimeError("no space left on device")

    monkeypatch.setattr(Screen, "open", full)
    with pytest.raises(InputError, match="cannot be written: no space left"):
        export_rrd(run_file, tmp_path / "run.rrd")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.needs("vulkan")
@pytest.mark.parametrize("kind", ["parquet", "rrd"])
def test_a_whole_run_is_shown(kind: str, run_file: Path, tmp_path: Path) -> None:
    file = run_file
    if kind == "rrd":
        file = tmp_path / "run.rrd"
        export_rrd(run_file, file)
    port = free_port()
    with View(file, "--headless", "--port", port) as view:
        client = connect_to_viewer(port)
        state = wait_until(make_shown_condition(client, "rig_time"), "the run in the viewer")
        (recording,) = state.recordings
        ends = {line.name: (line.start, line.end) for line in recording.timelines}
        assert ends["rig_time"] == (0, round((SECONDS - 0.001) * 1e9))
        wait_until(  # its layout may arrive after its rows
            lambda: read_reply(client.get_state).recordings[0].current_timeline == "rig_time", "the run's own timeline"
        )
        assert [view.name for view in read_reply(client.get_state).views if view.reports] == []
        picture = read_reply(client.take_screenshot)
        (tmp_path / "run.png").write_bytes(picture)
        assert count_colours(picture) > COLOURS
        assert view.end() == 0
    assert f"read:    {file}  ({round(SECONDS * 1000)} samples)" in view.output


@pytest.mark.needs("vulkan")
def test_two_runs_stand_side_by_side(run_file: Path, tmp_path: Path) -> None:
    other, both = tmp_path / "other.rrd", tmp_path / "both.rrd"
    export_rrd(run_file, other)
    port = free_port()
    with View(run_file, other, "--headless", "--port", port, "--save", both) as view:
        client = connect_to_viewer(port)
        wait_until(make_shown_condition(client, "rig_time"), "the runs in the viewer")
        (tmp_path / "both.png").write_bytes(read_reply(client.take_screenshot))
        assert view.end() == 0
    assert "verdict: side by side" in view.output
    tables = read_rrd(both)
    assert set(tables) == {"a/plant", "a/controller", "b/plant", "b/controller"}
    for node in ("plant", "controller"):
        assert np.array_equal(tables[f"a/{node}"].rows, tables[f"b/{node}"].rows, equal_nan=True)
    assert "contains two runs side by side" in find_refusal(both, "--headless")


@pytest.mark.parametrize(
    ("runs", "sentence"),
    [
        (["missing.parquet"], "run missing.parquet does not exist"),
        (["notes.txt"], "run notes.txt has the suffix .txt; allowed are .csv, .mf4, .parquet, .rrd"),
        (["a.parquet", "b.parquet", "c.parquet"], "3 runs were given; allowed are one, or two to show side by side"),
        (["a.parquet", "a.parquet"], "run a.parquet was given twice; give two different files"),
        (["broken.parquet"], "run broken.parquet cannot be read"),
        (["broken.rrd"], "file broken.rrd cannot be read"),
    ],
)
def test_runs_that_cannot_be_shown_are_refused(
    runs: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("broken.parquet", "broken.rrd", "notes.txt"):
        Path(name).write_text("no run")
    assert find_refusal(*runs, "--headless").startswith(f"error: {sentence}")
    assert not list(tmp_path.glob("*.part"))
