"""The recorder: rows of a bench become run files without a gap, and what is missing is told."""

from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clutch_hil.bench.in_process import Played
from clutch_hil.live.recording import recorder
from clutch_hil.live.recording.recorder import RecordingResult
from protocols.errors import InputError
from protocols.files.runs import read_run
from tests.clutch_hil.live.scripted_bench import (
    EPOCH,
    RATE,
    SECONDS,
    ScriptedFeed,
    make_batches,
    record_feed,
    record_script,
    split_steps,
)


def test_a_recording_is_the_run(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.parquet"
    sentence = record_script(played, split_steps(played), path, monkeypatch)
    run = read_run(path)
    for column in played.plant_columns:
        np.testing.assert_array_equal(run[column.name], played[column.name])
    for column in played.controller_columns[0]:
        np.testing.assert_array_equal(run[f"controller_{column.name}"], played[f"controller_{column.name}"])
        assert run.units[f"controller_{column.name}"] == column.unit
    assert sentence.files == {path: len(played.plant)}
    assert (sentence.good, sentence.verdict) == (True, f"{SECONDS:.1f} s recorded, no row lost")
    assert run.metadata["plant_parameters"] == {"a.b": 1.0}


def test_a_gap_ends_a_file_and_begins_the_next(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = split_steps(played)
    del script[5][0]  # rows 500 to 599 of the plant never came
    sentence = record_script(played, script, tmp_path / "run.parquet", monkeypatch)
    first, second = read_run(tmp_path / "run.parquet"), read_run(tmp_path / "run-2.parquet")
    assert list(sentence.files.values()) == [500, len(played.plant) - 600]
    np.testing.assert_array_equal(first["time_s"], played["time_s"][:500])
    np.testing.assert_array_equal(second["time_s"], played["time_s"][600:])
    for run, rows in ((first, slice(500)), (second, slice(600, None))):
        np.testing.assert_array_equal(
            run["controller_torque_estimate_nm"], played["controller_torque_estimate_nm"][rows]
        )
    assert "in 2 files" in sentence.verdict


def test_a_controller_whose_rows_come_first_is_joined_too(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller, plant = make_batches(played, "controller"), make_batches(played, "plant")
    script = [[batch] for pair in zip(controller, plant, strict=True) for batch in pair]
    record_script(played, [controller[:3], *script[6:7], plant[:3], *script[7:]], tmp_path / "run.parquet", monkeypatch)
    run = read_run(tmp_path / "run.parquet")
    np.testing.assert_array_equal(run["controller_torque_estimate_nm"], played["controller_torque_estimate_nm"])


def test_lost_rows_make_the_verdict_bad() -> None:
    sentence = RecordingResult("bench", RATE, {Path("run.parquet"): 1000}, {"plant": 0, "controller": 7})
    assert not sentence.good
    assert sentence.verdict == "2.0 s recorded; rows that did not arrive: 7 of the controller"


def test_a_plant_that_begins_anew_is_a_run_of_its_own(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    again = [replace(batch, session=2) for batch in make_batches(played, "plant", clock=2000.0)]
    controller = [
        replace(batch, first_row=batch.first_row + 10_000) for batch in make_batches(played, "controller", 2000.0)
    ]
    script = [*split_steps(played), *([a, b] for a, b in zip(again, controller, strict=True))]
    sentence = record_script(played, script, tmp_path / "run.parquet", monkeypatch)
    assert list(sentence.files.values()) == [len(played.plant)] * 2
    assert sentence.good
    for path in sentence.files:
        run = read_run(path)
        np.testing.assert_array_equal(run["time_s"], played["time_s"])
        np.testing.assert_array_equal(run["controller_torque_estimate_nm"], played["controller_torque_estimate_nm"])


def test_a_controller_that_counts_from_another_wrap_is_joined_by_its_clock(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = split_steps(played)
    for _, controller in script:
        tick = [column.name for column in controller.columns].index("controller_sample_tick")
        controller.rows[:, tick] += 65536  # the plant began anew under it
    record_script(played, script, tmp_path / "run.parquet", monkeypatch)
    run = read_run(tmp_path / "run.parquet")
    np.testing.assert_array_equal(run["controller_sample_tick"], played["controller_sample_tick"])
    np.testing.assert_array_equal(run["controller_torque_estimate_nm"], played["controller_torque_estimate_nm"])


def test_the_parameters_at_the_beginning_do_not_depend_on_the_time_of_day() -> None:
    """A bench PC without a battery starts in 1970, until a time server sets its clock: here after the first change."""
    times = {10.0: 30.0, 40.0: 1.7e9, 60.0: 1.7e9 + 20.0}
    changes = [
        {"node": "controller", "name": "a.b", "old": float(k), "new": k + 1.0, "time": day, "clock_s": clock}
        for k, (clock, day) in enumerate(times.items())
    ]
    others = [changes[0] | {"node": "plant", "old": 7.0}, {"node": "controller", "name": "a.b", "old": 8.0, "new": 9.0}]
    for asked in (5.0, 50.0, 70.0):
        known = {"a.b": float(sum(clock < asked for clock in times)), "c.d": 4.0}
        node = recorder._NodeDescription("controller", {}, known, asked)
        for clock, value in ((5.0, 0.0), (20.0, 1.0), (45.0, 2.0), (65.0, 3.0)):
            assert node.list_parameters_at(clock, [*changes, *others]) == {"a.b": value, "c.d": 4.0}


def test_a_run_is_dated_by_the_present_time_of_day(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder, "request_parameters", lambda session, bench, node: [])
    feed = ScriptedFeed(played, split_steps(played))
    described = feed.describe
    feed.describe = lambda node: described(node) | {"epoch_s": EPOCH + 3600.0}
    record_feed(feed, tmp_path / "run.parquet")
    recorded = datetime.fromisoformat(read_run(tmp_path / "run.parquet").metadata["recorded_at"])
    assert recorded.timestamp() == EPOCH + 3600.0 + 1000.0


def test_a_controller_that_publishes_later_than_the_plant_is_waited_for(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder, "request_parameters", lambda session, bench, node: [])
    feed = ScriptedFeed(played, split_steps(played))
    described, silent = feed.describe, [True] * 3
    feed.describe = lambda node: None if node == "controller" and silent and silent.pop() else described(node)
    sentence = record_feed(feed, tmp_path / "run.parquet")
    assert not silent
    assert sentence.files == {tmp_path / "run.parquet": len(played.plant)}
    run = read_run(tmp_path / "run.parquet")
    np.testing.assert_array_equal(run["controller_torque_estimate_nm"], played["controller_torque_estimate_nm"])


def test_a_bench_of_one_side_is_refused(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder, "request_parameters", lambda session, bench, node: [])
    monkeypatch.setattr(recorder, "_DESCRIPTION_TIMEOUT", 0.0)
    feed = ScriptedFeed(played, [[batch] for batch in make_batches(played, "plant")])
    feed.alive["controller"] = False
    with pytest.raises(InputError, match="the controller of bench local:script@here publishes no telemetry"):
        record_feed(feed, tmp_path / "run.parquet")
    assert list(tmp_path.iterdir()) == []


def test_a_node_that_ends_while_it_is_asked_spoils_nothing(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = [True]

    def parameters(session: Any, bench: str, node: str) -> list[dict[str, Any]]:
        if gone and gone.pop():
            raise InputError(f"the {node} does not answer")
        return []

    monkeypatch.setattr(recorder, "request_parameters", parameters)
    sentence = record_feed(ScriptedFeed(played, split_steps(played)), tmp_path / "run.parquet")
    assert not gone
    assert sentence.files == {tmp_path / "run.parquet": len(played.plant)}


def test_a_failure_keeps_what_came_before(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = split_steps(played)
    script[3][1] = replace(script[3][1], columns=())
    with pytest.raises(ValueError, match="not in list"):
        record_script(played, script, tmp_path / "run.parquet", monkeypatch)
    assert [path.name for path in tmp_path.iterdir()] == ["run.parquet"]
    run = read_run(tmp_path / "run.parquet")
    assert "not in list" in run.metadata["incomplete"]
    np.testing.assert_array_equal(run["time_s"], played.plant[: len(run["time_s"]), 0])


def test_a_bench_without_rows_is_told(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="published no rows; nothing was recorded"):
        record_script(played, [[]], tmp_path / "run.parquet", monkeypatch)
    assert list(tmp_path.iterdir()) == []
