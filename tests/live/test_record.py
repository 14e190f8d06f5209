"""Recordings of a running bench: what `clutch-hil record` writes is what `clutch-hil up` writes, and gaps are told."""

import json
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plant_sim.bench.in_process import Played, play
from plant_sim.live import record, recorder
from plant_sim.live.conversion import convert
from plant_sim.live.recorder import Recorded, Recorder
from plant_sim.live.tune import set_parameters
from plant_sim.node import PlantNode
from plant_sim.profile import load_profile
from protocols import child as children
from protocols.errors import InputError
from protocols.node import Column, node_factory
from protocols.runs import read_run
from protocols.stopping import Stop
from protocols.telemetry.batch import Batch, published_columns
from protocols.telemetry.feed import Feed, NoBenchError, find_bench
from protocols.telemetry.session import consumer_session
from tests.live.running import clutch_hil
from tests.processes import PATIENCE, service

SECONDS = 4.0  # s of the profile
RATE = 500  # Hz: gentle to a machine that runs other tests
EPOCH = 1.7e9  # s: UNIX time of a scripted bench
PIECE = 100  # rows a scripted batch


def result(child: subprocess.Popen) -> dict[str, Any]:
    out, errors = child.communicate(timeout=PATIENCE)
    assert child.returncode == 0, out + errors
    return json.loads(out)


def refusal(*arguments: str) -> str:
    done = subprocess.run(
        children.clutch_hil(*arguments), capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    return done.stderr


def up(bus: str, out: Path, seconds: float = SECONDS) -> Any:
    return service("up", "--bus", bus, "--rate", str(RATE), "--seconds", str(seconds), "--out", str(out), "--json")


def await_file(path: Path) -> None:
    deadline = time.monotonic() + PATIENCE
    while not path.exists():
        assert time.monotonic() < deadline, f"{path} never came"
        time.sleep(0.02)


# --- a scripted bench: batches as a feed would give them


@pytest.fixture(scope="module")
def played() -> Played:
    plant = PlantNode(rate=RATE, profile=load_profile("engagement", SECONDS))
    return play(plant, node_factory("controller")(rate=RATE))


class ScriptedFeed:
    """Gives batches step by step; None of zenoh."""

    bench = "local:script@here"

    def __init__(self, played: Played, steps: list[list[Batch]]) -> None:
        self.lost = {"plant": 0, "controller": 0}
        self.alive = {"plant": True, "controller": True}
        self.steps = steps
        self._columns = {"plant": plant_columns(played), "controller": controller_columns(played)}

    def read(self, timeout: float = 0.0) -> list[Batch]:
        return self.steps.pop(0) if self.steps else []

    def events(self) -> list[dict[str, Any]]:
        return []

    def describe(self, node: str) -> dict[str, Any]:
        return {"columns": [column._asdict() for column in self._columns[node]], "session": 1, "versions": {}}


def plant_columns(played: Played) -> tuple[Column, ...]:
    return (*played.plant_columns, Column("plant_clock_s", "s", "clock"))


def controller_columns(played: Played) -> tuple[Column, ...]:
    return published_columns("controller", (*played.controller_columns, Column("clock_s", "s", "clock")))


def batches(played: Played, node: str, clock: float = 1000.0) -> list[Batch]:
    rows = played.plant if node == "plant" else played.controller
    columns = plant_columns(played) if node == "plant" else controller_columns(played)
    times = clock + np.arange(len(rows)) / RATE
    rows = np.column_stack([rows, times])
    return [
        Batch(node, 1, first, float(RATE), EPOCH, 0, columns, rows[first : first + PIECE])
        for first in range(0, len(rows), PIECE)
    ]


def steps(played: Played) -> list[list[Batch]]:
    return [list(pair) for pair in zip(batches(played, "plant"), batches(played, "controller"), strict=True)]


def recorded(played: Played, script: list[list[Batch]], path: Path, monkeypatch: pytest.MonkeyPatch) -> Recorded:
    monkeypatch.setattr(recorder, "parameters", lambda session, bench, node: [{"name": "a.b", "value": 1.0}])
    return recorded_from(ScriptedFeed(played, script), path)


def recorded_from(feed: Any, path: Path) -> Recorded:
    session: Any = None
    with Recorder(session, feed, path) as made:
        for _ in range(len(feed.steps)):
            made.step()
        made.finish()
    return made.recorded


def test_a_recording_is_the_run(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.parquet"
    told = recorded(played, steps(played), path, monkeypatch)
    run = read_run(path)
    for column in played.plant_columns:
        np.testing.assert_array_equal(run[column.name], played[column.name])
    for column in played.controller_columns:
        np.testing.assert_array_equal(run[f"controller_{column.name}"], played[f"controller_{column.name}"])
        assert run.units[f"controller_{column.name}"] == column.unit
    assert told.files == {path: len(played.plant)}
    assert (told.good, told.verdict) == (True, f"{SECONDS:.1f} s recorded, no row lost")
    assert run.metadata["plant_parameters"] == {"a.b": 1.0}


def test_a_gap_ends_a_file_and_begins_the_next(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = steps(played)
    del script[5][0]  # rows 500 to 599 of the plant never came
    told = recorded(played, script, tmp_path / "run.parquet", monkeypatch)
    first, second = read_run(tmp_path / "run.parquet"), read_run(tmp_path / "run-2.parquet")
    assert list(told.files.values()) == [500, len(played.plant) - 600]
    np.testing.assert_array_equal(first["time_s"], played["time_s"][:500])
    np.testing.assert_array_equal(second["time_s"], played["time_s"][600:])
    for run, rows in ((first, slice(500)), (second, slice(600, None))):
        np.testing.assert_array_equal(
            run["controller_torque_estimate_nm"], played["controller_torque_estimate_nm"][rows]
        )
    assert "in 2 files" in told.verdict


def test_a_controller_whose_rows_come_first_is_joined_too(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller, plant = batches(played, "controller"), batches(played, "plant")
    script = [[batch] for pair in zip(controller, plant, strict=True) for batch in pair]
    recorded(played, [controller[:3], *script[6:7], plant[:3], *script[7:]], tmp_path / "run.parquet", monkeypatch)
    run = read_run(tmp_path / "run.parquet")
    np.testing.assert_array_equal(run["controller_torque_estimate_nm"], played["controller_torque_estimate_nm"])


def test_lost_rows_make_the_verdict_bad() -> None:
    told = Recorded("bench", RATE, {Path("run.parquet"): 1000}, {"plant": 0, "controller": 7})
    assert not told.good
    assert told.verdict == "2.0 s recorded; rows that never came: 7 of the controller"


def test_a_plant_that_begins_anew_is_a_run_of_its_own(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    again = [replace(batch, session=2) for batch in batches(played, "plant", clock=2000.0)]
    controller = [replace(batch, first_row=batch.first_row + 10_000) for batch in batches(played, "controller", 2000.0)]
    script = [*steps(played), *([a, b] for a, b in zip(again, controller, strict=True))]
    told = recorded(played, script, tmp_path / "run.parquet", monkeypatch)
    assert list(told.files.values()) == [len(played.plant)] * 2
    assert told.good
    for path in told.files:
        run = read_run(path)
        np.testing.assert_array_equal(run["time_s"], played["time_s"])
        np.testing.assert_array_equal(run["controller_torque_estimate_nm"], played["controller_torque_estimate_nm"])


def test_a_controller_that_counts_from_another_wrap_is_joined_by_its_clock(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = steps(played)
    for _, controller in script:
        tick = [column.name for column in controller.columns].index("controller_sample_tick")
        controller.rows[:, tick] += 65536  # the plant began anew under it
    recorded(played, script, tmp_path / "run.parquet", monkeypatch)
    run = read_run(tmp_path / "run.parquet")
    np.testing.assert_array_equal(run["controller_sample_tick"], played["controller_sample_tick"])
    np.testing.assert_array_equal(run["controller_torque_estimate_nm"], played["controller_torque_estimate_nm"])


def test_a_controller_that_publishes_later_than_the_plant_is_waited_for(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder, "parameters", lambda session, bench, node: [])
    feed = ScriptedFeed(played, steps(played))
    described, silent = feed.describe, [True] * 3
    feed.describe = lambda node: None if node == "controller" and silent and silent.pop() else described(node)
    told = recorded_from(feed, tmp_path / "run.parquet")
    assert not silent
    assert told.files == {tmp_path / "run.parquet": len(played.plant)}
    run = read_run(tmp_path / "run.parquet")
    np.testing.assert_array_equal(run["controller_torque_estimate_nm"], played["controller_torque_estimate_nm"])


def test_a_bench_of_one_side_is_refused(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder, "parameters", lambda session, bench, node: [])
    monkeypatch.setattr(recorder, "_BOTH", 0.0)
    feed = ScriptedFeed(played, [[batch] for batch in batches(played, "plant")])
    feed.alive["controller"] = False
    with pytest.raises(InputError, match="the controller of bench local:script@here publishes no telemetry"):
        recorded_from(feed, tmp_path / "run.parquet")
    assert list(tmp_path.iterdir()) == []


def test_a_node_that_ends_while_it_is_asked_spoils_nothing(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = [True]

    def parameters(session: Any, bench: str, node: str) -> list[dict[str, Any]]:
        if gone and gone.pop():
            raise InputError(f"the {node} does not answer")
        return []

    monkeypatch.setattr(recorder, "parameters", parameters)
    told = recorded_from(ScriptedFeed(played, steps(played)), tmp_path / "run.parquet")
    assert not gone
    assert told.files == {tmp_path / "run.parquet": len(played.plant)}


def test_a_bench_that_comes_between_two_looks_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    looks = iter([NoBenchError("no bench publishes telemetry"), "local:new@here"])

    def find_bench(session: Any, bus: str | None) -> str:
        look = next(looks)
        if isinstance(look, NoBenchError):
            raise look
        return look

    monkeypatch.setattr(record, "find_bench", find_bench)
    session: Any = None
    assert record._found(session, None, Stop(), patience=PATIENCE) == "local:new@here"


def test_a_saved_view_that_exists_is_told_before_anything_is_recorded(tmp_path: Path) -> None:
    (tmp_path / "run.rrd").touch()
    with Stop() as stop, pytest.raises(InputError, match="exists already"):
        record.record(tmp_path / "run.rrd", None, None, 0.0, stop, lambda text: None)


def test_a_failure_leaves_no_file(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = steps(played)
    script[3][1] = replace(script[3][1], columns=())
    with pytest.raises(ValueError, match="not in list"):
        recorded(played, script, tmp_path / "run.parquet", monkeypatch)
    assert list(tmp_path.iterdir()) == []


def test_a_bench_without_rows_is_told(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="published no rows; nothing was recorded"):
        recorded(played, [[]], tmp_path / "run.parquet", monkeypatch)
    assert list(tmp_path.iterdir()) == []


# --- real processes


def test_record_and_up_write_the_same_values(local_bus: str, tmp_path: Path) -> None:
    path = tmp_path / "wire.mf4"
    with service("record", str(path), "--bus", local_bus, "--json") as recorder, up(local_bus, tmp_path) as bench:
        ours = read_run(Path(result(bench)["run"]))
        told = result(recorder)  # ends by itself: the bench is gone
    run = read_run(path)
    rows = len(ours["time_s"])
    assert told["rows_lost"] == {"plant": 0, "controller": 0}
    assert list(run.columns) == list(ours.columns)
    for name in ours.columns:
        np.testing.assert_array_equal(run[name][:rows], ours[name], err_msg=name)
    assert (run.units, run.meanings) == (ours.units, ours.meanings)
    assert run.metadata["bus"].startswith(ours.metadata["bus"])  # the bench's name tells folders of local buses apart
    for key in ("rig", "sample_rate_hz", "plant_parameters", "controller_parameters"):
        assert run.metadata[key] == ours.metadata[key], key
    assert not list(tmp_path.glob("*.part"))
    assert not list(tmp_path.glob("wire.mf4.*"))


def test_a_late_recorder_has_the_past_and_ctrl_c_keeps_the_file(local_bus: str, tmp_path: Path) -> None:
    path = tmp_path / "late"
    with up(local_bus, tmp_path, 60.0), consumer_session(None) as session:
        bench = awaited_bench(session, local_bus)
        with Feed(session, bench, live=True) as feed:
            deadline = time.monotonic() + PATIENCE
            while not any(batch.node == "plant" and batch.end > 2 * RATE for batch in feed.read(0.1)):
                assert time.monotonic() < deadline
        with service("record", str(path), "--bus", local_bus, "--json") as recorder:
            await_file(tmp_path / "late.parquet.part")
            changed = set_parameters(session, bench, "controller", {"torque.proportional_gain": 0.02})["changed"]
            time.sleep(0.5)  # rows with the change: two looks of the recorder
            recorder.send_signal(signal.SIGINT)
            told = result(recorder)
    run = read_run(tmp_path / "late.parquet")
    assert told["good"]
    assert run["time_s"][0] == 0.0
    assert run["time_s"][-1] > 2.0
    assert [noted | change for noted, change in zip(run.metadata["parameter_changes"], changed, strict=True)] == (
        run.metadata["parameter_changes"]
    )
    assert run.metadata["controller_parameters"]["torque.proportional_gain"] == 0.012


def awaited_bench(session: Any, bus: str) -> str:
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return find_bench(session, bus)
        except InputError:
            assert time.monotonic() < deadline
            time.sleep(0.1)


# --- what is refused


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("run.xlsx",), "cannot be recorded as '.xlsx'; allowed are .asc, .blf, .csv, .log"),
        (("--seconds", "-1"), "--seconds -1 is not possible"),
        (("run.blf", "--router", "tcp/1.2.3.4:7447"), "leave --router away"),
        (("run.blf", "--bus", "can7"), "bus 'can7' does not exist"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(tmp_path: Path, arguments: tuple[str, ...], sentence: str) -> None:
    assert sentence in refusal("record", *arguments)


def test_a_run_is_converted_there_and_back(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, middle, last = (tmp_path / name for name in ("a.parquet", "b.mf4", "c.parquet"))
    recorded(played, steps(played), first, monkeypatch)
    assert convert(first, middle) == convert(middle, last) == len(played.plant)
    wanted, run = read_run(first), read_run(last)
    assert (run.metadata, run.described()) == (wanted.metadata, wanted.described())
    for name in wanted.columns:
        np.testing.assert_array_equal(run[name], wanted[name])


def test_a_run_is_converted_to_rrd(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded(played, steps(played), tmp_path / "a.parquet", monkeypatch)
    convert(tmp_path / "a.parquet", tmp_path / "a.rrd")
    assert (tmp_path / "a.rrd").read_bytes()[:3] == b"RRF"


@pytest.mark.parametrize(
    ("target", "sentence"),
    [
        ("run.xlsx", "allowed are .csv, .mf4, .parquet, .rrd"),
        ("run.parquet", "run.parquet exists already; give another name or remove it"),
        ("other.mf4", "other.mf4 exists already; give another name or remove it"),
        ("none/run.mf4", "none of run.mf4 does not exist"),
    ],
)
def test_a_conversion_that_cannot_be_is_refused(tmp_path: Path, target: str, sentence: str) -> None:
    for name in ("run.parquet", "other.mf4"):
        (tmp_path / name).write_text("before")
    with pytest.raises(InputError, match=sentence.replace(".", r"\.")):
        convert(tmp_path / "run.parquet", tmp_path / target)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        "run.parquet": "before",
        "other.mf4": "before",
    }


@pytest.mark.parametrize("name", ["view.rrd", "frames.log", "bare"])
def test_what_is_no_run_file_is_told_by_its_suffix(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("no Parquet")
    told = rf"{name} has the suffix {Path(name).suffix or '-'}; what can be read ends with \.csv, \.mf4, \.parquet"
    with pytest.raises(InputError, match=told):
        convert(tmp_path / name, tmp_path / "run.parquet")


@pytest.mark.parametrize("name", ["run.parquet", "run.csv", "run.rrd", "run.blf", "run"])
def test_a_file_that_is_there_is_not_recorded_over(tmp_path: Path, name: str) -> None:
    path = (tmp_path / name).with_suffix(Path(name).suffix or ".parquet")
    path.write_text("before")
    done = clutch_hil("record", str(tmp_path / name), "--bus", "local:nobody", "--seconds", "0")
    assert str(done.exception) == f"file {path} exists already; give another name or remove it"
    assert path.read_text() == "before"


def test_rows_of_an_earlier_recording_are_not_recorded_over(tmp_path: Path) -> None:
    (tmp_path / "run.csv.parquet").write_text("before")
    done = clutch_hil("record", str(tmp_path / "run.csv"), "--bus", "local:nobody", "--seconds", "0")
    assert str(done.exception) == f"file {tmp_path / 'run.csv.parquet'} exists already; give another name or remove it"


@pytest.mark.parametrize("name", ["run.parquet", "run.csv", "run.rrd", "run.log"])
def test_a_place_that_is_none_is_told_by_the_name_that_was_given(tmp_path: Path, name: str) -> None:
    done = clutch_hil("record", str(tmp_path / "none" / name), "--bus", "local:nobody", "--seconds", "0")
    assert str(done.exception) == f"folder {tmp_path / 'none'} of {name} does not exist"
    assert not (tmp_path / "none").exists()
    done = clutch_hil("record", f"/proc/{name}", "--bus", "local:nobody", "--seconds", "0")  # nobody makes files there
    assert str(done.exception).startswith(f"file /proc/{name} cannot be written: ")
