"""An option that takes several paths: all up to the next option, and never none."""

import pytest
import typer
from typer.testing import CliRunner

from clutch_hil.commands.many_paths import ManyPaths
from protocols.errors import InputError


def read(*words: str) -> tuple[list[str], list[str]]:
    """The runs and those held out, as a command with these words has them."""
    taken: list[tuple[list[str], list[str]]] = []
    app = typer.Typer()

    @app.command(cls=ManyPaths)
    def fit(
        runs: list[str] = typer.Argument(...), holdout: list[str] = typer.Option([], "--holdout"), out: str = "here"
    ) -> None:
        taken.append((runs, holdout))

    CliRunner().invoke(app, words, catch_exceptions=False)
    return taken[0]


@pytest.mark.parametrize(
    "words",
    [
        ("a", "b", "--holdout", "c", "d"),
        ("--holdout", "c", "d", "--out", "there", "a", "b"),
        ("a", "b", "--holdout=c", "d"),
        ("--holdout", "c", "--holdout", "d", "--", "a", "b"),
        ("--holdout", "c", "d", "--", "a", "b"),
    ],
)
def test_all_paths_up_to_the_next_option_are_held_out(words: tuple[str, ...]) -> None:
    assert read(*words) == (["a", "b"], ["c", "d"])


def test_after_two_hyphens_every_word_is_a_run() -> None:
    assert read("--holdout", "c", "--", "-a", "--holdout") == (["-a", "--holdout"], ["c"])


@pytest.mark.parametrize("words", [("a", "--holdout"), ("a", "--holdout", "--out", "there"), ("--holdout", "--", "a")])
def test_nothing_held_out_is_refused(words: tuple[str, ...]) -> None:
    """As of a pattern of a shell that no file has: the result would be judged on nothing, and not say so."""
    with pytest.raises(InputError, match="--holdout has no run; give one or more after it, or leave it out"):
        read(*words)


def test_no_word_before_two_hyphens_is_no_error() -> None:
    assert read("--", "a", "b") == (["a", "b"], [])
