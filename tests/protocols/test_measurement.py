"""ASAM MF4: a run comes back to the bit with all that is said about it; files of others are read or refused in one sentence."""

import itertools
import math
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asammdf import MDF, Signal

from protocols.errors import InputError
from protocols.files.run import Run
from protocols.files.runs import REQUIRED, read_run, write_run

RATE_HZ = 1000.0
SAMPLES = 2500
SPECIAL = (math.nan, math.inf, -math.inf, -0.0, 5e-324, 1e300)  # what text or 32-bit formats lose

METADATA: dict[str, Any] = {
    "rig": "wet_clutch",
    "sample_rate_hz": 1000,
    "notes": ' "quoted" <b>&amp; ünïcode\n\tsecond line ',
    "empty": "",
    "text that looks like JSON": '{"a": 1}',
    "nested": {"parameters": {"clutch.slope": 10.8}, "list": [1, 2.5, None, True]},
}


def run(metadata: dict[str, Any] | None = None, **more: np.ndarray) -> Run:
    values = np.random.default_rng(11).normal(size=(len(REQUIRED), SAMPLES))
    values[0] = np.arange(SAMPLES) / RATE_HZ
    special = np.resize(np.array(SPECIAL), SAMPLES)
    columns = dict(zip(REQUIRED, values, strict=True)) | {"truth_x_m": special} | more
    units = {name: f"unit² of {name}" for name in columns} | {"time_s": "s"}  # a text that is no unit
    return Run(columns, metadata or {}, units, {name: f'"{name}" & <what> it méans' for name in columns})


def list_bits(values: np.ndarray) -> list[int]:
    return values.view(np.int64).tolist()


def write_foreign(path: Path, *groups: Sequence[Signal]) -> Path:
    """A file by another program: one channel group for each of `groups`."""
    with MDF(version="4.10") as mdf:
        for signals in groups:
            mdf.append(list(signals), common_timebase=True)
        mdf.save(path)
    return path


def make_signals(wanted: Run, names: Sequence[str], rate: float = RATE_HZ) -> list[Signal]:
    time = np.arange(SAMPLES) / rate
    return [Signal(wanted[name], time, name=name, unit="?") for name in names if name != "time_s"]


def find_refusal(path: Path) -> str:
    with pytest.raises(InputError) as refused:
        read_run(path)
    message = str(refused.value)
    assert str(path) in message
    assert "\n" not in message
    return message


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mf4"


def test_a_run_comes_back_to_the_bit(path: Path) -> None:
    wanted = run(METADATA)
    write_run(wanted, path)
    read = read_run(path)
    assert list(read.columns) == list(wanted.columns)
    for name, values in wanted.columns.items():
        assert list_bits(read[name]) == list_bits(values), name
    assert read.metadata == METADATA
    assert read.units == wanted.units
    assert read.meanings == wanted.meanings


def test_parquet_to_mf4_and_back_loses_nothing(tmp_path: Path) -> None:
    wanted = run(METADATA)
    paths = [tmp_path / "a.parquet", tmp_path / "b.mf4", tmp_path / "c.parquet"]
    write_run(wanted, paths[0])
    for source, target in itertools.pairwise(paths):
        write_run(read_run(source), target)
    first, last = read_run(paths[0]), read_run(paths[-1])
    assert {name: list_bits(values) for name, values in last.columns.items()} == {
        name: list_bits(values) for name, values in first.columns.items()
    }
    assert (last.metadata, last.units, last.meanings) == (first.metadata, first.units, first.meanings)


def test_a_measurement_tool_sees_one_group_with_time_as_master(path: Path) -> None:
    wanted = run(METADATA)
    write_run(wanted, path)
    with MDF(path) as mdf:
        assert mdf.version == "4.10"
        assert len(mdf.groups) == 1
        assert [channel.name for channel in mdf.groups[0].channels] == list(wanted.columns)
        master = mdf.groups[0].channels[mdf.masters_db[0]]
        assert (master.name, master.unit) == ("time_s", "s")
        for name in REQUIRED[1:]:
            channel = mdf.get(name)
            assert channel.samples.dtype == np.float64
            assert (channel.unit, channel.comment) == (wanted.units[name], wanted.meanings[name])
            np.testing.assert_array_equal(channel.timestamps, wanted["time_s"])


def test_the_file_begins_at_the_time_of_day_of_time_zero(path: Path) -> None:
    zero = datetime(2026, 11, 21, 6, 3, 6, 123456, tzinfo=UTC)
    late = (zero + timedelta(seconds=12)).isoformat()
    write_run(run({"recorded_at": late, "time_zero": zero.isoformat()}), path)
    with MDF(path) as mdf:
        assert mdf.header.start_time == zero
    write_run(run({"recorded_at": late}), path)
    with MDF(path) as mdf:
        assert mdf.header.start_time.isoformat() == late


def test_a_run_without_units_or_metadata_is_written_too(path: Path) -> None:
    write_run(Run(run().columns, {}), path)
    assert read_run(path).metadata == {}
    assert read_run(path).units["valve_voltage_v"] == ""


def test_a_place_that_cannot_be_written_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    path = tmp_path / "file" / "run.mf4"
    with pytest.raises(InputError, match=str(path)):
        write_run(run(), path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_a_failed_writing_leaves_the_older_file_alone(path: Path) -> None:
    write_run(run({"notes": "older"}), path)
    with pytest.raises(InputError, match="cannot be written as JSON"):
        write_run(run({"notes": object()}), path)
    assert read_run(path).metadata["notes"] == "older"
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("metadata", "sentence"),
    [
        ({"recorded_at": "yesterday"}, "metadata recorded_at is 'yesterday'; allowed is a time as in ISO 8601"),
        ({"time_zero": 5}, "metadata time_zero is 5; allowed is a time as in ISO 8601"),
        ({"a\x01": 1}, r"metadata 'a\\x01' cannot be written as MF4"),
    ],
)
def test_metadata_of_others_that_cannot_be_written_are_refused_by_name(
    path: Path, metadata: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        write_run(run(metadata), path)
    assert list(path.parent.iterdir()) == []


def test_a_foreign_file_with_one_group_is_a_run(path: Path) -> None:
    wanted = run()
    read = read_run(write_foreign(path, make_signals(wanted, REQUIRED)))
    for name in REQUIRED:
        np.testing.assert_array_equal(read[name], wanted[name])


def test_groups_on_one_raster_are_joined(path: Path) -> None:
    wanted = run()
    read = read_run(write_foreign(path, make_signals(wanted, REQUIRED[:4]), make_signals(wanted, REQUIRED[4:])))
    for name in REQUIRED:
        np.testing.assert_array_equal(read[name], wanted[name])


def test_conversions_are_applied_and_invalid_samples_are_no_numbers(path: Path) -> None:
    time = np.arange(SAMPLES) / RATE_HZ
    counts = Signal(
        np.arange(SAMPLES, dtype=np.int16), time, name="counts", unit="bar", conversion={"a": 0.5, "b": -1.0},
        invalidation_bits=np.arange(SAMPLES) == 7,
    )  # fmt: skip
    read = read_run(write_foreign(path, [*make_signals(run(), REQUIRED), counts]))
    expected = 0.5 * np.arange(SAMPLES) - 1.0
    expected[7] = np.nan
    np.testing.assert_array_equal(read["counts"], expected)


def test_text_channels_are_left_out(path: Path) -> None:
    text = Signal(np.array([b"ok"] * SAMPLES), np.arange(SAMPLES) / RATE_HZ, name="remark", encoding="utf-8")
    assert "remark" not in read_run(write_foreign(path, [*make_signals(run(), REQUIRED), text])).columns


def test_two_rasters_are_refused_by_channel(path: Path) -> None:
    write_foreign(path, make_signals(run(), REQUIRED[:4]), make_signals(run(), REQUIRED[4:], rate=100.0))
    assert "channels valve_voltage_v and slip_speed_rad_s on different rasters; a run needs one" in find_refusal(path)


def test_a_foreign_file_that_lacks_a_column_is_refused_by_name(path: Path) -> None:
    write_foreign(path, make_signals(run(), REQUIRED[:-1]))
    assert find_refusal(path) == f"run {path} lacks the column motor_torque_nm"


def test_a_channel_that_stands_twice_is_refused_by_name(path: Path) -> None:
    write_foreign(path, make_signals(run(), REQUIRED), make_signals(run(), REQUIRED[3:4]))
    assert find_refusal(path) == f"run {path} has the channel cylinder_pressure_bar twice"


def test_a_file_without_numbers_is_refused(path: Path) -> None:
    write_foreign(path)
    assert "has no channels with numbers over time" in find_refusal(path)


def cut_off(path: Path) -> None:
    write_run(run(), path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


UNREADABLE: dict[str, Callable[[Path], object]] = {
    "missing": lambda path: None,
    "folder": lambda path: path.mkdir(),
    "empty": lambda path: path.touch(),
    "garbage": lambda path: path.write_bytes(bytes(range(256)) * 8),
    "cut off": cut_off,
}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # of asammdf's half-open file
@pytest.mark.parametrize("kind", UNREADABLE)
def test_an_unreadable_file_is_refused_by_name(path: Path, kind: str, capfd: pytest.CaptureFixture[str]) -> None:
    UNREADABLE[kind](path)
    assert ("does not exist" if kind == "missing" else "cannot be read") in find_refusal(path)
    assert capfd.readouterr().err == ""
