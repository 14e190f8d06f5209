"""Kills in small: the command kills two benches and judges what is left."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import kills
from benchmarks.kills import Outcome, Plan, _read_run_end, measure_kills, tabulate_kills
from protocols.errors import InterruptionError
from protocols.files.runs import REQUIRED, RunWriter
from protocols.node import Column

RATE = 1000


def write(path: Path, ticks: np.ndarray, first_clock: float = 0.0) -> Path:
    """A run with rows at `ticks`, of which tick 0 was at `first_clock` [s]."""
    columns = [Column(name, "1", "a value") for name in (*REQUIRED, "plant_clock_s")]
    rows = np.ones((len(ticks), len(columns)))
    rows[:, 0], rows[:, -1] = ticks / RATE, first_clock + ticks / RATE
    with RunWriter(path, columns) as writer:
        writer.append(rows)
        writer.finish({"sample_rate_hz": RATE})
    return path


def test_a_few_kills_leave_readable_recordings_and_nothing_else() -> None:
    sentence: list[str] = []
    targets, document = measure_kills(2, 1, sentence.append)
    assert [target.name for target in targets if not target.is_met] == [], sentence
    assert len(document["kills"]) == len(sentence) == 2
    killed = {kill["plan"]["victim"] for kill in document["kills"]}
    assert {row[0] for row in tabulate_kills(document)[1:] if row[1] != "0"} == killed


def test_what_a_recording_lacks_is_seen(tmp_path: Path) -> None:
    ticks = np.arange(2000)
    assert _read_run_end(write(tmp_path / "a.parquet", ticks, 50.0)) == pytest.approx((1.999, 51.999, 0))
    assert _read_run_end(write(tmp_path / "b.parquet", np.delete(ticks, [700, 701, 900]), 50.0))[2] == 2


def test_an_interruption_keeps_what_was_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    left = iter([Outcome(Plan("parent", "run", 1.0, False, False, False), readable=1, needed=1, lost=[0.5])])

    def play(plan: Plan, stop: object) -> Outcome:
        if (outcome := next(left, None)) is None:
            raise InterruptionError("the first kill was not played to its end; nothing is kept")
        return outcome

    monkeypatch.setattr(kills, "_play", play)
    targets, document = measure_kills(3, 1, lambda line: None)
    assert [target.name for target in targets if not target.is_met] == ["kills"]
    assert len(document["kills"]) == 1
    with pytest.raises(InterruptionError):
        measure_kills(3, 1, lambda line: None)


def test_a_recording_that_is_missing_late_or_with_remains_is_not_met(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = Plan("parent", "run", 1.0, False, False, False)
    bad = Outcome(plan, needed=1, readable=0, lost=[1.5], gaps=1, left=["process plant"])
    monkeypatch.setattr(kills, "_play", lambda plan, stop: bad)
    targets, _ = measure_kills(1, 1, lambda line: None)
    assert [target.is_met for target in targets] == [True, False, False, False, False]
