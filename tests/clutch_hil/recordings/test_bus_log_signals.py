"""Bus logs as recordings: signals are those of cantools; what carries none is left out and told."""

import math
import random
import struct
from pathlib import Path
from typing import Any

import can
import cantools.database
import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.logged_frames import CAR
from clutch_hil.command import make_application
from clutch_hil.recordings.can_signals import find_rows_with_signal, read_physical_values
from clutch_hil.recordings.channel import Recording, choose_channel
from clutch_hil.recordings.foreign import NEEDS_DATABASE
from clutch_hil.recordings.format import open_recording
from clutch_hil.recordings.import_map import load_map
from clutch_hil.recordings.value_tables import list_missing
from protocols.can.database import read_database
from protocols.errors import InputError
from protocols.files.runs import read_columns
from tests.clutch_hil.recordings.bus_logs import (
    ANALOG,
    START,
    format_candump,
    make_bench_messages,
    make_message,
    read_frames,
    write,
)


def write_car_log(folder: Path) -> tuple[Path, list[can.Message]]:
    """A log and a database of a car, with random payloads."""
    (folder / "car.dbc").write_text(CAR, encoding="cp1252")
    random_bytes = random.Random(1)
    messages = []
    for n in range(300):
        messages.append(make_message(START + n * 0.01, 291, random_bytes.randbytes(8)))
        page = bytes((n % 3,)) + random_bytes.randbytes(7)
        messages.append(make_message(START + n * 0.01 + 0.001, 2566844926 & 0x1FFFFFFF, page, is_extended_id=True))
    path = folder / "car.log"
    with can.Logger(path) as writer:
        for one in messages:
            writer(one)
    return path, messages


def read_values(recording: Recording, path: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    (signal,) = recording.read([choose_channel(path, recording.channels, name)])
    assert signal.time is not None
    return signal.time, signal.values


def test_signals_are_those_of_cantools(tmp_path: Path) -> None:
    path, messages = write_car_log(tmp_path)
    database: Any = cantools.database.load_string(CAR, "dbc")
    recording = open_recording(path, {"dbc": str(tmp_path / "car.dbc")})
    expected: dict[str, list[tuple[float, float]]] = {}
    for one in messages:
        definition = database.get_message_by_frame_id(one.arbitration_id)
        decoded = (
            definition.decode(one.data, decode_choices=False, allow_truncated=False)
            if one.data[0] % 16 < 2 or not one.is_extended_id
            else {"PAGE": one.data[0] & 15}
        )
        for name, value in decoded.items():
            expected.setdefault(f"{definition.name}.{name}", []).append((one.timestamp - START, value))
    assert {c.path for c in recording.channels if c.kind != "time"} == expected.keys()
    for name, pairs in expected.items():
        at, got = read_values(recording, path, name)
        assert np.allclose(at, [time for time, _ in pairs], atol=1e-6), name
        assert np.allclose(got, [value for _, value in pairs], rtol=1e-12, equal_nan=True), name


FLOATS = """VERSION ""
BU_: RIG
BO_ 512 SHAFT: 8 RIG
 SG_ TORQUE : 0|32@1- (1,0) [0|0] "Nm" RIG
 SG_ SPEED : 39|32@0- (0.5,3) [0|0] "rad/s" RIG
BO_ 513 OIL: 8 RIG
 SG_ PRESSURE : 0|64@1- (1,0) [0|0] "bar" RIG
SIG_VALTYPE_ 512 TORQUE : 1;
SIG_VALTYPE_ 512 SPEED : 1;
SIG_VALTYPE_ 513 PRESSURE : 2;
"""


def write_floats(folder: Path) -> Path:
    """A log whose signals are floats of 32 and 64 bits, and a map that names its database."""
    (folder / "rig.dbc").write_text(FLOATS)
    (folder / "opening.toml").write_text('[file]\ndbc = "rig.dbc"\n')
    torques = [20.0, -0.1, math.nan, math.inf, 1e-40, *map(float, range(100))]
    messages = []
    for n, torque in enumerate(torques):
        at = START + 0.01 * n
        messages.append(make_message(at, 512, struct.pack("<f", torque) + struct.pack(">f", 100.0 + n)))
        messages.append(make_message(at + 0.001, 513, struct.pack("<d", 2.5 + 1e-9 * n)))
    return write(folder / "rig.log", messages)


def test_floats_are_those_of_cantools(tmp_path: Path) -> None:
    path = write_floats(tmp_path)
    recording = open_recording(path, {"dbc": "rig.dbc"})
    torque, speed, pressure = (
        read_values(recording, path, f)[1] for f in ("SHAFT.TORQUE", "SHAFT.SPEED", "OIL.PRESSURE")
    )
    database: Any = cantools.database.load_string(FLOATS, "dbc")
    decoded = [database.decode_message(can_id, payload) for can_id, payload in read_frames(path)]
    assert np.array_equal(torque, [one["TORQUE"] for one in decoded if "TORQUE" in one], equal_nan=True)
    assert speed.tolist() == [one["SPEED"] for one in decoded if "SPEED" in one]
    assert pressure.tolist() == [one["PRESSURE"] for one in decoded if "PRESSURE" in one]


def test_a_map_of_the_file_alone_lists_and_drafts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_floats(tmp_path)
    monkeypatch.chdir(tmp_path)

    def play(*words: str) -> str:
        answer = CliRunner().invoke(make_application(), ["import", *words])
        return str(answer.exception) if answer.exception else answer.stdout

    opening = ("rig.log", "--map", "opening.toml")
    assert NEEDS_DATABASE in play("--list", "rig.log")
    assert "OIL.PRESSURE" in play("--list", *opening)
    assert "map with 4 columns" in play("--draft", *opening)
    assert "has no column time_s" in play(*opening, "--out", "run.csv")
    assert "wrote:   run.csv" in play("rig.log", "--map", "rig.toml", "--out", "run.csv")
    assert read_columns(tmp_path / "run.csv")["oil_pressure_bar"] == pytest.approx(2.5)


def test_channels_say_what_the_database_says(tmp_path: Path) -> None:
    path, _ = write_car_log(tmp_path)
    recording = open_recording(path, {"dbc": "car.dbc"})  # beside the log
    by_path = {channel.path: channel for channel in recording.channels}
    assert (by_path["ENGINE.COOLANT"].unit, by_path["ENGINE.SPEED"].unit) == ("°C", "rpm")
    assert [by_path[f"ENGINE.{name}"].kind for name in ("SPEED", "GEAR", "BRAKE")] == ["number", "status", "status"]
    assert by_path["PAGES.CURRENT"].raster == by_path["PAGES.POWER"].raster != by_path["PAGES.PAGE"].raster
    assert by_path["PAGES.VOLTAGE"].rows == 100
    assert by_path["ENGINE.time"].kind == "time"
    assert by_path["ENGINE.SPEED"].rate_hz == pytest.approx(100.0, rel=1e-6)
    assert recording.start.startswith("2023-11-14T22:13:20")


@pytest.mark.parametrize("length", range(1, 65))
def test_every_length_and_byte_order_is_that_of_cantools(length: int) -> None:
    generator = np.random.default_rng(length)
    payloads = generator.integers(0, 256, (50, 8), np.uint8)
    for order in (1, 0):
        for sign in "+-":
            start = int(generator.integers(0, 65 - length)) if order else 7
            text = f'VERSION ""\nBO_ 1 M: 8 E\n SG_ S : {start}|{length}@{order}{sign} (0.5,-3) [0|0] "" E\n'
            database: Any = cantools.database.load_string(text, "dbc")
            (definition,) = database.messages
            wanted = [definition.decode(bytes(row))["S"] for row in payloads]
            assert np.allclose(read_physical_values(definition.signals[0], payloads), wanted, rtol=1e-12)
            assert find_rows_with_signal(definition, definition.signals[0], payloads).all()


def test_a_map_makes_a_run_of_a_bus_log(tmp_path: Path) -> None:
    path = write(tmp_path / "bus.blf", make_bench_messages(500))
    (tmp_path / "m.toml").write_text(
        '[file]\nresample_hz = 100.0\n[columns]\ntime_s = { from = "ANALOG_SENSORS.time" }\n'
        'cylinder_pressure_bar = { from = "ANALOG_SENSORS.CYLINDER_PRESSURE" }\n'
        'shaft_angle_rad = { from = "ENCODER.SHAFT_ANGLE" }\n'
    )
    run = load_map(str(tmp_path / "m.toml")).read(path)
    at = run["time_s"]
    assert len(at) == 50
    assert np.allclose(run["cylinder_pressure_bar"][5:-5], 10.0 * at[5:-5], atol=0.02)
    assert np.allclose(run["shaft_angle_rad"][5:-5], at[5:-5] - 1e-4, atol=1e-4)


def test_a_channel_is_asked_for_where_two_have_messages(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    both = zip(
        format_candump(make_bench_messages()).splitlines(),
        format_candump(make_bench_messages(), "can1").splitlines(),
        strict=True,
    )
    path.write_text("".join(f"{a}\n{b}\n" for a, b in both))
    with pytest.raises(InputError, match=r"on 2 channels, can0, can1; write channel"):
        open_recording(path)
    with pytest.raises(InputError, match="has no channel 'can7'; it has can0, can1"):
        open_recording(path, {"channel": "can7"})
    recording = open_recording(path, {"channel": "can1"})
    assert choose_channel(path, recording.channels, "ENCODER.SHAFT_ANGLE").rows == 40
    assert any("took channel can1" in note for note in recording.notes)


def test_a_database_that_does_not_fit_is_told_with_the_identifiers_of_the_log(tmp_path: Path) -> None:
    path, _ = write_car_log(tmp_path)
    with pytest.raises(
        InputError, match=r"has no message of .*clutch_rig.dbc; its identifiers are 0x123, 0x18FEF1FE; name"
    ):
        open_recording(path)
    with pytest.raises(InputError, match=r"DBC no.dbc does not exist"):
        open_recording(path, {"dbc": "no.dbc"})


def test_frames_that_carry_nothing_are_left_out_and_told(tmp_path: Path) -> None:
    messages = make_bench_messages()
    messages[10].data = bytearray(b"\0" * 8)  # wrong CRC
    messages[20].data, messages[20].dlc = bytearray(b"\0" * 3), 3
    del messages[31]
    extra = [
        make_message(START + 0.5, ANALOG.can_id, b"", is_remote_frame=True, dlc=8),
        make_message(START + 0.6, 0x555, b"\1"),
    ]
    recording = open_recording(write(tmp_path / "bus.log", [*messages, *extra]))
    for words in (
        "left out 1 frame of ANALOG_SENSORS with a wrong CRC", "left out 1 frame of ANALOG_SENSORS: remote",
        "left out 1 frame of ANALOG_SENSORS with fewer than 8 bytes", "missing by the alive counters: 1 frame of ENCODER",
        "left out 1 frame that the database does not have: 0x555",
    ):  # fmt: skip
        assert any(words in note for note in recording.notes), (words, recording.notes)


NAMED = """VERSION ""
BO_ 256 ENG: 8 E
 SG_ Tmp : 0|8@1+ (1,-40) [-40|215] "degC" E
 SG_ Slip : 8|8@1- (1,0) [-128|127] "rpm" E
 SG_ Level : 16|8@1+ (0.5,0) [0|127.5] "" E
 SG_ Gear : 24|4@1+ (1,0) [0|15] "" E
 SG_ Mode : 28|4@1+ (1,0) [0|2] "-" E
 SG_ Valve : 32|2@1+ (10,0) [0|30] "%" E
 SG_ Pump : 40|8@1+ (5,0) [0|10] "%" E
VAL_ 256 Tmp 255 "SNA" 254 "ERR" 40 "Zero" 41 "No error" ;
VAL_ 256 Slip 127 "SignalNotAvailable" 128 "Init_Value" 0 "Standstill" ;
VAL_ 256 Level 255 "Reserved1" ;
VAL_ 256 Gear 0 "P" 15 "SNA" ;
VAL_ 256 Mode 0 "off" 3 "error" ;
VAL_ 256 Valve 0 "shut" 1 "low" 2 "high" 3 "error" ;
VAL_ 256 Pump 0 "off" 1 "half" 2 "full" ;
"""


def test_names_of_single_values_leave_a_number_and_say_what_is_no_value(tmp_path: Path) -> None:
    (tmp_path / "car.dbc").write_text(NAMED)
    rows = [(255, 0x7F), (254, 0x80), (40, 0), (41, 0x81), (42, 0xFF)]
    frames = [make_message(START + 0.1 * n, 256, bytes((t, s, 255, 0x3F, 3, 0, 0, 0))) for n, (t, s) in enumerate(rows)]
    path = write(tmp_path / "car.log", frames)
    recording = open_recording(path, {"dbc": "car.dbc"})
    kinds = {channel.name: channel.kind for channel in recording.channels if channel.kind != "time"}
    assert [kinds[f"ENG.{name}"] for name in ("Tmp", "Slip", "Level")] == ["number"] * 3
    assert [kinds[f"ENG.{name}"] for name in ("Gear", "Mode", "Valve", "Pump")] == ["status"] * 4
    assert recording.notes == ["signals by car.dbc"]
    nan = math.nan
    wanted = {"Tmp": [nan, nan, 0, 1, 2], "Slip": [nan, nan, 0, -127, -1], "Level": [nan] * 5,
              "Gear": [15] * 5, "Mode": [3] * 5, "Valve": [30] * 5}  # fmt: skip
    for name, values in wanted.items():
        np.testing.assert_array_equal(read_values(recording, path, f"ENG.{name}")[1], values)
    assert "ENG.Tmp: 2 samples without a value by the database: SNA, ERR" in recording.notes
    assert not any("Gear" in note or "Mode" in note or "Valve" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("SNA", True), ("sna", True), ("Signal not available", True), ("Not_Available", True), ("Invalid", True),
        ("ErrorIndicator", True), ("Fault", True), ("INIT", True), ("undefined", True), ("Reserved2", True), ("N/A", True),
        ("No error", False), ("fault free", False), ("Zero", False), ("Initial gear", False), ("Terrain", False),
        ("Nasal", False), ("off", False),
    ],
)  # fmt: skip
def test_names_that_say_that_there_is_no_value(name: str, expected: bool) -> None:
    text = NAMED.replace('"Zero"', f'"{name}"')
    database: Any = cantools.database.load_string(text, "dbc")
    assert (40 in list_missing(database.messages[0].get_signal_by_name("Tmp"))) is expected


def test_can_fd_frames_are_read_by_a_named_database_that_does_not_tell_them(tmp_path: Path) -> None:
    (tmp_path / "fd.dbc").write_text('VERSION ""\nBO_ 291 FDM: 64 E\n SG_ LAST : 496|16@1+ (0.001,0) [0|65] "V" E\n')

    def log(length: int, **kinds: Any) -> Path:
        data = bytes(62) + b"\x39\x30"
        frames = [make_message(START + 0.1 * n, 291, data[-length:], is_fd=True, **kinds) for n in range(3)]
        return write(tmp_path / "fd.log", frames)

    path = log(64)
    assert read_values(open_recording(path, {"dbc": "fd.dbc"}), path, "FDM.LAST")[1].tolist() == [12.345] * 3
    with pytest.raises(
        InputError,
        match=r"has messages of .*fd.dbc, and none that can be read: left out FDM.LAST: no frame has its bits",
    ):
        open_recording(log(32), {"dbc": "fd.dbc"})
    path.write_text("(1.0) can0 123#R8\n")
    with pytest.raises(InputError, match=r"and none that can be read: left out 1 frame of FDM: remote$"):
        open_recording(path, {"dbc": "fd.dbc"})


def test_can_fd_frames_are_none_of_the_bench(tmp_path: Path) -> None:
    messages = make_bench_messages()
    messages[0].is_fd = True
    assert "left out 1 frame of ANALOG_SENSORS: CAN FD" in open_recording(write(tmp_path / "a.log", messages)).notes
    for one in messages:
        one.is_fd = True
    with pytest.raises(
        InputError, match=r"none that can be read: left out 40 frames of ANALOG_SENSORS: CAN FD; left out"
    ):
        open_recording(write(tmp_path / "a.log", messages))


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log"])
def test_error_frames_are_told_as_such(tmp_path: Path, suffix: str) -> None:
    errors = [make_message(START + 0.5 + n, 0, b"", is_error_frame=True) for n in range(3)]
    recording = open_recording(write(tmp_path / f"bus{suffix}", [*make_bench_messages(), *errors]))
    assert "left out 3 error frames" in recording.notes
    assert not any("does not have" in note for note in recording.notes)
    with pytest.raises(InputError, match="it has error frames only"):
        open_recording(write(tmp_path / f"errors{suffix}", errors))


FOREIGN = """VERSION ""
BO_ 256 ENG: 8 E
 SG_ Rpm : 0|16@1+ (0.25,0) [0|0] "rpm" E
 SG_ Tmp : 8|8@1+ (1,-40) [0|0] "degC" E
 SG_ Far : 60|8@1+ (1,0) [0|0] "V" E
 SG_ Good : 16|8@1+ (1,0) [0|0] "bar" E
BO_ 257 MUX: 8 E
 SG_ Sel M : 0|8@1+ (1,0) [0|0] "" E
 SG_ A m0 : 8|16@1+ (1,0) [0|0] "bar" E
 SG_ B m1 : 8|16@1+ (1,0) [0|0] "bar" E
 SG_ C m1 : 16|16@1+ (1,0) [0|0] "bar" E
BO_ 258 SPLIT: 8 E
 SG_ Page M : 0|8@1+ (1,0) [0|0] "" E
 SG_ Raw : 4|8@1+ (1,0) [0|0] "" E
 SG_ D m0 : 16|16@1+ (1,0) [0|0] "bar" E
 SG_ Whole : 32|8@1+ (1,0) [0|0] "bar" E
VAL_ 256 Nope 0 "a;b" 1 "c" ;
VAL_ 256 Good 255 "SNA;" ;
SIG_VALTYPE_ 999 Nope : 1;
"""


def test_of_a_foreign_database_only_what_cannot_be_read_is_left_out(tmp_path: Path) -> None:
    (tmp_path / "car.dbc").write_text(FOREIGN)
    data = bytes((0, 1, 2, 3, 4, 0, 0, 0))
    path = write(tmp_path / "car.log", [make_message(START + 0.1 * n, 256 + n % 3, data) for n in range(9)])
    recording = open_recording(path, {"dbc": "car.dbc"})
    names = {channel.path for channel in recording.channels if channel.kind != "time"}
    assert names == {"ENG.Good", "MUX.Sel", "MUX.A", "SPLIT.Whole"}
    assert read_values(recording, path, "ENG.Good")[1].tolist() == [2] * 3
    assert read_values(recording, path, "MUX.A")[1].tolist() == [513] * 3
    for note in (
        "left out entries of car.dbc for signals that it does not have: VAL_ 256 Nope",
        "left out entries of car.dbc for signals that it does not have: SIG_VALTYPE_ 999 Nope",
        "left out ENG.Rpm: it overlaps with Tmp", "left out ENG.Tmp: it overlaps with Rpm",
        "left out ENG.Far: its bits are not in the frame", "left out MUX.B: it overlaps with C",
        "left out MUX.C: it overlaps with B", "left out SPLIT.Page: it overlaps with Raw",
        "left out SPLIT.D: Page, which selects it, is left out",
    ):  # fmt: skip
        assert note in recording.notes
    with pytest.raises(InputError, match="are overlapping in message ENG"):  # what drives a bus is as strict as it was
        read_database(tmp_path / "car.dbc")


def test_a_foreign_database_that_is_no_database_is_refused_as_before(tmp_path: Path) -> None:
    path, _ = write_car_log(tmp_path)
    for text in ("hello", CAR.replace("16|12@", "16|0@"), FOREIGN.replace("(0.25,0)", "(0.25")):
        (tmp_path / "car.dbc").write_text(text, encoding="cp1252")
        with pytest.raises(InputError, match=r"DBC .*car.dbc is malformed"):
            open_recording(path, {"dbc": "car.dbc"})


MULTIPLEXED = """VERSION ""
BU_: X
BO_ 256 M: 8 X
 SG_ MUX M : 0|8@1+ (1,0) [0|0] "" X
 SG_ A m0 : 8|8@1+ (1,0) [0|0] "" X
 SG_ B m1 : 16|8@1+ (1,0) [0|0] "" X
 SG_ C m2M : 24|8@1+ (1,0) [0|0] "" X
 SG_ D m3 : 32|8@1+ (1,0) [0|0] "" X
SG_MUL_VAL_ 256 D C 3-5;
"""


@pytest.mark.parametrize(("name", "values"), [("A", [10.0]), ("B", [20.0]), ("C", [4.0, 9.0]), ("D", [30.0])])
def test_signals_without_an_entry_of_their_own_belong_to_the_one_multiplexer(
    tmp_path: Path, name: str, values: list[float]
) -> None:
    (tmp_path / "mux.dbc").write_text(MULTIPLEXED)
    payloads = [[0, 10, 1, 1, 1], [1, 1, 20, 1, 1], [2, 1, 1, 4, 30], [2, 1, 1, 9, 1]]
    messages = [make_message(START + n, 256, bytes([*one, 0, 0, 0])) for n, one in enumerate(payloads)]
    recording = open_recording(write(tmp_path / "mux.log", messages), {"dbc": "mux.dbc"})
    (signal,) = recording.read([choose_channel(tmp_path, recording.channels, f"M.{name}")])
    assert list(signal.values) == values


def test_multiplexers_with_too_many_numbers_are_refused(tmp_path: Path) -> None:
    (tmp_path / "mux.dbc").write_text(MULTIPLEXED.replace("3-5", "0-4294967295"))
    with pytest.raises(InputError, match=r"SG_MUL_VAL_ of D and others have 4294967296 numbers.*allowed are 1000000"):
        read_database(tmp_path / "mux.dbc")
