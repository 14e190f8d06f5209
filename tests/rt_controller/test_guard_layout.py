"""The guard's own layout: the bits that its code reads are those of its table, and a database that has others is refused."""

import re
from pathlib import Path
from typing import Any

import cantools.database
import numpy as np
import pytest
from typer.testing import CliRunner

import rt_controller.guard.limits
from clutch_hil.command import make_application
from protocols.can.frames import DBC, DBC_1, load_frames
from protocols.errors import InputError
from rt_controller.guard.layout import LAYOUT, check_layout
from rt_controller.loop.node import ControllerNode
from tests.rt_controller.guard_bench import Bench, decode, make_frame, protect, read_data_id

TEXT = DBC.read_text(encoding="utf-8")
VALUES = {"motor_range": 65.536, "pressure_range": 10.0, "data_key": 0.0}  # Nm, bar: of the shipped limits


def write(folder: Path, *changes: tuple[str, str]) -> Path:
    """clutch_rig.dbc with each text of `changes`, which it has once, replaced by the other."""
    text = TEXT
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = folder / "other.dbc"
    path.write_text(text, encoding="utf-8")
    return path


def renumber(old: int, new: int) -> str:
    return re.sub(rf"(BO_ |SG_ |VAL_ ){old} ", rf"\g<1>{new} ", TEXT)


_TICK = '@1+ (1,0) [0|1023] ""  CONTROLLER'  # the rest of a line: two frames have a signal of that name
_SPEED = '@1- (0.001,0) [-32.768|32.767] "rad/s"  PLANT'
MOVED: dict[str, tuple[tuple[tuple[str, str], ...], str]] = {
    "pressure and temperature change places": (
        (
            ("CYLINDER_PRESSURE : 24|12@1- ", "CYLINDER_PRESSURE : 36|12@1- "),
            ("OIL_TEMPERATURE : 36|12@1- ", "OIL_TEMPERATURE : 24|12@1- "),
        ),
        "ANALOG_SENSORS.CYLINDER_PRESSURE is at 36|12; the guard's is at 24|12; "
        "ANALOG_SENSORS.OIL_TEMPERATURE is at 24|12; the guard's is at 36|12",
    ),
    "another factor of the pressure": (
        (("(0.0048828125,0) [-10|9.9951171875]", "(0.009765625,0) [-20|19.99]"),),
        "ANALOG_SENSORS.CYLINDER_PRESSURE has the factor 0.009765625 and offset 0; the guard's are 0.0048828125 and 0",
    ),
    "an offset of the temperature": (
        (("(0.09765625,0) [-200|199.90234375]", "(0.09765625,50) [-150|249.9]"),),
        "ANALOG_SENSORS.OIL_TEMPERATURE has the factor 0.09765625 and offset 50; the guard's are 0.09765625 and 0",
    ),
    "angle and tick change places": (
        (
            ("SHAFT_ANGLE : 24|18@1- ", "SHAFT_ANGLE : 34|18@1- "),
            (f" SG_ SAMPLE_TICK : 42|10{_TICK}", f" SG_ SAMPLE_TICK : 24|10{_TICK}"),
        ),
        "ENCODER.SHAFT_ANGLE is at 34|18; the guard's is at 24|18; ENCODER.SAMPLE_TICK is at 24|10; the guard's is at 42|10",
    ),
    "the limit of the motor before its speed": (
        (
            ("TORQUE_LIMIT : 48|16@1+ ", "TORQUE_LIMIT : 32|16@1+ "),
            (f"SPEED_DEMAND : 32|16{_SPEED}", f"SPEED_DEMAND : 48|16{_SPEED}"),
        ),
        "MOTOR_COMMAND.TORQUE_LIMIT is at 32|16; the guard's is at 48|16",
    ),
    "another factor of the motor's limit": (
        (("(0.001,0) [0|65.535]", "(0.002,0) [0|131.07]"),),
        "MOTOR_COMMAND.TORQUE_LIMIT has the factor 0.002 and offset 0; the guard's are 0.001 and 0, as guard.motor_range is"
        " 65.536 Nm",
    ),
    "another data ID": (
        (('BA_ "E2EDataId" BO_ 128 49280;', 'BA_ "E2EDataId" BO_ 128 49281;'),),
        "frame VALVE_COMMAND has the data ID 49281; the guard's is 49280",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "words"), MOVED.values(), ids=MOVED)
def test_a_database_that_the_guard_cannot_read_is_refused_by_signal(
    tmp_path: Path, changes: tuple[tuple[str, str], ...], words: str
) -> None:
    path = write(tmp_path, *changes)
    frames = load_frames(path)  # the bench itself could use it
    with pytest.raises(InputError) as refused:
        check_layout(path, frames, VALUES)
    assert words in str(refused.value)
    assert str(path) in str(refused.value)
    done = CliRunner().invoke(make_application(), ["frames", "--dbc", str(path)])
    assert isinstance(done.exception, InputError)
    assert words in str(done.exception)


def test_a_database_of_version_1_is_compared_with_the_layout_of_its_time(tmp_path: Path) -> None:
    check_layout(DBC_1, load_frames(DBC_1), VALUES)
    text, path = DBC_1.read_text(encoding="utf-8"), tmp_path / "old.dbc"
    for old, new in (
        ("CYLINDER_PRESSURE : 12|12", "CYLINDER_PRESSURE : 24|12"), ("OIL_TEMPERATURE : 24|12", "OIL_TEMPERATURE : 12|12"),
    ):  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"CYLINDER_PRESSURE is at 24\|12; the guard's is at 12\|12"):
        check_layout(path, load_frames(path), VALUES)


def test_another_identifier_of_a_frame_that_the_guard_reads_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.dbc"
    path.write_text(renumber(256, 258), encoding="utf-8")
    with pytest.raises(InputError, match="frame ANALOG_SENSORS has the identifier 0x102; the guard's is 0x100"):
        check_layout(path, load_frames(path), VALUES)


def test_what_the_guard_does_not_read_may_be_elsewhere(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        ("MOTOR_TORQUE : 52|12@1- (0.0244140625,0)", "MOTOR_TORQUE : 52|12@1- (0.025,0)"),
        ("CLUTCH_TORQUE : 48|16@1- (0.00152587890625,0)", "CLUTCH_TORQUE : 48|16@1- (0.0016,0)"),
        ("PRESSURE_DEMAND : 54|10@1+ (0.005,0)", "PRESSURE_DEMAND : 54|10@1+ (0.006,0)"),
    )
    check_layout(path, load_frames(path), VALUES)


def test_no_controller_begins_with_a_database_that_its_guard_cannot_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved = load_frames(write(tmp_path, *MOVED["pressure and temperature change places"][0]))
    monkeypatch.setattr("rt_controller.loop.node.load_frames", lambda *_, **__: moved)
    with pytest.raises(InputError, match=r"ANALOG_SENSORS.CYLINDER_PRESSURE is at 36"):
        ControllerNode()


def test_with_signals_that_changed_places_the_guard_would_see_no_overpressure(tmp_path: Path) -> None:
    """Why a moved signal is refused: 7 bar, as such a database sends them, are below the guard's limit of temperature."""
    path = write(tmp_path, *MOVED["pressure and temperature change places"][0])
    raw = {"CYLINDER_PRESSURE": 1434, "OIL_TEMPERATURE": 512}  # 7 bar, 50 degC
    for database, finds in ((DBC, True), (path, False)):
        message: Any = cantools.database.load_file(database)
        message = message.get_message_by_name("ANALOG_SENSORS")
        bench = Bench(rt_controller.guard.limits)
        result = []
        for count in range(10):
            values = {signal.name: 0 for signal in message.signals} | raw | {"COUNTER": count}
            body = message.encode(values, scaling=False, strict=False)
            bench.guard.check_inbound(message.frame_id, protect(body, read_data_id(message)))
            bench.guard.check_inbound(0x101, make_frame("ENCODER", count, SAMPLE_TICK=count))
            result.append(bench.guard.run_cycle())
        over = rt_controller.guard.limits.OVERPRESSURE
        assert (over in result) is finds, result


def test_the_table_has_the_bits_that_the_code_writes() -> None:
    """Every bit that the guard changes in a command, or that lets it change, is one of a signal in its table."""
    bench = Bench(rt_controller.guard.limits)
    for name, full in (
        ("VALVE_COMMAND", {"VALVE_ENABLE": 1, "VALVE_VOLTAGE": 0xFFFF}),
        ("MOTOR_COMMAND", {"MOTOR_ENABLE": 1, "SPEED_DEMAND": -1, "TORQUE_LIMIT": 0xFFFF}),
    ):
        can_id, places = LAYOUT[name]
        sent = make_frame(name, 3, **full)
        safe = bench.guard.limit_outbound(can_id, sent)  # before the first sample: the safe command
        changed = np.unpackbits(np.frombuffer(sent, np.uint8) ^ np.frombuffer(safe, np.uint8), bitorder="little")[16:]
        bits = {16 + int(at) for at in np.flatnonzero(changed)}
        assert bits == {place.start + k for place in places.values() for k in range(place.length)}
        assert all(decode(name, safe)[signal] == 0 for signal in places)
