"""`python -m tests`: what failed in real time has a second try, nothing else has."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import GUEST, IN_REAL_TIME, LONGEST, SOAK, TESTS

ROOT = Path(__file__).parents[1]
FAILS = "def test_it(): assert False"
FAILS_ONCE = """
from pathlib import Path
def test_it():
    flag = Path(__file__).with_suffix(".tried")
    tried = flag.exists()
    flag.touch()
    assert tried
"""


@pytest.mark.parametrize(
    ("file", "text", "tries", "code"),
    [("live/test_x.py", FAILS_ONCE, 2, 0), ("live/test_x.py", FAILS, 2, 1), ("test_wet_clutch.py", FAILS_ONCE, 1, 1)],
)
def test_a_failure_counts(file: str, text: str, tries: int, code: int, tmp_path: Path) -> None:
    path = tmp_path / "tests" / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")} | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "tests", "-p", "no:cacheprovider", "-p", "no:hypothesispytest", "tests"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stdout + done.stderr
    assert done.stdout.count("test session starts") == tries, done.stdout


def test_every_place_that_has_a_turn_of_its_own_is_there() -> None:
    assert [place for place in (*IN_REAL_TIME, SOAK, LONGEST, GUEST) if not (TESTS / place).exists()] == []
