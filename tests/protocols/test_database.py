"""A database that cannot carry the bench is refused by signal and reason; one that can is read, in any encoding."""

import json
import re
import subprocess
from pathlib import Path

import pytest

from protocols.can.bus_load import compute_bus_load, count_worst_bits
from protocols.can.database import read_database
from protocols.can.frames import DBC, DBC_1, list_other_frames, load_frames
from protocols.can.size import read_guard_values
from protocols.can.version import VERSION_2
from protocols.errors import InputError
from rt_controller.guard.layout import check_layout
from tests.processes import list_errors, play_here

TEXT = DBC.read_text(encoding="utf-8")
MUXED = """
BO_ 1500 LOGGER_PAGE: 8 SUPERVISOR
 SG_ PAGE M : 0|4@1+ (1,0) [0|15] ""  PLANT
 SG_ LEVEL m0 : 8|16@0- (0.5,1) [0|0] "V"  PLANT
 SG_ CURRENT m1 : 8|16@1+ (1,0) [0|0] "A"  PLANT
"""


def write_database(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "other.dbc"
    path.write_bytes(text.encode(encoding))
    return path


def change_text(old: str, new: str) -> str:
    assert TEXT.count(old) == 1
    return TEXT.replace(old, new)


def move_signal(old: int, new: int) -> str:
    return re.sub(rf"(BO_ |SG_ |VAL_ ){old} ", rf"\g<1>{new} ", TEXT)


UNUSABLE = {
    "another unit": (
        re.sub(r'( SG_ CLUTCH_TORQUE .*\] )"Nm"', r'\1"lbf"', TEXT),
        "frame ANALOG_SENSORS: signal CLUTCH_TORQUE is in 'lbf'; the bench needs Nm",
    ),
    "another temperature": (
        TEXT.replace('"degC"', '"K"'),
        "frame ANALOG_SENSORS: signal OIL_TEMPERATURE is in 'K'; the bench needs degC",
    ),
    "one identifier twice": (
        move_signal(257, 256),
        "the frames ANALOG_SENSORS, ENCODER have the same identifier, 0x100",
    ),
    "the identifier of a foreign message": (
        TEXT + MUXED.replace("1500", "256"),
        "the frames ANALOG_SENSORS, LOGGER_PAGE have the same identifier, 0x100",
    ),
    "a frame twice": (
        TEXT + '\nBO_ 1501 ENCODER: 8 PLANT\n SG_ X : 0|8@1+ (1,0) [0|0] "" PLANT\n',
        "the frame ENCODER occurs 2 times",
    ),
    "factor 0": (
        change_text("(0.0048828125,0)", "(0,0)"),
        "frame ANALOG_SENSORS: signal CYLINDER_PRESSURE has the factor 0",
    ),
    "extended identifier": (
        move_signal(256, 2147483904),
        "frame ANALOG_SENSORS has an extended identifier, 0x00000100",
    ),
    "missing signal": (
        re.sub(r" SG_ CLUTCH_TORQUE.*\n", "", TEXT).replace("CM_ SG_ 256 CLUTCH_TORQUE", "CM_ SG_ 256 OIL_TEMPERATURE"),
        "frame ANALOG_SENSORS lacks the signal CLUTCH_TORQUE",
    ),
    "renamed signal": (
        TEXT.replace("CYLINDER_PRESSURE", "CYL_P"),
        "lacks the signal CYLINDER_PRESSURE; it has CYL_P instead",
    ),
    "overlap": (
        change_text("OIL_TEMPERATURE : 36|12", "OIL_TEMPERATURE : 35|12"),
        "OIL_TEMPERATURE and CYLINDER_PRESSURE are overlapping",
    ),
    "range too small": (
        change_text("SPEED_DEMAND : 32|16@1-", "SPEED_DEMAND : 32|12@1-"),
        "frame MOTOR_COMMAND: signal SPEED_DEMAND reaches from -2.048 to 2.047 rad/s; the bench needs -26.2 to 26.2",
    ),
    "no sign": (
        change_text("MOTOR_TORQUE : 52|12@1-", "MOTOR_TORQUE : 52|12@1+"),
        "signal MOTOR_TORQUE reaches from 0 to 99.9756 Nm",
    ),
    "byte order": (
        change_text("CLUTCH_TORQUE : 48|16@1-", "CLUTCH_TORQUE : 55|16@0-"),
        "signal CLUTCH_TORQUE must be a plain little-endian integer",
    ),
    "multiplexed frame of ours": (
        change_text("REQUEST : 24|3@1+", "REQUEST M : 24|3@1+").replace(
            "TORQUE_DEMAND : 27|", "TORQUE_DEMAND m0 : 27|"
        ),
        "frame TORQUE_SETPOINT: signal REQUEST is multiplexed",
    ),
    "UTF-16 cut in a character": (TEXT, "begins like utf-16 but is not valid: save it as UTF-8"),
}


@pytest.mark.parametrize(("text", "words"), UNUSABLE.values(), ids=UNUSABLE)
def test_what_cannot_carry_the_bench_is_refused_by_signal_and_reason(
    tmp_path: Path, request: pytest.FixtureRequest, text: str, words: str
) -> None:
    path = write_database(tmp_path, text)
    if "UTF-16" in request.node.name:
        path.write_bytes(b"\xff\xfe" + text.encode("utf-16-le")[:-1])
    with pytest.raises(InputError) as refused:
        load_frames(path)
    assert words in str(refused.value)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
def test_the_encoding_of_a_dbc_does_not_matter(tmp_path: Path, encoding: str) -> None:
    text = TEXT.replace('"degC"', '"°C"').replace("\n", "\r\n")
    frames = load_frames(write_database(tmp_path, text, encoding))
    assert frames.keys() == load_frames().keys()
    units = {signal.name: signal.unit for signal in frames["ANALOG_SENSORS"].definitions}
    assert units["OIL_TEMPERATURE"] == "°C"


def test_messages_of_others_may_be_of_any_kind(tmp_path: Path) -> None:
    others = MUXED + '\nBO_ 2147484148 LONG: 64 SUPERVISOR\n SG_ X : 7|8@0+ (0,0) [0|0] ""  PLANT\n'
    path = write_database(tmp_path, TEXT + others)
    assert load_frames(path).keys() == load_frames().keys()
    assert [frame.name for frame in list_other_frames(path)] == ["LONG", "LOGGER_PAGE"]


# Frames and signals that databases of version 2 from before 26 November 2026 lack, and need not have
LATER: dict[str, set[str]] = {"SUPERVISOR_CLAIM": {"claim", "session"}, "CONTROLLER_HEARTBEAT": {"supervisor"}}


def test_frames_that_are_carried_are_those_of_our_database() -> None:
    ours = {name: set(codec.signals) - LATER.get(name, set()) for name, codec in load_frames().items()}
    carried = {name: {signal.lower() for signal in ranges} for name, ranges in VERSION_2.carried.items()}
    assert {name: signals for name, signals in ours.items() if signals} == carried


def test_a_database_from_before_the_claims_is_used_as_then(tmp_path: Path) -> None:
    kept = re.sub(r"BO_ 368 .*\n( SG_.*\n)*|.* (BO_|SG_) 368 .*\n|VAL_ 368 .*\n", "", TEXT)
    path = write_database(tmp_path, re.sub(r".*( SG_ |1792 )SUPERVISOR .*\n", "", kept))
    frames = load_frames(path)
    assert "SUPERVISOR_CLAIM" not in frames
    assert "supervisor" not in frames["CONTROLLER_HEARTBEAT"].signals
    assert frames["TORQUE_SETPOINT"].pack(3, 1, 5.0) == load_frames()["TORQUE_SETPOINT"].pack(3, 1, 5.0)
    check_layout(path, frames, read_guard_values(DBC))


def test_numbers_with_names_are_in_the_range_that_a_database_needs() -> None:
    for message in read_database(DBC).messages:
        for signal in message.signals:
            if signal.choices and signal.name.lower() not in LATER.get(message.name, ()):
                assert VERSION_2.carried[message.name][signal.name][1] == max(map(int, signal.choices))


def test_an_extended_identifier_takes_20_bits_more_and_their_stuffing() -> None:
    assert count_worst_bits(8, extended=True) == 160  # Davis et al. 2007, after eq. 4: 160 bits with 8 bytes
    assert count_worst_bits(8) == 135


def run_frames(path: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return play_here("frames", "--dbc", path, *arguments)


def test_a_load_without_cycle_times_is_unknown(tmp_path: Path) -> None:
    path = write_database(tmp_path, re.sub(r"BA_.*GenMsgCycleTime.*\n", "", TEXT))
    done = run_frames(path)
    assert done.returncode == 1
    assert "verdict: load unknown: 10 of 10 frames have no cycle time" in done.stdout
    assert "% bus load" not in done.stdout
    sentence = json.loads(run_frames(path, "--json").stdout)
    assert sentence["load"] is None
    assert sentence["fits"] == []
    assert len(sentence["without_cycle_time"]) == 10


def test_a_database_of_version_1_is_listed_and_told_not_to_be_what_the_bench_sends() -> None:
    done = run_frames(DBC_1)
    assert done.returncode == 0
    assert "note:    a database of version 1" in done.stdout
    assert "the bench sends version 2" in done.stdout
    assert [json.loads(run_frames(path, "--json").stdout)["version"] for path in (DBC_1, DBC)] == [1, 2]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (' SG_ CRC : 0|8@1+ (1,0) [0|255] ""  PLANT\n', "", "frame VALVE_COMMAND needs the signal CRC : 0|8@1+"),
        ("VALVE_COMMAND: 6", "VALVE_COMMAND: 9", "frame VALVE_COMMAND has 9 bytes; allowed are 2 to 8"),
        ("SAMPLE_TICK : 48|16@1+", "SAMPLE_TICK : 48|10@1+", "reaches from 0 to 1023; the bench needs 0 to 65535"),
        ("MOTOR_TORQUE : 36|12@1- ", "MOTOR_TORQUE : 36|12@1+ ", "signal MOTOR_TORQUE reaches from 0 to 99.9756 Nm"),
    ],
)
def test_a_database_of_version_1_is_judged_by_version_1(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = DBC_1.read_text(encoding="utf-8")
    assert old in text
    with pytest.raises(InputError) as refused:
        load_frames(write_database(tmp_path, text.replace(old, new, 1)))
    assert words in str(refused.value)


def test_messages_of_others_count_in_the_load_where_they_have_a_cycle_time(tmp_path: Path) -> None:
    path = write_database(tmp_path, TEXT + MUXED + 'BA_ "GenMsgCycleTime" BO_ 1500 10;\n')
    done = run_frames(path, "--json")
    assert done.returncode == 0
    sentence = json.loads(done.stdout)
    ours = compute_bus_load(load_frames().values(), 1000, 500_000)
    assert sentence["load"]["500000"] == pytest.approx(ours + 100 * 135 / 500_000, rel=1e-12)
    assert sentence["not_counted"] == []
    sentence = json.loads(run_frames(write_database(tmp_path, TEXT + MUXED), "--json").stdout)
    assert sentence["not_counted"] == ["LOGGER_PAGE"]


def test_an_unusable_dbc_ends_the_command_with_one_sentence(tmp_path: Path) -> None:
    done = run_frames(write_database(tmp_path, move_signal(257, 256)))
    assert done.returncode == 2
    (line,) = list_errors(done.stderr)
    assert line.startswith("error: DBC ")
    assert "0x100" in line
