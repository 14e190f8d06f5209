"""A log of version 1 of the database is replayed: its commands are compared to the bit, its defects are counted."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from protocols.can.frames import DBC_1, load_frames
from protocols.files.bus_logs.version_1 import NOTE
from rt_controller.loop.bench_log import Log
from rt_controller.loop.node import ControllerNode
from rt_controller.loop.replay import Answers, answer_log
from tests.rt_controller.bus_log import write_log, write_log_of_version_1

SECONDS = 2.0
CYCLES = round(1000 * SECONDS)
SETPOINT, VALVE = (load_frames(DBC_1)[name] for name in ("TORQUE_SETPOINT", "VALVE_COMMAND"))


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    path = tmp_path_factory.mktemp("old") / "bus.log"
    write_log_of_version_1(path, SECONDS)
    return path.read_text().splitlines(keepends=True)


def replay(tmp_path: Path, lines: list[str], exact: bool = True) -> tuple[Log, Answers]:
    path = tmp_path / "bus.log"
    path.write_text("".join(lines))
    log = Log(path, exact=exact)
    return log, answer_log(log, ControllerNode(log.rate))


def change_data(line: str, change: Callable[[bytes], bytes]) -> str:
    head, _, rest = line.partition("#")
    data, _, end = rest.rstrip("\n").partition(" ")
    return f"{head}#{change(bytes.fromhex(data)).hex().upper()}{' ' + end if end else ''}\n"


def find(lines: list[str], can_id: str) -> list[int]:
    return [number for number, line in enumerate(lines) if f" {can_id}#" in line]


def test_every_answer_is_the_logged_one_and_the_version_is_told(tmp_path: Path, lines: list[str]) -> None:
    log, answers = replay(tmp_path, lines)
    assert answers.cycles == answers.logged == answers.equal == CYCLES
    assert log.notes == [NOTE]
    assert log.defects == ""


def test_its_answers_are_those_of_the_same_log_of_version_2(tmp_path: Path, lines: list[str]) -> None:
    _, answers = replay(tmp_path, lines)
    write_log(tmp_path / "new.log", SECONDS)
    new = Log(tmp_path / "new.log")
    assert new.notes == []
    assert answer_log(new, ControllerNode(new.rate)).digest == answers.digest


def flip_bit(data: bytes, bit: int) -> bytes:
    """A valve command with another bit of its voltage, or of its enable, where `bit` is 16."""
    raw = VALVE.raw(data)
    if bit < 16:
        raw = raw._replace(valve_voltage=raw.valve_voltage ^ 1 << bit)
    elif bit == 16:
        raw = raw._replace(valve_enable=1 - raw.valve_enable)
    return VALVE.pack_raw(VALVE.read_counter(data), *raw)


def test_one_bit_of_a_logged_command_is_a_difference(tmp_path: Path, lines: list[str]) -> None:
    changed, bits = list(lines), range(17)
    for number, bit in zip(find(lines, "080")[900:1750:50], bits, strict=True):
        changed[number] = change_data(lines[number], partial(flip_bit, bit=bit))
    _, answers = replay(tmp_path, changed)
    assert answers.logged == CYCLES
    assert answers.logged - answers.equal == len(bits)


def test_lost_corrupt_repeated_and_short_frames_are_counted(tmp_path: Path, lines: list[str]) -> None:
    encoders, changed = find(lines, "101"), list(lines)
    for number in encoders[100:300:20]:
        changed[number] = ""
    for number in encoders[400:700:20]:
        changed[number] = change_data(lines[number], lambda data: bytes((data[0] ^ 1,)) + data[1:])
    for number in encoders[800:1000:20]:
        changed[number] = change_data(lines[number], lambda data: data[:-1])
    for number in encoders[1100:1400:20]:
        changed[number] = lines[number] * 2
    log, answers = replay(tmp_path, changed)
    sentence = log.document
    assert (sentence["lost"], sentence["corrupt"], sentence["misshapen"], sentence["repeated"]) == (10, 15, 10, 15)
    assert (sentence["conflicting"], sentence["wrong_sequence"]) == (0, 0)
    assert answers.equal < answers.logged


def test_smaller_steps_of_set_points_are_kept_or_told(tmp_path: Path, lines: list[str]) -> None:
    """The torque demand is 4 mNm higher where it is not 0: less than half a step of version 2."""
    changed = list(lines)
    for number in find(lines, "180"):

        def change(data: bytes) -> bytes:
            raw = SETPOINT.raw(data)
            more = 4 * (raw.torque_demand > 0)
            return SETPOINT.pack_raw(SETPOINT.read_counter(data), *raw._replace(torque_demand=raw.torque_demand + more))

        changed[number] = change_data(lines[number], change)
    as_before, exact = replay(tmp_path, lines)[1], replay(tmp_path, changed)[1]
    assert exact.digest != as_before.digest
    log, rounded = replay(tmp_path, changed, exact=False)
    assert rounded.digest == as_before.digest
    assert log.notes == [f"{NOTE}, whose set-points have larger steps: answers can differ by them"]
