"""MDF files are read channel by channel: their units, masters, validity and words count."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asammdf import MDF, Signal
from asammdf.blocks import conversion_utils

from benchmarks.mutations import check_damaged
from clutch_hil.recordings.channel import choose_channel
from clutch_hil.recordings.format import open_recording, recognise
from protocols.errors import InputError
from protocols.files.mdf.conversions import compute
from tests.clutch_hil.recordings.maps import find_refusal, import_by
from tests.clutch_hil.recordings.mdf_files import (
    FORCE,
    GEARS,
    MAP,
    POSITION,
    ROWS,
    TIME,
    make_plain_signals,
    make_signal,
    read_values,
    write,
    write_unsorted,
)


@pytest.mark.parametrize("name", ["OK.MF4", "ok.mdf", "inca.dat", "no_suffix", "wrong.csv"])
@pytest.mark.parametrize("version", ["4.10", "4.20", "3.30"])
@pytest.mark.parametrize("compression", [0, 1, 2])
def test_content_decides_not_the_suffix(tmp_path: Path, name: str, version: str, compression: int) -> None:
    path = write(tmp_path / name, make_plain_signals(), version=version, compression=compression)
    assert recognise(path).name == "MDF"
    run = import_by(tmp_path, path, MAP)
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(run["position_m"], POSITION)
    np.testing.assert_array_equal(run["motor_force_n"], FORCE)


@pytest.mark.parametrize("clock", ["time_s", "time"])
def test_time_goes_by_its_own_name_or_ours(tmp_path: Path, clock: str) -> None:
    path = write(tmp_path / "a.mf4", make_plain_signals(), [make_signal("oil", TIME[::10], TIME[::10], unit="degC")])
    run = import_by(tmp_path, path, MAP.replace('from = "time_s"', f'from = "{clock}"'))
    np.testing.assert_array_equal(run["position_m"], POSITION)


def write_unfinished(path: Path, flags: int) -> Path:
    """An MDF whose writer was stopped: the number of its rows and the length of its data were never filled in."""
    content = bytearray(write(path, make_plain_signals()).read_bytes())
    content[:8] = b"UnFinMF "
    struct.pack_into("<H", content, 60, flags)
    if flags & 1:
        group = content.index(b"##CG")
        (links,) = struct.unpack_from("<Q", content, group + 16)
        struct.pack_into("<Q", content, group + 24 + 8 * links + 8, 0)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("flags", [0, 1])
def test_an_unfinished_file_is_read_and_left_as_it_is(tmp_path: Path, flags: int) -> None:
    path = write_unfinished(tmp_path / "logger.mf4", flags)
    before = path.read_bytes()
    run = import_by(tmp_path, path, MAP)
    np.testing.assert_array_equal(run["position_m"], POSITION)
    assert any("never finished" in note for note in run.metadata["import"]["done"])
    assert path.read_bytes() == before
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["logger.mf4", "map.toml"]


def test_rows_in_the_order_in_which_they_came_are_sorted(tmp_path: Path) -> None:
    path = write_unsorted(tmp_path / "logger.mf4")
    np.testing.assert_array_equal(read_values(path, "pos")[1], POSITION)
    channel, force, time = read_values(path, "force")
    assert channel.rows == len(TIME[::10])
    np.testing.assert_array_equal(force, FORCE[::10])
    np.testing.assert_array_equal(time, TIME[::10])
    read, refused = check_damaged(path, path.read_bytes(), 60)
    assert read
    assert refused


def test_messages_of_a_bus_are_left_to_those_who_know_them(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no channels to read: it holds messages of a bus, not signals"):
        open_recording(write_unsorted(tmp_path / "can.mf4", bus_flag=6))  # of a bus, and as they came from it


def test_a_name_twice_matters_only_where_it_is_asked_for(tmp_path: Path) -> None:
    twice = [[make_signal("status", TIME + k)] for k in (1, 2)]
    path = write(tmp_path / "a.mf4", make_plain_signals(), *twice)
    assert len(import_by(tmp_path, path, MAP)["time_s"]) == ROWS
    ambiguous = MAP.replace('from = "pos"', 'from = "status"')
    assert "has 2 columns 'status'; select one by `from`: 'group 2/status', 'group 3/status'" in find_refusal(
        tmp_path, path, ambiguous
    )
    run = import_by(tmp_path, path, MAP.replace('from = "pos"', 'from = "group 3/status"'))
    np.testing.assert_array_equal(run["position_m"], TIME + 2)


def test_a_name_twice_in_one_group_has_two_paths(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", [make_signal("x", TIME), make_signal("x", 2 * TIME)])
    recording = open_recording(path)
    assert len({channel.path for channel in recording.channels}) == len(recording.channels) == 3
    np.testing.assert_array_equal([s.values[1] for s in recording.read(recording.channels[1:])], [0.01, 0.02])


def test_groups_of_two_rates_are_joined_where_a_rate_is_given(tmp_path: Path) -> None:
    slow = TIME[::10]
    path = write(
        tmp_path / "a.mf4", [make_signal("pos", POSITION, unit="m")], [make_signal("force", slow, slow, unit="N")]
    )
    assert "set resample_hz in [file] to join them" in find_refusal(tmp_path, path, MAP)
    run = import_by(tmp_path, path, "[file]\nresample_hz = 100.0\n" + MAP)
    np.testing.assert_allclose(run["motor_force_n"], run["time_s"], atol=1e-9)
    first = open_recording(path).channels
    assert [channel.raster for channel in first] == ["group 1", "group 1", "group 2", "group 2"]
    assert first[3].rate_hz == pytest.approx(10.0)
    assert (first[3].start_s, first[3].end_s) == (0.0, pytest.approx(2.9))


def test_only_the_channels_asked_for_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    path = write(tmp_path / "a.mf4", [*make_plain_signals(), make_signal("other", TIME)], [make_signal("more", TIME)])
    recording = open_recording(path)
    original = MDF.get

    def get(self: MDF, *args: Any, **options: Any) -> Any:
        read.append(self.groups[options["group"]].channels[options["index"]].name)
        return original(self, *args, **options)

    monkeypatch.setattr(MDF, "get", get)
    recording.read([choose_channel(path, recording.channels, "pos")])
    assert sorted(read) == ["pos", "time"]


def test_the_files_own_units_count_and_are_told(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", [make_signal("pos", POSITION, unit="mm"), make_signal("force", FORCE, unit="kN")])
    run = import_by(tmp_path, path, MAP)
    np.testing.assert_allclose(run["position_m"], 1e-3 * POSITION)
    np.testing.assert_allclose(run["motor_force_n"], 1e3 * FORCE)
    assert "pos: the file says mm, the map m; the file's unit is used" in run.metadata["import"]["done"]


@pytest.mark.parametrize("version", ["4.10", "3.30"])
@pytest.mark.parametrize(("unit", "per_second"), [("ms", 1e3), ("us", 1e6), ("s", 1.0), ("", 1.0), ("ticks", 1.0)])
def test_a_time_master_in_another_unit_becomes_seconds(
    tmp_path: Path, version: str, unit: str, per_second: float
) -> None:
    with MDF(version=version) as mdf:
        mdf.append([make_signal("pos", POSITION, per_second * TIME, unit="m")])
        master = mdf.groups[0].channels[0]
        if version == "4.10":
            master.unit = unit
        else:
            master.conversion.unit, master.conversion.unit_field = unit, unit.encode().ljust(20, b"\0")
        path = Path(mdf.save(tmp_path / "a.mf4"))
    channel, axis, time = read_values(path, "time_s")
    assert (channel.kind, channel.unit) == ("time", "s")
    np.testing.assert_allclose(axis, TIME, rtol=1e-12)
    np.testing.assert_array_equal(axis, time)
    sentence = " ".join(open_recording(path).notes)
    assert ("converted to seconds" in sentence) == (unit in ("ms", "us"))
    assert ("unknown unit 'ticks'; taken as seconds" in sentence) == (unit == "ticks")


@pytest.mark.parametrize(("kind", "unit"), [(2, "rad"), (3, "m"), (4, "1")])
@pytest.mark.parametrize("written", ["", "rad", "m"])
def test_a_master_that_counts_something_else_is_never_a_time(
    tmp_path: Path, kind: int, unit: str, written: str
) -> None:
    with MDF(version="4.10") as mdf:
        mdf.append(
            [make_signal("pos", POSITION, master=("time", kind)), make_signal("force", FORCE)], common_timebase=True
        )
        mdf.groups[0].channels[0].unit = written
        path = Path(mdf.save(tmp_path / "a.mf4"))
    assert read_values(path, "pos")[2] is None
    clock = next(c for c in open_recording(path).channels if c.name == "time")
    assert (clock.kind, clock.unit) == ("number", written or unit)
    assert "cannot be converted into 's'" in find_refusal(
        tmp_path, path, MAP.replace('from = "time_s"', 'from = "time"')
    )
    assert "no column 'time_s'" in find_refusal(tmp_path, path, MAP)


def test_rows_over_an_angle_take_a_time_of_their_group(tmp_path: Path) -> None:
    angle = np.cumsum(1.0 + TIME)
    group = [
        make_signal("pos", POSITION, angle, master=("angle", 2), unit="m"),
        make_signal("clock", TIME, angle, unit="s"),
    ]
    path = write(tmp_path / "a.mf4", [*group, make_signal("force", FORCE, angle, unit="N")])
    run = import_by(tmp_path, path, MAP.replace('from = "time_s"', 'from = "clock"'))
    np.testing.assert_array_equal(run["time_s"], TIME)


def test_a_scaled_time_reaches_every_raster(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a.mf4", [make_signal("pos", POSITION, unit="m")], [make_signal("force", TIME, TIME, unit="N")]
    )
    text = "[file]\nresample_hz = 10.0\n" + MAP.replace('unit = "s"', 'unit = "s", scale = 10.0')
    run = import_by(tmp_path, path, text)
    np.testing.assert_allclose(run["motor_force_n"], run["time_s"] / 10.0, atol=1e-9)


def test_invalid_samples_are_no_numbers(tmp_path: Path) -> None:
    invalid = np.arange(ROWS) == 7
    path = write(tmp_path / "a.mf4", [make_signal("pos", np.arange(ROWS, dtype="i2"), invalidation_bits=invalid)])
    np.testing.assert_array_equal(np.isnan(read_values(path, "pos")[1]), invalid)


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_numbers_with_words_are_a_status_with_its_raw_numbers(tmp_path: Path, version: str) -> None:
    gear = (np.arange(ROWS) // 100).astype("u1")
    path = write(tmp_path / "a.mf4", [make_signal("gear", gear, conversion=GEARS, unit="-")], version=version)
    channel, read, _ = read_values(path, "gear")
    assert (channel.kind, channel.unit) == ("status", "1")
    np.testing.assert_array_equal(read, gear)
    text = '[columns]\ntime_s = { from = "time" }\ngear_1 = { from = "gear", unit = "1" }\n'
    run = import_by(tmp_path, path, "[file]\nresample_hz = 250.0\n" + text)
    assert set(run["gear_1"]) == {0.0, 1.0, 2.0}  # held, not interpolated


GAUGE = {"val_0": 254, "text_0": b"low", "val_1": 255, "text_1": b"SNA", "default": b""}


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_numbers_with_a_unit_stay_numbers_where_some_have_names(tmp_path: Path, version: str) -> None:
    """As those of a DBC: value_tables.py."""
    raw = np.append(np.arange(ROWS - 1) % 255, 255).astype("u1")
    path = write(tmp_path / "a.mf4", [make_signal("pos", raw, conversion=GAUGE, unit="mm")], version=version)
    channel, read, _ = read_values(path, "pos")
    assert (channel.kind, channel.unit) == ("number", "mm")
    np.testing.assert_array_equal(read, np.where(raw < 255, raw, np.nan))
    recording = open_recording(path)
    recording.read([choose_channel(path, recording.channels, "pos")])
    assert "pos: 1 sample without a value by the file: SNA" in recording.notes


def test_a_status_whose_unit_the_map_corrects_is_held(tmp_path: Path) -> None:
    gear = (np.arange(ROWS) // 100).astype("u1")
    path = write(tmp_path / "a.mf4", [make_signal("gear", gear, conversion=GEARS, unit="km/h")])
    entry = 'gear_1 = { from = "gear", unit = "1", unit_from = "map" }\n'
    run = import_by(tmp_path, path, f'[file]\nresample_hz = 250.0\n[columns]\ntime_s = {{ from = "time" }}\n{entry}')
    assert set(run["gear_1"]) == {0.0, 1.0, 2.0}


@pytest.mark.parametrize("version", ["4.10", "3.30"])
@pytest.mark.parametrize("unit", ["bar", ""])
def test_words_for_ranges_of_a_quantity_leave_its_numbers(tmp_path: Path, version: str, unit: str) -> None:
    classes = {
        "lower_0": 0,
        "upper_0": 1,
        "text_0": b"low",
        "lower_1": 1,
        "upper_1": 9,
        "text_1": b"high",
        "default": b"",
    }
    path = write(tmp_path / "a.mf4", [make_signal("p", TIME, conversion=classes, unit=unit)], version=version)
    channel, read, _ = read_values(path, "p")
    assert (channel.kind, channel.unit) == ("number", unit)
    np.testing.assert_array_equal(read, TIME)


def test_words_beside_numbers_are_no_numbers(tmp_path: Path) -> None:
    raw = np.arange(ROWS, dtype="u2")
    conversion = {
        "lower_0": 0, "upper_0": 249, "text_0": conversion_utils.from_dict({"a": 0.5, "b": -40.0}),
        "lower_1": 250, "upper_1": 65535, "text_1": b"error",
    }  # fmt: skip
    path = write(tmp_path / "a.mf4", [make_signal("oil", raw, conversion=conversion, unit="degC")])
    channel, read, _ = read_values(path, "oil")
    assert channel.kind == "number"
    np.testing.assert_array_equal(read, np.where(raw < 250, 0.5 * raw - 40.0, np.nan))


@pytest.mark.parametrize("version", ["4.10", "3.30"])
@pytest.mark.parametrize(
    ("conversion", "expected"),
    [
        ({"a": 0.5, "b": -1.0}, lambda x: 0.5 * x - 1.0),
        ({"P1": 0, "P2": 2, "P3": 1, "P4": 0, "P5": 0, "P6": 4}, lambda x: (2 * x + 1) / 4),
        ({"formula": "X*2+sin(X)**2"}, lambda x: 2 * x + np.sin(x) ** 2),
        ({"raw_0": 0.0, "phys_0": 0.0, "raw_1": 400.0, "phys_1": 800.0, "interpolation": True}, lambda x: 2.0 * x),
    ],
)
def test_conversions_give_physical_values(tmp_path: Path, version: str, conversion: Any, expected: Any) -> None:
    raw = np.arange(ROWS, dtype="i2")
    path = write(tmp_path / "a.mf4", [make_signal("x", raw, conversion=conversion)], version=version)
    np.testing.assert_allclose(read_values(path, "x")[1], expected(raw.astype(float)), rtol=1e-12)


@pytest.mark.parametrize("dtype", ["u2", "i4", "f8"])
def test_a_number_for_each_range(tmp_path: Path, dtype: str) -> None:
    """Ranges of whole numbers hold both of their ends, other ones the lower."""
    conversion = {
        "lower_0": 0.0, "upper_0": 25.0, "phys_0": 1.0, "lower_1": 26.0, "upper_1": 99.0, "phys_1": 2.0, "default": -1.0,
    }  # fmt: skip
    raw = np.arange(ROWS).astype(dtype)
    path = write(tmp_path / "a.mf4", [make_signal("x", raw, conversion=conversion)])
    ends = (25, 99) if dtype != "f8" else (24, 98)
    expected = np.where(raw <= ends[0], 1.0, np.where((raw >= 26) & (raw <= ends[1]), 2.0, -1.0))
    np.testing.assert_array_equal(read_values(path, "x")[1], expected)


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("0.5*X^2+3", lambda x: 0.5 * x**2 + 3.0),
        ("X1^2+3", lambda x: x**2 + 3.0),
        ("-X^2", lambda x: -(x**2)),
        ("2^X", lambda x: 2.0**x),
        ("(X+1)^(1/2)", lambda x: np.sqrt(x + 1.0)),
    ],
)
def test_a_power_binds_more_than_products_and_sums(formula: str, expected: Any) -> None:
    np.testing.assert_allclose(compute(formula, TIME), expected(TIME), rtol=1e-14)


def test_mdf_2_is_read(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mdf", [make_signal("x", np.arange(ROWS, dtype="u2"))], version="2.14")
    np.testing.assert_array_equal(read_values(path, "x")[1], np.arange(ROWS))


@pytest.mark.parametrize(
    "formula", ["__import__('os').system('true')", "X.real", "9**9**9**9**", "open", "X if X else 1", "("]
)
def test_a_formula_is_never_run_as_code(formula: str) -> None:
    with pytest.raises(ValueError, match="is not known"):
        compute(formula, TIME)


def test_a_power_in_a_formula_ends() -> None:
    assert np.isinf(compute("9**9**9**9", TIME)).all()


def test_text_arrays_and_messages_are_told(tmp_path: Path) -> None:
    text = make_signal("remark", np.array([b"ok"] * ROWS), encoding="utf-8")
    field = Signal(np.rec.fromarrays([np.ones((ROWS, 3))], dtype=[("map", "<f8", (3,))]), TIME, name="map")
    path = write(tmp_path / "a.mf4", [*make_plain_signals(), text], [field])
    recording = open_recording(path)
    kinds = {channel.name: channel.kind for channel in recording.channels}
    assert kinds["remark"] == "text"
    assert "map" not in kinds
    assert "left out as arrays or structures: map" in recording.notes
    assert "'remark' holds text, such as 'ok'; allowed are columns of numbers" in find_refusal(
        tmp_path, path, MAP.replace('from = "pos"', 'from = "remark"')
    )


def test_a_unit_in_a_name_is_one_where_no_other_is_told(tmp_path: Path) -> None:
    signals = [make_signal("torque [kNm]", TIME), make_signal("force [N]", TIME, unit="kN")]
    channels = open_recording(write(tmp_path / "a.mf4", signals)).channels
    assert [(c.name, c.path, c.unit) for c in channels if c.kind == "number"] == [
        ("torque", "torque [kNm]", "kNm"), ("force [N]", "force [N]", "kN"),
    ]  # fmt: skip
