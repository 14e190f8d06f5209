"""A share of the mutants of the safety path, and those set by hand: each is killed, but for the equivalent ones.

All of them: `python -m tests.mutation`. They run in processes of their own, without a compiler (plain.py).
"""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.mutation.by_hand import BY_HAND
from tests.mutation.subjects import SUBJECTS

# Mutants of a module, and those modules whose checks take so long in plain Python that fewer are played
SHARE, FEWER = 25, 10
DEAR = ("cycle", "limits", "phases")


def play(*options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tests.mutation", *options]
    return subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("subjects", "share"),
    [([name for name in SUBJECTS if name not in DEAR], SHARE), (DEAR, FEWER)],
    ids=["most", "dear"],
)
def test_a_share_of_the_mutants_is_killed(subjects: Sequence[str], share: int) -> None:
    """In one process, as each would load the bench again."""
    played = play(*subjects, "--share", str(share))
    assert played.returncode == 0, played.stdout + played.stderr
    for subject in subjects:
        (line,) = (one for one in played.stdout.splitlines() if one.startswith(f"{SUBJECTS[subject].module}: "))
        assert " 0 survive" in line
        number = int(line.partition(" mutants, ")[2].partition(" played")[0])
        assert number >= share or line.startswith(f"{SUBJECTS[subject].module}: {number} mutants")


def test_every_mutant_set_by_hand_is_killed() -> None:
    played = play("--by-hand")
    assert played.returncode == 0, played.stdout + played.stderr
    assert played.stdout.count("killed: ") == len(BY_HAND)


def test_a_mutant_that_no_check_notices_is_told() -> None:
    """The tool itself: without checks of it, a module's mutants survive, and the command fails."""
    played = play("sample", "--share", "2", "--without-checks")
    assert played.returncode == 1
    assert "survives: " in played.stdout
