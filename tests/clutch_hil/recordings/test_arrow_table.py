"""Parquet and Feather: columns one by one, with units and meanings; times of day from the first; bounds before reading."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq
import pytest

from benchmarks.mutations import check_damaged
from clutch_hil.recordings.channel import choose_channel
from clutch_hil.recordings.format import open_recording, recognise
from clutch_hil.recordings.import_map import load_map
from protocols.errors import InputError
from protocols.files.run import Run
from protocols.files.runs import write_run

ROWS = 300
TIME = np.arange(ROWS) / 100.0
MAP = """
[columns]
time_s = { from = "time_s", unit = "s" }
position_m = { from = "pos", unit = "m" }
"""
START = datetime(2026, 1, 2, 3, 4, 5, 250_000, tzinfo=UTC)


def write_stream(table: pa.Table, path: Path) -> None:
    with pa.ipc.new_stream(path, table.schema) as writer:
        writer.write_table(table, max_chunksize=100)


WRITERS: dict[str, Any] = {
    "parquet": pq.write_table,
    "parquet in groups": lambda table, path: pq.write_table(table, path, row_group_size=64, compression="zstd"),
    "feather": pyarrow.feather.write_feather,
    "feather, zstd": lambda table, path: pyarrow.feather.write_feather(table, path, compression="zstd", chunksize=70),
    "stream": write_stream,
}


def make_example() -> pa.Table:
    described = {b"unit": b"mm", b"meaning": b"of the piston"}
    return pa.table(
        [
            pa.array(TIME), pa.array(np.sin(TIME)), pa.array(np.arange(ROWS, dtype="i4") % 3), pa.array(TIME > 1.0),
            pa.array(["low", "high", "low"] * 100).dictionary_encode(), pa.array(["text"] * ROWS),
            pa.array([START + timedelta(seconds=t) for t in TIME], pa.timestamp("ns", "UTC")),
            pa.array([[1, 2]] * ROWS),
        ],
        schema=pa.schema(
            [
                pa.field("time_s", pa.float64()), pa.field("pos", pa.float64(), metadata=described),
                pa.field("count", pa.int32()), pa.field("on", pa.bool_()),
                pa.field("level", pa.dictionary(pa.int32(), pa.string())), pa.field("remark", pa.string()),
                pa.field("when", pa.timestamp("ns", "UTC")), pa.field("pair", pa.list_(pa.int64())),
            ]
        ),
    )  # fmt: skip


def import_by(tmp_path: Path, recording: Path, text: str = MAP) -> Run:
    toml = tmp_path / "map.toml"
    toml.write_text(text, encoding="utf-8")
    return load_map(str(toml)).read(recording)


def read(path: Path, name: str) -> np.ndarray:
    recording = open_recording(path)
    (signal,) = recording.read([choose_channel(path, recording.channels, name)])
    return signal.values


@pytest.mark.parametrize("kind", WRITERS)
def test_columns_are_read_by_kind(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.dat"
    WRITERS[kind](make_example(), path)
    assert recognise(path).name == "Parquet or Feather"
    recording = open_recording(path)
    assert {c.name: (c.kind, c.unit, c.rows) for c in recording.channels} == {
        "time_s": ("time", "s", ROWS), "pos": ("number", "mm", ROWS), "count": ("number", "", ROWS),
        "on": ("status", "1", ROWS), "level": ("status", "1", ROWS), "remark": ("text", "", ROWS), "when": ("time", "s", ROWS),
    }  # fmt: skip
    assert next(c.comment for c in recording.channels if c.name == "pos") == "of the piston"
    assert any(note.startswith("left out") and "pair" in note for note in recording.notes)
    np.testing.assert_array_equal(read(path, "pos"), np.sin(TIME))
    np.testing.assert_array_equal(read(path, "on"), TIME > 1.0)
    np.testing.assert_array_equal(read(path, "level"), np.tile([0, 1, 0], 100))
    run = import_by(tmp_path, path)
    np.testing.assert_allclose(run["position_m"], 1e-3 * np.sin(TIME))  # the file's unit counts


@pytest.mark.parametrize("kind", WRITERS)
def test_times_of_day_count_from_the_first(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.dat"
    WRITERS[kind](make_example().select(["when", "pos"]), path)
    for clock in ("when", "time_s"):
        run = import_by(tmp_path, path, MAP.replace('from = "time_s"', f'from = "{clock}"'))
        np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-9)
    assert run.metadata["import"]["start"] == START.isoformat()


def test_whole_ns_since_1970_keep_their_digits(tmp_path: Path) -> None:
    steps = 1000 * np.arange(ROWS) + np.arange(ROWS) % 7
    table = pa.table({"t": 1_711_850_000_000_000_123 + steps, "pos": np.sin(TIME)})
    path = tmp_path / "a.parquet"
    pq.write_table(table, path)
    text = '[columns]\ntime_s = { from = "t", unit = "ns" }\nposition_m = { from = "pos", unit = "m" }\n'
    run = import_by(tmp_path, path, text)
    np.testing.assert_allclose(run["time_s"], 1e-9 * steps, rtol=0.0, atol=1e-15)
    run = import_by(tmp_path, path, "[file]\nskip_rows = 3\n" + text)
    np.testing.assert_allclose(run["time_s"], 1e-9 * (steps[3:] - steps[3]), rtol=0.0, atol=1e-15)


def test_text_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    pq.write_table(make_example(), path)
    with pytest.raises(InputError, match="'remark' holds text"):
        import_by(tmp_path, path, MAP.replace('"pos"', '"remark"'))


def test_a_missing_number_and_a_missing_time_are_no_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    pq.write_table(
        pa.table({"x": [1.0, None, 3.0], "when": pa.array([START, None, START + timedelta(seconds=2)])}), path
    )
    np.testing.assert_array_equal(read(path, "x"), [1.0, np.nan, 3.0])
    np.testing.assert_array_equal(read(path, "when"), [0.0, np.nan, 2.0])


def test_units_in_the_attributes_of_pandas_count(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    metadata = {"PANDAS_ATTRS": '{"units": {"pos": "mm"}}'}
    pq.write_table(pa.table({"time_s": TIME, "pos": TIME}).replace_schema_metadata(metadata), path)
    np.testing.assert_allclose(import_by(tmp_path, path)["position_m"], 1e-3 * TIME)


@pytest.mark.parametrize("write_table", [WRITERS["parquet"], WRITERS["feather"]])
def test_an_index_of_pandas_that_is_not_stored_is_a_column(tmp_path: Path, write_table: Any) -> None:
    frame = pandas.DataFrame(
        {"torque": np.sin(TIME)}, index=pandas.RangeIndex(500, 500 + 10 * ROWS, 10, name="time [ms]")
    )
    write_table(pa.Table.from_pandas(frame), tmp_path / "a")
    recording = open_recording(tmp_path / "a")
    torque, index = recording.channels
    assert (index.name, index.unit) == ("time", "ms")
    for asked in ([index], [index, torque]):
        np.testing.assert_array_equal(recording.read(asked)[0].values, 500 + 10 * np.arange(ROWS))
    np.testing.assert_array_equal(recording.read([torque])[0].values, np.sin(TIME))


@pytest.mark.parametrize(
    "index", [{"stop": 10**30}, {"stop": 299}, {"step": 0}, {"name": None}, {"start": 0.5}, {"name": "x"}]
)
def test_an_index_that_does_not_fit_its_table_is_none(tmp_path: Path, index: dict[str, Any]) -> None:
    described = {"kind": "range", "name": "i", "start": 0, "stop": ROWS, "step": 1} | index
    table = pa.table({"x": TIME}).replace_schema_metadata({"pandas": json.dumps({"index_columns": [described]})})
    pq.write_table(table, tmp_path / "a")
    assert [channel.name for channel in open_recording(tmp_path / "a").channels] == ["x"]


def test_units_in_the_second_level_of_names_count(tmp_path: Path) -> None:
    levels = pandas.MultiIndex.from_tuples([("torque", "kNm"), ("wheel", "left")])
    pq.write_table(pa.Table.from_pandas(pandas.DataFrame(np.zeros((ROWS, 2)), columns=levels)), tmp_path / "a")
    channels = open_recording(tmp_path / "a").channels
    assert [(channel.name, channel.unit) for channel in channels] == [("torque", "kNm"), ("('wheel', 'left')", "")]


def test_a_run_of_ours_is_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    metadata = {"inertia": 0.5, "notes": "text", "time_zero": START.isoformat()}
    write_run(Run({"time_s": TIME, "pos": TIME}, metadata, {"time_s": "s", "pos": "mm"}), path)
    run = import_by(tmp_path, path)
    np.testing.assert_array_equal(run["time_s"], TIME)
    assert run.metadata["inertia"] == 0.5
    assert run.metadata["import"]["start"] == START.isoformat()


def test_a_name_twice_is_asked_for_by_path(tmp_path: Path) -> None:
    path = tmp_path / "a.arrow"
    write_stream(pa.table([pa.array(TIME), pa.array(2 * TIME)], names=["x", "x"]), path)
    np.testing.assert_array_equal(read(path, "x/2"), 2 * TIME)
    with pytest.raises(InputError, match="has 2 columns 'x'"):
        read(path, "x")


def test_rows_are_bounded_before_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    rows = 60_000_000
    with pq.ParquetWriter(path, pa.schema([("x", pa.int8())])) as writer:
        piece = pa.table({"x": pa.array(np.zeros(rows // 20, "i1"))})
        for _ in range(20):
            writer.write_table(piece)
    assert path.stat().st_size < 1_000_000
    with pytest.raises(InputError, match=r"has 6e\+07 rows; allowed are 5e\+07"):
        read(path, "x")


@pytest.mark.parametrize("kind", WRITERS)
def test_damaged_files_are_read_or_refused_in_a_sentence(
    tmp_path: Path, kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.dat"
    WRITERS[kind](make_example(), path)
    read_count, refused = check_damaged(path, path.read_bytes(), 60)
    assert read_count
    assert refused
    assert capfd.readouterr() == ("", "")


def test_a_unit_in_a_name_is_one(tmp_path: Path) -> None:
    """A table that pandas read of a CSV file keeps the names with their units."""
    file = tmp_path / "units.parquet"
    pq.write_table(pa.table({"time [ms]": 1e3 * TIME, "pos [mm]": np.sin(TIME), "pos (2)": TIME}), file)
    assert [(c.name, c.path, c.unit) for c in open_recording(file).channels] == [
        ("time", "time [ms]", "ms"), ("pos", "pos [mm]", "mm"), ("pos (2)", "pos (2)", ""),
    ]  # fmt: skip
    toml = tmp_path / "map.toml"
    toml.write_text(MAP.replace('"time_s"', '"time [ms]"'), encoding="utf-8")
    run = load_map(str(toml)).read(file)
    np.testing.assert_allclose(run["time_s"], TIME)
    np.testing.assert_allclose(run["position_m"], 1e-3 * np.sin(TIME))
    assert "pos: the file says mm, the map m; the file's unit is used" in run.metadata["import"]["done"]


def test_times_of_day_pass_midnight(tmp_path: Path) -> None:
    file = tmp_path / "clock.parquet"
    ticks = (86_399_000 + np.round(1e3 * TIME).astype("i4")) % 86_400_000
    pq.write_table(pa.table({"clock": pa.array(ticks, pa.time32("ms")), "pos": TIME}), file)
    toml = tmp_path / "map.toml"
    toml.write_text(MAP.replace('"time_s", unit = "s"', '"clock"'), encoding="utf-8")
    run = load_map(str(toml)).read(file)
    np.testing.assert_allclose(run["time_s"], 86_399.0 + TIME, atol=1e-9)
    assert "clock: passed midnight 1 times, where a day was added" in run.metadata["import"]["done"]


@pytest.mark.parametrize("asked", ["pos", "pos.x"])
def test_a_column_that_was_left_out_is_told_where_it_is_asked_for(tmp_path: Path, asked: str) -> None:
    path, toml = tmp_path / "lists.parquet", tmp_path / "map.toml"
    pq.write_table(pa.table({"time_s": TIME, "pos": [[1.0, 2.0]] * ROWS}), path)
    toml.write_text(MAP.replace('"pos"', f'"{asked}"'))
    with pytest.raises(InputError, match="left out, as they are neither numbers, times nor text: pos \\(list"):
        load_map(str(toml)).read(path)


@pytest.mark.parametrize("writer", WRITERS)
def test_fields_of_structures_are_columns(tmp_path: Path, writer: str) -> None:
    pose = pa.array(
        [{"x": 2.0 * time, "at": {"y": None if row == 7 else time, "unit": "m"}} for row, time in enumerate(TIME)]
    )
    missing = pa.array([row == 9 for row in range(ROWS)])
    pose = pa.StructArray.from_arrays([pose.field(0), pose.field(1)], ["x", "at"], mask=missing)
    table = pa.table([pa.array(TIME), pose, pa.array(3.0 * TIME)], ["time_s", "pose", "pose.x y"])
    path = tmp_path / "log"
    WRITERS[writer](table, path)
    recording = open_recording(path)
    assert [channel.name for channel in recording.channels] == [
        "time_s",
        "pose.x",
        "pose.at.y",
        "pose.at.unit",
        "pose.x y",
    ]
    x, y, other = recording.read(
        [choose_channel(path, recording.channels, one) for one in ("pose.x", "pose.at.y", "pose.x y")]
    )
    np.testing.assert_array_equal(x.values, np.where(np.arange(ROWS) == 9, np.nan, 2.0 * TIME))
    np.testing.assert_array_equal(y.values, np.where(np.isin(np.arange(ROWS), (7, 9)), np.nan, TIME))
    np.testing.assert_array_equal(other.values, 3.0 * TIME)


@pytest.mark.parametrize("writer", WRITERS)
def test_a_column_called_as_a_field_of_a_structure_is_another_one(tmp_path: Path, writer: str) -> None:
    table = pa.table({"time_s": TIME, "pose": [{"x": time} for time in TIME], "pose.x": -TIME})
    path = tmp_path / "log"
    WRITERS[writer](table, path)
    recording = open_recording(path)
    signals = recording.read([choose_channel(path, recording.channels, one) for one in ("pose.x/1", "pose.x/2")])
    np.testing.assert_array_equal(signals[0].values, TIME)
    np.testing.assert_array_equal(signals[1].values, -TIME)
