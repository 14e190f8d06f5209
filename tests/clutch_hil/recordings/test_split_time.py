"""Whole seconds in one column and their fractions in another, in any format, are one time; what only looks so is not."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from clutch_hil.recordings.channel import Channel, Signal
from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from clutch_hil.recordings.split_time import find_fraction
from tests.clutch_hil.recordings.maps import import_by
from tests.clutch_hil.recordings.text_files import ROWS, TORQUE, convert_run, find_refusal, read

STEP_US = 130_000
MOMENTS = 700_000 + STEP_US * np.arange(ROWS)  # us
SECONDS, REST = MOMENTS // 1_000_000, MOMENTS % 1_000_000
EPOCH = 1_796_000_000


def make_text(first: str, second: str, seconds: Any, fractions: Any) -> str:
    rows = (f"{a},{b},{torque:.4f}" for a, b, torque in zip(seconds, fractions, TORQUE, strict=True))
    return "\n".join([f"{first},{second},torque", *rows, ""])


def make_map(first: str) -> str:
    return f'[columns]\ntime_s = {{ from = "{first}", unit = "s" }}\ntorque_nm = {{ from = "torque", unit = "Nm" }}\n'


@pytest.mark.parametrize(
    ("first", "second", "fractions"),
    [
        ("ts_sec", "ts_usec", REST),
        ("tv_sec", "tv_nsec", 1000 * REST),
        ("header.stamp.sec", "header.stamp.nanosec", 1000 * REST),
        ("secs", "nsecs", 1000 * REST),
        ("time", "ms", REST // 1000),
        ("time", "µs", REST),
        ("seconds", "fraction", REST / 1e6),
    ],
)
@pytest.mark.parametrize("epoch", [0, EPOCH])
def test_seconds_and_their_fractions_are_one_time(
    tmp_path: Path, first: str, second: str, fractions: np.ndarray, epoch: int
) -> None:
    run = read(tmp_path, make_text(first, second, SECONDS + epoch, fractions), columns=make_map(first))
    np.testing.assert_allclose(run["time_s"] - run["time_s"][0], 0.13 * np.arange(ROWS), atol=1e-6)
    assert f"{first}: with the fractions of its seconds in {second!r}" in convert_run(run)


@pytest.mark.parametrize(
    ("first", "second"),
    [("ts_sec", "ts_usec"), ("header.stamp.secs", "header.stamp.usecs"), ("sec", "usec"), ("s", "us")],
)
def test_a_draft_names_the_seconds_and_imports_as_it_is(tmp_path: Path, first: str, second: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(make_text(first, second, SECONDS + EPOCH, REST))
    run = import_by(tmp_path, path, draft_map(path, open_recording(path)))
    np.testing.assert_allclose(run["time_s"], 0.13 * np.arange(ROWS), atol=1e-6)


def write_hdf5(columns: dict[str, np.ndarray], path: Path) -> None:
    with h5py.File(path, "w") as file:  # in the order of their names
        for name, values in columns.items():
            file[name] = values


@pytest.mark.parametrize("write", [lambda columns, path: pq.write_table(pa.table(columns), path), write_hdf5])
def test_they_are_one_in_a_binary_format(tmp_path: Path, write: Callable[[dict[str, Any], Path], None]) -> None:
    path = tmp_path / "log"
    write({"sec": SECONDS + EPOCH, "nanosec": 1000 * REST, "torque": TORQUE}, path)
    run = import_by(tmp_path, path, make_map("sec"))
    np.testing.assert_allclose(run["time_s"], 0.13 * np.arange(ROWS), atol=1e-6)


def test_microseconds_beside_a_date_and_a_time_of_day_belong_to_it(tmp_path: Path) -> None:
    clock = [f"10:11:{12 + second:02d}" for second in SECONDS]
    run = read(tmp_path, make_text("time", "us", clock, REST), columns=make_map("time").replace(', unit = "s"', "", 1))
    np.testing.assert_allclose(run["time_s"], 0.13 * np.arange(ROWS), atol=1e-9)


@pytest.mark.parametrize(
    ("fractions", "what"),
    [
        (MOMENTS // 10_000, "hundredths since the start"),
        (REST - 500_000, "below 0"),
        (REST + 0.5, "no whole numbers"),
        (np.where(np.arange(ROWS) == 30, 1_000_000, REST), "a second"),
        (np.zeros(ROWS), "nothing"),
    ],
)
def test_what_is_no_fraction_is_not_added(tmp_path: Path, fractions: np.ndarray, what: str) -> None:
    assert "does not increase in row 1" in find_refusal(
        tmp_path, make_text("sec", "usec", SECONDS, fractions), columns=make_map("sec")
    ), what


@pytest.mark.parametrize("fractions", [REST, ["word"] * ROWS])
def test_a_time_that_has_its_fractions_needs_no_other_column(tmp_path: Path, fractions: Any) -> None:
    run = read(tmp_path, make_text("sec", "usec", MOMENTS / 1e6, fractions), columns=make_map("sec"))
    np.testing.assert_allclose(run["time_s"], MOMENTS / 1e6, atol=1e-9)


def test_a_channel_with_a_unit_or_of_another_raster_is_no_fraction() -> None:
    clock = Signal(Channel("sec", 1, "sec", raster="a"), np.arange(5.0))
    beside = Channel("usec", 2, "usec", raster="a")
    assert find_fraction([clock.channel, beside], clock, "s")
    assert find_fraction([clock.channel, replace(beside, unit="µs")], clock, "s")
    assert find_fraction([clock.channel, replace(beside, name="sec_us")], clock, "s")
    for other in (replace(beside, name="speed_ms"), replace(beside, name="bus"), replace(beside, unit="V")):
        assert find_fraction([clock.channel, other], clock, "s") is None
    for other in (replace(beside, raster="b"), replace(beside, kind="text")):
        assert find_fraction([clock.channel, other], clock, "s") is None
    assert find_fraction([clock.channel, beside], clock, "ms") is None
    assert find_fraction([clock.channel, beside], replace(clock, values=np.array([0.0, 0.5])), "s") is None
