"""`python -m tests`: what failed in real time is tried again, nothing else is."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import __main__ as tests
from tests.__main__ import TRIES
from tests.conftest import GUEST, IN_REAL_TIME, LONGEST, SLOW, SOAK, TESTS

ROOT = Path(__file__).parents[1]
MARKED = "import pytest; pytestmark = pytest.mark.real_time\n"
FAILS = "def test_it(): assert False"
FAILS_ONCE = """
from pathlib import Path
def test_it():
    flag = Path(__file__).with_suffix(".tried")
    tried = flag.exists()
    flag.touch()
    assert tried
"""


OTHER_IN_EACH_WORKER = """
import os, pytest
@pytest.mark.parametrize("process", [os.getpid()])
def test_it(process): pass
"""


@pytest.mark.parametrize(
    ("text", "tries", "code"),
    [(MARKED + FAILS_ONCE, 2, 0), (MARKED + FAILS, TRIES, 1), (FAILS_ONCE, 1, 1), (OTHER_IN_EACH_WORKER, 1, 1)],
    ids=["real time, once", "real time, always", "no real time", "not collected"],
)
def test_a_failure_counts(text: str, tries: int, code: int, tmp_path: Path) -> None:
    path = tmp_path / "tests" / "test_x.py"
    path.parent.mkdir()
    path.write_text(text)
    (tmp_path / "pytest.ini").touch()  # tests are named from where one is, and there may be another further up
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")} | {"PYTHONPATH": str(ROOT)}
    play = "import sys; from tests import __main__ as tests; tests.PATIENCE = 0.0; sys.exit(tests.main(sys.argv[1:]))"
    command = [sys.executable, "-c", play, "-p", "no:cacheprovider", "-p", "no:hypothesispytest", "tests"]
    command += ["--numprocesses", "2"] if text is OTHER_IN_EACH_WORKER else []
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stdout + done.stderr
    assert done.stdout.count("test session starts") == tries, done.stdout


class Clock:
    """A machine that comes late from every sleep before `bad` [s]."""

    def __init__(self, bad: float) -> None:
        self.now, self.bad = 0.0, bad

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds + (0.1 if self.now < self.bad else 0.0)


@pytest.mark.parametrize(("bad", "stalls", "end"), [(0.0, 0, 5.0), (1.0, 10, 6.0), (1e9, 2971, 300.0)])
def test_a_try_waits_until_the_machine_runs(
    bad: float, stalls: int, end: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock(bad)
    monkeypatch.setattr(tests, "time", clock)
    assert tests.count_stalls_before_run() == stalls
    assert clock.now == pytest.approx(end, abs=0.2)


def test_every_place_that_has_a_turn_of_its_own_is_there() -> None:
    assert [place for place in (*IN_REAL_TIME, *SLOW, SOAK, LONGEST, GUEST) if not (TESTS / place).exists()] == []
