"""MDF files are read channel by channel: their units, masters, validity and words count; damage is told in one sentence."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asammdf import MDF, Signal
from asammdf.blocks import conversion_utils

from benchmarks.mutations import check_damaged
from clutch_hil.recordings.channel import Channel, choose_channel
from clutch_hil.recordings.format import open_recording, recognise
from clutch_hil.recordings.import_map import load_map
from protocols.errors import InputError
from protocols.files.mdf_conversions import compute
from tests import needs

ROWS = 300
TIME = np.arange(ROWS) / 100.0
POSITION, FORCE = np.sin(TIME), np.cos(TIME)
SECONDS = ("time", 1)
MAP = """
[columns]
time_s = { from = "time_s", unit = "s" }
position_m = { from = "pos", unit = "m" }
motor_force_n = { from = "force", unit = "N" }
"""


def signal(name: str, samples: Any, time: np.ndarray = TIME, **options: Any) -> Signal:
    return Signal(np.asarray(samples), time, name=name, master_metadata=options.pop("master", SECONDS), **options)


def write(path: Path, *groups: list[Signal], version: str = "4.10", compression: int = 0) -> Path:
    with MDF(version=version) as mdf:
        for group in groups:
            mdf.append(group, common_timebase=True)
        written = mdf.save(
            path.with_suffix(".mf4" if version >= "4" else ".mdf"), compression=compression, overwrite=True
        )
    return Path(written).rename(path)


def plain() -> list[Signal]:
    return [signal("pos", POSITION, unit="m"), signal("force", FORCE, unit="N")]


def values(path: Path, name: str) -> tuple[Channel, np.ndarray, np.ndarray | None]:
    recording = open_recording(path)
    channel = choose_channel(path, recording.channels, name)
    (read,) = recording.read([channel])
    return channel, read.values, read.time


def import_by(tmp_path: Path, recording: Path, text: str = MAP) -> Any:
    toml = tmp_path / "map.toml"
    toml.write_text(text, encoding="utf-8")
    return load_map(str(toml)).read(recording)


def refusal(tmp_path: Path, recording: Path, text: str = MAP) -> str:
    with pytest.raises(InputError) as refused:
        import_by(tmp_path, recording, text)
    assert "\n" not in str(refused.value)
    return str(refused.value)


# --- kinds of files ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["OK.MF4", "ok.mdf", "inca.dat", "no_suffix", "wrong.csv"])
@pytest.mark.parametrize("version", ["4.10", "4.20", "3.30"])
@pytest.mark.parametrize("compression", [0, 1, 2])
def test_content_decides_not_the_suffix(tmp_path: Path, name: str, version: str, compression: int) -> None:
    path = write(tmp_path / name, plain(), version=version, compression=compression)
    assert recognise(path).name == "MDF"
    run = import_by(tmp_path, path)
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(run["position_m"], POSITION)
    np.testing.assert_array_equal(run["motor_force_n"], FORCE)


@pytest.mark.parametrize("clock", ["time_s", "time"])
def test_time_goes_by_its_own_name_or_ours(tmp_path: Path, clock: str) -> None:
    path = write(tmp_path / "a.mf4", plain(), [signal("oil", TIME[::10], TIME[::10], unit="degC")])
    run = import_by(tmp_path, path, MAP.replace('from = "time_s"', f'from = "{clock}"'))
    np.testing.assert_array_equal(run["position_m"], POSITION)


def unfinished(path: Path, flags: int) -> Path:
    """An MDF whose writer was stopped: the number of its rows and the length of its data were never filled in."""
    content = bytearray(write(path, plain()).read_bytes())
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
    path = unfinished(tmp_path / "logger.mf4", flags)
    before = path.read_bytes()
    run = import_by(tmp_path, path)
    np.testing.assert_array_equal(run["position_m"], POSITION)
    assert any("never finished" in note for note in run.metadata["import"]["done"])
    assert path.read_bytes() == before
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["logger.mf4", "map.toml"]


def block(kind: bytes, links: list[int], data: bytes) -> bytes:
    length = 24 + 8 * len(links) + len(data)
    return struct.pack(f"<4s4xQQ{len(links)}Q", b"##" + kind, length, len(links), *links) + data


def unsorted(path: Path, bus_flag: int = 0) -> Path:
    """MDF 4 as loggers write it: the rows of two groups after each other as they came, each with the number of its group."""
    content = bytearray(b"MDF     4.10    by hand ".ljust(64, b"\0"))
    struct.pack_into("<H", content, 28, 410)
    content += bytes(104)  # of the header, which is written last

    def add(kind: bytes, links: list[int], data: bytes) -> int:
        content.extend(bytes(-len(content) % 8))
        content.extend(block(kind, links, data))
        return len(content) - len(block(kind, links, data))

    def channel(name: str, following: int, kind: int, place: int) -> int:
        text = add(b"TX", [], name.encode().ljust(8, b"\0"))
        sync = 1 if kind == 2 else 0
        data = struct.pack("<BBBBIIIIBxH6d", kind, sync, 4, 0, place, 64, 0, 0, 0, 0, *[0.0] * 6)
        return add(b"CN", [following, 0, text, 0, 0, 0, 0, 0], data)

    rows, group = {1: TIME, 2: TIME[::10]}, 0
    names = {1: "pos", 2: "force"}
    for number in (2, 1):
        first = channel("time", channel(names[number], 0, 0, 8), 2, 0)
        data = struct.pack("<QQHHIII", number, len(rows[number]), bus_flag, 0, 0, 16, 0)
        group = add(b"CG", [group, first, 0, 0, 0, 0], data)
    records = b""
    for k, time in enumerate(TIME):
        records += struct.pack("<Bdd", 1, time, np.sin(time))
        if k % 10 == 0:
            records += struct.pack("<Bdd", 2, time, np.cos(time))
    data_group = add(b"DG", [0, group, add(b"DT", [], records), 0], b"\1".ljust(8, b"\0"))
    history = add(b"FH", [0, 0], struct.pack("<QhhB3x", 0, 0, 0, 0))
    header = block(b"HD", [data_group, history, 0, 0, 0, 0], struct.pack("<QhhBBBBdd", 0, 0, 0, 0, 0, 0, 0, 0.0, 0.0))
    content[64 : 64 + len(header)] = header
    path.write_bytes(content)
    return path


def test_rows_in_the_order_in_which_they_came_are_sorted(tmp_path: Path) -> None:
    path = unsorted(tmp_path / "logger.mf4")
    np.testing.assert_array_equal(values(path, "pos")[1], POSITION)
    channel, force, time = values(path, "force")
    assert channel.rows == len(TIME[::10])
    np.testing.assert_array_equal(force, FORCE[::10])
    np.testing.assert_array_equal(time, TIME[::10])
    read, refused = check_damaged(path, path.read_bytes(), 60)
    assert read
    assert refused


def test_messages_of_a_bus_are_left_to_those_who_know_them(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no channels to read: it holds messages of a bus, not signals"):
        open_recording(unsorted(tmp_path / "can.mf4", bus_flag=2))


# --- groups and names -------------------------------------------------------------------------------------------------


def test_a_name_twice_matters_only_where_it_is_asked_for(tmp_path: Path) -> None:
    twice = [[signal("status", TIME + k)] for k in (1, 2)]
    path = write(tmp_path / "a.mf4", plain(), *twice)
    assert len(import_by(tmp_path, path)["time_s"]) == ROWS
    ambiguous = MAP.replace('from = "pos"', 'from = "status"')
    assert "has 2 columns 'status'; ask for one by `from`: 'group 2/status', 'group 3/status'" in refusal(
        tmp_path, path, ambiguous
    )
    run = import_by(tmp_path, path, MAP.replace('from = "pos"', 'from = "group 3/status"'))
    np.testing.assert_array_equal(run["position_m"], TIME + 2)


def test_a_name_twice_in_one_group_has_two_paths(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", [signal("x", TIME), signal("x", 2 * TIME)])
    recording = open_recording(path)
    assert len({channel.path for channel in recording.channels}) == len(recording.channels) == 3
    np.testing.assert_array_equal([s.values[1] for s in recording.read(recording.channels[1:])], [0.01, 0.02])


def test_groups_of_two_rates_are_joined_where_a_rate_is_given(tmp_path: Path) -> None:
    slow = TIME[::10]
    path = write(tmp_path / "a.mf4", [signal("pos", POSITION, unit="m")], [signal("force", slow, slow, unit="N")])
    assert "set resample_hz in [file] to join them" in refusal(tmp_path, path)
    run = import_by(tmp_path, path, "[file]\nresample_hz = 100.0\n" + MAP)
    np.testing.assert_allclose(run["motor_force_n"], run["time_s"], atol=1e-9)
    first = open_recording(path).channels
    assert [channel.raster for channel in first] == ["group 1", "group 1", "group 2", "group 2"]
    assert first[3].rate_hz == pytest.approx(10.0)
    assert (first[3].start_s, first[3].end_s) == (0.0, pytest.approx(2.9))


def test_only_the_channels_asked_for_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    path = write(tmp_path / "a.mf4", [*plain(), signal("other", TIME)], [signal("more", TIME)])
    recording = open_recording(path)
    original = MDF.get

    def get(self: MDF, *args: Any, **options: Any) -> Any:
        read.append(self.groups[options["group"]].channels[options["index"]].name)
        return original(self, *args, **options)

    monkeypatch.setattr(MDF, "get", get)
    recording.read([choose_channel(path, recording.channels, "pos")])
    assert sorted(read) == ["pos", "time"]


# --- units and masters ------------------------------------------------------------------------------------------------


def test_the_files_own_units_count_and_are_told(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", [signal("pos", POSITION, unit="mm"), signal("force", FORCE, unit="kN")])
    run = import_by(tmp_path, path)
    np.testing.assert_allclose(run["position_m"], 1e-3 * POSITION)
    np.testing.assert_allclose(run["motor_force_n"], 1e3 * FORCE)
    assert "pos: the file says mm, the map m; the file's unit counts" in run.metadata["import"]["done"]


@pytest.mark.parametrize("version", ["4.10", "3.30"])
@pytest.mark.parametrize(("unit", "per_second"), [("ms", 1e3), ("us", 1e6), ("s", 1.0), ("", 1.0), ("ticks", 1.0)])
def test_a_time_master_in_another_unit_becomes_seconds(
    tmp_path: Path, version: str, unit: str, per_second: float
) -> None:
    with MDF(version=version) as mdf:
        mdf.append([signal("pos", POSITION, per_second * TIME, unit="m")])
        master = mdf.groups[0].channels[0]
        if version == "4.10":
            master.unit = unit
        else:
            master.conversion.unit, master.conversion.unit_field = unit, unit.encode().ljust(20, b"\0")
        path = Path(mdf.save(tmp_path / "a.mf4"))
    channel, axis, time = values(path, "time_s")
    assert (channel.kind, channel.unit) == ("time", "s")
    np.testing.assert_allclose(axis, TIME, rtol=1e-12)
    np.testing.assert_array_equal(axis, time)
    told = " ".join(open_recording(path).notes)
    assert ("converted to seconds" in told) == (unit in ("ms", "us"))
    assert ("unknown unit 'ticks'; taken as seconds" in told) == (unit == "ticks")


@pytest.mark.parametrize(("kind", "unit"), [(2, "rad"), (3, "m"), (4, "1")])
@pytest.mark.parametrize("written", ["", "rad", "m"])
def test_a_master_that_counts_something_else_is_never_a_time(
    tmp_path: Path, kind: int, unit: str, written: str
) -> None:
    with MDF(version="4.10") as mdf:
        mdf.append([signal("pos", POSITION, master=("time", kind)), signal("force", FORCE)], common_timebase=True)
        mdf.groups[0].channels[0].unit = written
        path = Path(mdf.save(tmp_path / "a.mf4"))
    assert values(path, "pos")[2] is None
    clock = next(c for c in open_recording(path).channels if c.name == "time")
    assert (clock.kind, clock.unit) == ("number", written or unit)
    assert "cannot be converted into 's'" in refusal(tmp_path, path, MAP.replace('from = "time_s"', 'from = "time"'))
    assert "no column 'time_s'" in refusal(tmp_path, path)


def test_rows_over_an_angle_take_a_time_of_their_group(tmp_path: Path) -> None:
    angle = np.cumsum(1.0 + TIME)
    group = [signal("pos", POSITION, angle, master=("angle", 2), unit="m"), signal("clock", TIME, angle, unit="s")]
    path = write(tmp_path / "a.mf4", [*group, signal("force", FORCE, angle, unit="N")])
    run = import_by(tmp_path, path, MAP.replace('from = "time_s"', 'from = "clock"'))
    np.testing.assert_array_equal(run["time_s"], TIME)


def test_a_scaled_time_reaches_every_raster(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", [signal("pos", POSITION, unit="m")], [signal("force", TIME, TIME, unit="N")])
    text = "[file]\nresample_hz = 10.0\n" + MAP.replace('unit = "s"', 'unit = "s", scale = 10.0')
    run = import_by(tmp_path, path, text)
    np.testing.assert_allclose(run["motor_force_n"], run["time_s"] / 10.0, atol=1e-9)


# --- values -----------------------------------------------------------------------------------------------------------


def test_invalid_samples_are_no_numbers(tmp_path: Path) -> None:
    invalid = np.arange(ROWS) == 7
    path = write(tmp_path / "a.mf4", [signal("pos", np.arange(ROWS, dtype="i2"), invalidation_bits=invalid)])
    np.testing.assert_array_equal(np.isnan(values(path, "pos")[1]), invalid)


GEARS = {"val_0": 0, "text_0": b"neutral", "val_1": 1, "text_1": b"first", "val_2": 2, "text_2": b"second"}


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_numbers_with_words_are_a_status_with_its_raw_numbers(tmp_path: Path, version: str) -> None:
    gear = (np.arange(ROWS) // 100).astype("u1")
    path = write(tmp_path / "a.mf4", [signal("gear", gear, conversion=GEARS, unit="km/h")], version=version)
    channel, read, _ = values(path, "gear")
    assert (channel.kind, channel.unit) == ("status", "1")
    np.testing.assert_array_equal(read, gear)
    text = '[columns]\ntime_s = { from = "time" }\ngear_1 = { from = "gear", unit = "1" }\n'
    run = import_by(tmp_path, path, "[file]\nresample_hz = 250.0\n" + text)
    assert set(run["gear_1"]) == {0.0, 1.0, 2.0}  # held, not interpolated


def test_words_beside_numbers_are_no_numbers(tmp_path: Path) -> None:
    raw = np.arange(ROWS, dtype="u2")
    conversion = {
        "lower_0": 0, "upper_0": 249, "text_0": conversion_utils.from_dict({"a": 0.5, "b": -40.0}),
        "lower_1": 250, "upper_1": 65535, "text_1": b"error",
    }  # fmt: skip
    path = write(tmp_path / "a.mf4", [signal("oil", raw, conversion=conversion, unit="degC")])
    channel, read, _ = values(path, "oil")
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
    path = write(tmp_path / "a.mf4", [signal("x", raw, conversion=conversion)], version=version)
    np.testing.assert_allclose(values(path, "x")[1], expected(raw.astype(float)), rtol=1e-12)


@pytest.mark.parametrize(
    "formula", ["__import__('os').system('true')", "X.real", "9**9**9**9**", "open", "X if X else 1", "("]
)
def test_a_formula_is_never_run_as_code(formula: str) -> None:
    with pytest.raises(ValueError, match="is not known"):
        compute(formula, TIME)


def test_a_power_in_a_formula_ends() -> None:
    assert np.isinf(compute("9**9**9**9", TIME)).all()


def test_text_arrays_and_messages_are_told(tmp_path: Path) -> None:
    text = signal("remark", np.array([b"ok"] * ROWS), encoding="utf-8")
    field = Signal(np.rec.fromarrays([np.ones((ROWS, 3))], dtype=[("map", "<f8", (3,))]), TIME, name="map")
    path = write(tmp_path / "a.mf4", [*plain(), text], [field])
    recording = open_recording(path)
    kinds = {channel.name: channel.kind for channel in recording.channels}
    assert kinds["remark"] == "text"
    assert "map" not in kinds
    assert "left out as arrays or structures: map" in recording.notes
    assert "holds text; allowed are" in refusal(tmp_path, path, MAP.replace('from = "pos"', 'from = "remark"'))


# --- damage -----------------------------------------------------------------------------------------------------------


def field_of(content: bytearray, block: bytes, offset: int) -> int:
    """Place of the data of the first `block`, and from there `offset`."""
    at = content.index(block)
    (links,) = struct.unpack_from("<Q", content, at + 16)
    return at + 24 + 8 * links + offset


def test_rows_that_are_not_there_are_told(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", plain())
    content = bytearray(path.read_bytes())
    struct.pack_into("<Q", content, field_of(content, b"##CG", 8), 10**12)
    path.write_bytes(content)
    assert "1e+12 rows" in refusal(tmp_path, path)
    struct.pack_into("<Q", content, field_of(content, b"##CG", 8), ROWS + 1)
    path.write_bytes(content)
    assert "has 301 rows of 24 bytes by its header, and 7200 bytes of data" in refusal(tmp_path, path)


def test_blocks_in_a_circle_end(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", plain())
    content = bytearray(path.read_bytes())
    for block in (b"##CN", b"##CG", b"##DG"):
        damaged = bytearray(content)
        at = damaged.index(block)
        struct.pack_into("<Q", damaged, at + 24, at)  # the next one is itself
        path.write_bytes(damaged)
        assert "its blocks form a circle" in refusal(tmp_path, path)


def test_blocks_of_mdf_3_in_a_circle_end(tmp_path: Path) -> None:
    path = write(tmp_path / "a.dat", plain(), version="3.30")
    content = bytearray(path.read_bytes())
    at = struct.unpack_from("<I", content, 68)[0]  # the first data group
    struct.pack_into("<I", content, at + 4, at)
    path.write_bytes(content)
    assert "its blocks form a circle" in refusal(tmp_path, path)


def test_compressed_data_that_grow_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", plain(), compression=1)
    content = bytearray(path.read_bytes())
    size_at = field_of(content, b"##DZ", 8)
    (packed_size,) = struct.unpack_from("<Q", content, size_at + 8)
    packed = zlib.compress(bytes(40 * packed_size))
    assert len(packed) < packed_size
    content[size_at + 16 : size_at + 16 + len(packed)] = packed
    path.write_bytes(content)
    assert "its compressed data at byte" in refusal(tmp_path, path)
    struct.pack_into("<Q", content, size_at, 1 << 40)
    path.write_bytes(content)
    assert "are said to become 1099511627776" in refusal(tmp_path, path)


def test_a_channel_outside_of_its_record_is_left_out(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mf4", plain())
    content = bytearray(path.read_bytes())
    last = content.rindex(b"##CN")
    (links,) = struct.unpack_from("<Q", content, last + 16)
    struct.pack_into("<I", content, last + 24 + 8 * links + 4, 1_000_000)  # its place in the record
    path.write_bytes(content)
    assert any(note.startswith("left out as outside of its record") for note in open_recording(path).notes)


@pytest.mark.parametrize(("version", "compression"), [("4.10", 0), ("4.10", 2), ("3.30", 0)])
def test_damaged_files_are_read_or_refused_in_a_sentence(
    tmp_path: Path, version: str, compression: int, capfd: pytest.CaptureFixture[str]
) -> None:
    gear = signal("gear", np.arange(ROWS, dtype="u1") % 3, conversion=GEARS)
    path = write(tmp_path / "a.mf4", [*plain(), gear], [signal("more", TIME)], version=version, compression=compression)
    read, refused = check_damaged(path, path.read_bytes(), 60)
    assert read
    assert refused
    assert capfd.readouterr() == ("", "")


# --- the field cases, where they are beside the checkout ----------------------------------------------------------------

FIELD_CASES = needs.FIELD_CASES / "mf4"


@pytest.mark.needs("field cases")
@pytest.mark.parametrize(
    "name", ["OK.MF4", "ok.mdf", "inca.dat", "unfin.mf4", "dup_name.mf4", "units.mf4", "two_rasters.mf4"]
)
@pytest.mark.parametrize("map_name", ["m", "mt"])
def test_field_cases_are_read(name: str, map_name: str) -> None:
    run = load_map(str(FIELD_CASES / f"{map_name}.toml")).read(FIELD_CASES / name)
    np.testing.assert_allclose(run["time_s"], 0.01 * np.arange(300), atol=1e-12)
    np.testing.assert_allclose(run["position_m"], np.sin(3.0 * run["time_s"]), atol=1e-12)
    np.testing.assert_allclose(run["motor_force_n"], np.cos(3.0 * run["time_s"]), atol=1e-12)


@pytest.mark.needs("field cases")
def test_field_case_of_two_groups_is_joined_where_a_rate_is_given() -> None:
    with pytest.raises(InputError, match="set resample_hz"):
        load_map(str(FIELD_CASES / "m.toml")).read(FIELD_CASES / "two_groups_us.mf4")
    assert len(load_map(str(FIELD_CASES / "mrs.toml")).read(FIELD_CASES / "two_groups_us.mf4")["time_s"]) == 299
