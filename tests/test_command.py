"""The command: words that say nothing are refused before anything is begun."""

import pytest
from typer.testing import CliRunner

from protocols.command import application
from protocols.errors import InputError


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("controller", "--clutch", ""), "--clutch"),
        (("controller", "--clutch="), "--clutch"),
        (("inject", "friction_level", "--bus", " "), "--bus"),
        (("simulate", ""), "a word after 'simulate'"),
        (("",), "a word after 'clutch-hil'"),
    ],
)
def test_an_empty_word_is_refused(arguments: tuple[str, ...], named: str) -> None:
    refused = CliRunner().invoke(application(), arguments).exception
    assert isinstance(refused, InputError)
    assert str(refused) == f"{named} is empty; a value is needed, or leave it away"
