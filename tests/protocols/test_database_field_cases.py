"""Databases of the field cases, where these are beside the checkout: they are of version 1 and refused in one sentence."""

import pytest

from protocols.can.database import read_database
from protocols.can.frames import load_frames
from protocols.errors import InputError
from tests import needs

pytestmark = pytest.mark.needs("field cases")
FOLDER = needs.FIELD_CASES / "dbc"
NAMES = (
    "bom_utf8", "dup_id", "extended", "missing_signal", "muxed", "no_cycle_time", "renamed_signal", "scale_zero", "utf16",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_a_database_of_version_1_is_refused_whatever_else_is_wrong_with_it(name: str) -> None:
    path = FOLDER / f"{name}.dbc"
    with pytest.raises(InputError) as refused:
        load_frames(path)
    assert str(refused.value).startswith(f"DBC {path} is of version 1 of the bench's database, with a CRC of 8 bits")
    assert "\n" not in str(refused.value)
    assert read_database(path).messages  # its signals can be read: `import` uses it for logs of its time


def test_signals_that_overlap_are_told_first() -> None:
    with pytest.raises(InputError, match="MOTOR_TORQUE and OIL_TEMPERATURE are overlapping in message ANALOG_SENSORS"):
        load_frames(FOLDER / "overlap.dbc")
