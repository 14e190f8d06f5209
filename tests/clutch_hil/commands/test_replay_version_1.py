"""Bus logs of the field cases are of version 1: replay says so, and counts as many equal commands as version 1 did."""

import json

import pytest
from typer.testing import CliRunner

from clutch_hil.command import make_application
from protocols.files.bus_logs.version_1 import NOTE
from tests import needs

pytestmark = pytest.mark.needs("field cases")
# Log -> logged commands, and those that were equal, as the last commit with version 1 (2aeae10) told them; of k_loss, which
# lacks frames, 17 were equal with their counters, which are not compared any more
EQUAL = {
    "p_comment.log": (586, 430), "m_corrupt.log": (586, 407), "k_loss.log": (474, 318), "f_truncated.log": (586, 430),
    "candump_screen.log": (58, 58),
}  # fmt: skip


@pytest.mark.parametrize(("name", "counts"), EQUAL.items(), ids=EQUAL)
def test_as_many_commands_are_equal_as_in_version_1(name: str, counts: tuple[int, int]) -> None:
    done = CliRunner().invoke(make_application(), ["replay", str(needs.FIELD_CASES / "logs" / name), "--json"])
    document = json.loads(done.stdout)
    assert (document["logged"], document["equal"]) == counts
    assert document["notes"].count(NOTE) == 1
