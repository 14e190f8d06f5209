"""Bus logs of the field cases, where these are beside the checkout: one content has one answer, what is missing is told."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from clutch_hil.command import make_application
from protocols.errors import InputError
from tests import needs

pytestmark = pytest.mark.needs("field cases")
FOLDER = needs.FIELD_CASES / "logs"
SAMPLES = 586  # of the recording


def replay(name: str | Path, *options: str) -> tuple[int, dict[str, Any]]:
    """Exit code and document of `replay`. Raises InputError as the command."""
    done = CliRunner().invoke(make_application(), ["replay", str(FOLDER / name), "--json", *options])
    if isinstance(done.exception, InputError):
        raise done.exception
    return done.exit_code, json.loads(done.stdout)


@pytest.fixture(scope="module")
def sound() -> dict[str, Any]:
    code, document = replay("p_comment.log")
    assert code == 0
    assert document["cycles"] == SAMPLES
    assert document["defects"] is None
    return document


@pytest.mark.parametrize(
    ("name", "options", "note"),
    [
        ("g_two_channels.log", ("--channel", "can0"), "took channel can0; left out frames: 3000 of can1"),
        ("g_two_channels.log", ("--channel", "can1"), "took channel can1; left out frames: 3000 of can0"),
        ("l_reversed_blocks.log", (), "2845 of 3000 frames were not in order of time"),
        ("e_remote.log", (), "left out frames: 60 of can0"),
        ("c2_canfd_same_id.log", (), "left out frames: 60 of can0"),
        ("umlaut.asc", (), ""),
    ],
)
def test_the_same_frames_get_the_same_answers(
    sound: dict[str, Any], name: str, options: tuple[str, ...], note: str
) -> None:
    code, document = replay(name, *options)
    assert code == 0
    assert document["sha256"] == sound["sha256"]
    assert (document["cycles"], document["logged"], document["equal"]) == (SAMPLES, SAMPLES, sound["equal"])
    assert document["defects"] is None
    assert any(note in one for one in document["notes"]) or not note


@pytest.mark.parametrize(("name", "kind"), [("e_remote.log", "remote"), ("c2_canfd_same_id.log", "CAN FD")])
def test_frames_that_a_bus_port_ignores_are_ignored_on_the_bench_channel(
    sound: dict[str, Any], tmp_path: Path, name: str, kind: str
) -> None:
    one_bus = tmp_path / name
    one_bus.write_text((FOLDER / name).read_text().replace(" can0 ", " bugs1 "))
    code, document = replay(one_bus)
    assert code == 0
    assert document["ignored"] == {kind: 60}
    assert document["sha256"] == sound["sha256"]


def test_two_buses_in_one_log_need_a_channel() -> None:
    with pytest.raises(InputError, match="on 2 channels, can0, can1; choose one with --channel"):
        replay("g_two_channels.log")


@pytest.mark.parametrize(
    ("name", "counted", "defects"),
    [
        ("m_corrupt.log", {"corrupt": 32, "lost": 0}, "frames 32 corrupt"),
        ("k_loss.log", {"corrupt": 0, "lost": 306}, "frames 306 lost (by their counters)"),
        ("f_truncated.log", {"cut": "the log ends within line 3000"}, "the log is cut"),
    ],
)
def test_what_is_missing_is_counted_and_ends_with_1_where_answers_differ(
    name: str, counted: dict[str, Any], defects: str
) -> None:
    code, document = replay(name)
    assert {key: document[key] for key in counted} == counted
    assert document["defects"] == defects
    assert document["equal"] < document["logged"]
    assert code == 1


def test_the_screen_format_is_answered_as_candump_is(tmp_path: Path) -> None:
    """The case ends within a line: it is compared with the same frames as candump -L writes them."""
    code, document = replay("candump_screen.log")
    assert (code, document["cut"]) == (0, "the log ends within line 329")
    assert document["equal"] == document["logged"] == document["cycles"] > 0
    whole = (FOLDER / "p_comment.log").read_text().splitlines(keepends=True)[1:329]
    short = tmp_path / "short.log"
    short.write_text("".join(whole))
    assert replay(short)[1]["sha256"] == document["sha256"]
