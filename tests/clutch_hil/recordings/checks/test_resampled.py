"""Columns with fewer samples than rows are told, however they were filled in; sound ones are not."""

import numpy as np
import pytest

from clutch_hil.recordings.checks.knowledge import Knowledge, Limits, Recorded
from clutch_hil.recordings.checks.resampled import find_resampled

ROWS = 6000
TIME = 1e-3 * np.arange(ROWS)
TORQUE = 5.0 * np.sin(2.0 * TIME) + 0.05 * np.random.default_rng(1).standard_normal(ROWS)  # Nm


def hold(values: np.ndarray, every: int) -> np.ndarray:
    return np.repeat(values[::every], every)[: len(values)]


def join(values: np.ndarray, every: int) -> np.ndarray:
    return np.interp(np.arange(len(values)), np.arange(0, len(values), every), values[::every])


def find(values: np.ndarray, delay: float = 0.1) -> list[str]:
    known = {"torque": Knowledge("Nm", 0.05, TORQUE, Limits(delay=delay))}
    run = Recorded("r", {"time_s": TIME, "torque": values}, known)
    return [str(finding) for finding in find_resampled(run)]


@pytest.mark.parametrize("every", [2, 5, 10, 100])
def test_a_column_that_was_held_is_told_with_its_interval(every: int) -> None:
    (text,) = find(hold(TORQUE, every))
    assert f"changes only every {every} ms" in text


@pytest.mark.parametrize(("every", "decimals"), [(2, 3), (5, 3), (10, 3), (10, 6), (100, 6), (100, 15)])
def test_a_column_that_was_joined_is_told_with_its_decimals(every: int, decimals: int) -> None:
    (text,) = find(np.round(join(TORQUE, every), decimals))
    assert f"from each {every}th row" in text


def test_a_bus_whose_frames_come_a_row_early_or_late_is_told() -> None:
    at = np.cumsum(np.random.default_rng(2).choice([9, 10, 11], ROWS // 10, p=[0.1, 0.8, 0.1]))
    held = TORQUE[np.concatenate([[0], at])[np.searchsorted(at, np.arange(ROWS), "right")].clip(0, ROWS - 1)]
    (text,) = find(held)
    assert "changes only every 10 ms" in text


@pytest.mark.parametrize(
    "values",
    [
        TORQUE,
        np.round(TORQUE, 1),  # a coarse converter
        np.round(2.0 * TIME, 2),  # a ramp on equal steps
        np.round(5.0 * np.sin(2.0 * TIME), 2),  # without noise
        np.zeros(ROWS),
        np.where(TIME < 3.0, 0.0, 1.0),
        hold(TORQUE, 200),  # too few samples to tell
        np.where(TIME < 3.0, hold(TORQUE, 3000), TORQUE),  # frozen for a while
        5.0 * np.sin(2.0 * TIME),
    ],
)
def test_sound_columns_are_not_told(values: np.ndarray) -> None:
    assert find(values) == []


def test_a_slow_channel_may_be_held() -> None:
    assert find(hold(TORQUE, 10), delay=60.0) == []
