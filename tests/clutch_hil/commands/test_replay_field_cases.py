"""Bus logs of the field cases, where these are beside the checkout: they are of version 1 of the database.

`replay` refuses them in one sentence. `import` reads their signals with the database of their time.
"""

import pytest
from typer.testing import CliRunner

from clutch_hil.command import application
from clutch_hil.recordings.formats.bus_log import BusLogFormat
from protocols.errors import InputError
from tests import needs

pytestmark = pytest.mark.needs("field cases")
FOLDER = needs.FIELD_CASES / "logs"
NAMES = (
    "p_comment.log", "g_two_channels.log", "l_reversed_blocks.log", "e_remote.log", "c2_canfd_same_id.log", "umlaut.asc",
    "m_corrupt.log", "k_loss.log", "f_truncated.log", "candump_screen.log",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_a_log_of_version_1_is_not_replayed_and_the_reason_is_its_version(name: str) -> None:
    done = CliRunner().invoke(application(), ["replay", str(FOLDER / name)])
    assert isinstance(done.exception, InputError)
    assert str(done.exception).startswith(f"log {FOLDER / name} is of version 1 of the bench's database")
    assert "\n" not in str(done.exception)


def test_a_log_of_version_1_is_imported_with_its_own_database_and_with_no_other() -> None:
    path = FOLDER / "p_comment.log"
    recording = BusLogFormat().open(path, {"dbc": str(FOLDER.parent / "dbc" / "bom_utf8.dbc")})
    by_name = {channel.name: channel for channel in recording.channels}
    (pressure,) = recording.read([by_name["ANALOG_SENSORS.CYLINDER_PRESSURE"]])
    assert len(pressure.values) == 587  # the log ends within a sample
    assert -0.1 < pressure.values.min() < pressure.values.max() < 5.0  # bar
    with pytest.raises(InputError, match="version 1"):
        BusLogFormat().open(path, {})
