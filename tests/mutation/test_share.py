"""A share of the mutants of the safety path, and those set by hand: each is killed, but for the equivalent ones.

All of them: `python -m tests.mutation`. It runs in a process of its own, without a compiler (plain.py).
"""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.mutation.by_hand import BY_HAND
from tests.mutation.subjects import SUBJECTS

SHARE = 25  # mutants of a module


def play(*options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tests.mutation", *options]
    return subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("subject", SUBJECTS)
def test_a_share_of_the_mutants_is_killed(subject: str) -> None:
    played = play(subject, "--share", str(SHARE))
    assert played.returncode == 0, played.stdout + played.stderr
    assert " 0 survive" in played.stdout


def test_every_mutant_set_by_hand_is_killed() -> None:
    played = play("--by-hand")
    assert played.returncode == 0, played.stdout + played.stderr
    assert played.stdout.count("killed: ") == len(BY_HAND)


def test_a_mutant_that_no_check_notices_is_told() -> None:
    """The tool itself: without checks of it, a module's mutants survive, and the command fails."""
    played = play("sample", "--share", "2", "--without-checks")
    assert played.returncode == 1
    assert "survives: " in played.stdout
