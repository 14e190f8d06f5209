"""Databases of the field cases, where these are beside the checkout: read in their encoding, or refused by signal.

They are older than the signal STICKING, which is told beside what is wrong with each. With it they are judged as one of today.
"""

import re
from pathlib import Path

import pytest

from protocols.can.database import list_frames_without_cycle_time, read_database, read_text
from protocols.can.frames import load_frames
from protocols.errors import InputError
from tests import needs

pytestmark = pytest.mark.needs("field cases")
FOLDER = needs.FIELD_CASES / "dbc"
_OLD = "frame CONTROLLER_STATUS lacks the signal STICKING"
_STICKING = ' SG_ STICKING : 15|1@1+ (1,0) [0|1] ""  SUPERVISOR\n'
WRONG = {
    "dup_id": "the frames ANALOG_SENSORS, ENCODER have the same identifier, 0x100",
    "scale_zero": "frame ANALOG_SENSORS: signal CYLINDER_PRESSURE has the factor 0 and offset 0",
    "extended": "frame ANALOG_SENSORS has an extended identifier, 0x00000100",
    "missing_signal": "frame ANALOG_SENSORS lacks the signal CLUTCH_TORQUE",
    "renamed_signal": "frame ANALOG_SENSORS lacks the signal CYLINDER_PRESSURE; it has CYL_PRESSURE instead",
    "overlap": "The signals MOTOR_TORQUE and OIL_TEMPERATURE are overlapping in message ANALOG_SENSORS",
    "muxed": "frame TORQUE_SETPOINT: signal REQUEST is multiplexed",
}


def update_case(name: str, folder: Path) -> Path:
    """The case with STICKING and the numbers that the requests and phases have now, in its own encoding."""
    path, raw = folder / f"{name}.dbc", (FOLDER / f"{name}.dbc").read_bytes()
    text = read_text(FOLDER / f"{name}.dbc")
    text, count = re.subn(r"( SG_ PHASE : .*\n)", rf"\1{_STICKING}", text)
    assert count == 1
    encoding = "utf-16" if raw.startswith(b"\xff\xfe") else "utf-8-sig" if raw.startswith(b"\xef\xbb\xbf") else "utf-8"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize(("name", "words"), WRONG.items(), ids=WRONG)
def test_a_database_that_cannot_carry_the_bench_is_refused_by_signal(tmp_path: Path, name: str, words: str) -> None:
    for path in (FOLDER / f"{name}.dbc", update_case(name, tmp_path)):
        with pytest.raises(InputError) as refused:
            load_frames(path)
        assert words in str(refused.value)
        assert _OLD not in str(refused.value) or path.parent == FOLDER


@pytest.mark.parametrize("name", ["bom_utf8", "utf16"])
def test_the_encoding_is_found(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=f"{_OLD}$"):  # the one thing that it lacks
        load_frames(FOLDER / f"{name}.dbc")
    # they are from before the claims, which a database need not have
    assert load_frames(update_case(name, tmp_path)).keys() == load_frames().keys() - {"SUPERVISOR_CLAIM"}


def test_without_cycle_times_the_load_is_unknown(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"its load is unknown, as ANALOG_SENSORS, .* have no cycle time"):
        load_frames(FOLDER / "no_cycle_time.dbc")
    path = update_case("no_cycle_time", tmp_path)
    assert sorted(list_frames_without_cycle_time(read_database(path))) == sorted(load_frames(path))
