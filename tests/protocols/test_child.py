"""Children that do not outlive who started them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from protocols.errors import InputError
from protocols.realtime import child

FOREVER = [sys.executable, "-c", "import time; time.sleep(600)"]
START_AND_DIE = (
    "import os, signal, sys; from protocols.realtime.child import spawn; "
    "print(spawn([sys.executable, '-c', 'import time; time.sleep(600)']).pid, flush=True); "
    "os.kill(os.getpid(), signal.SIGKILL)"
)


def test_a_child_ends_when_its_parent_is_killed() -> None:
    done = subprocess.run([sys.executable, "-c", START_AND_DIE], stdout=subprocess.PIPE, text=True, check=False)
    place, deadline = Path(f"/proc/{int(done.stdout)}/cmdline"), time.monotonic() + 10.0
    while place.exists() and place.read_bytes():  # of one that has ended and is not taken notice of it is empty
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_child_whose_parent_died_before_it_could_ask_for_the_signal_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    another = SimpleNamespace(getpid=lambda: -1, getppid=os.getppid, _exit=os._exit)
    monkeypatch.setattr(child, "os", another)
    assert child.spawn(FOREVER).wait(10.0) == 128 + 15


def test_a_child_that_does_not_end_by_itself_is_killed_and_told() -> None:
    process = child.spawn(FOREVER)
    with pytest.raises(InputError, match=r"^the sleeper did not end within 0\.05 s and was killed$"):
        child.await_end(process, 0.05, "sleeper")
    assert process.returncode == -signal.SIGKILL
    child.await_end(child.spawn([sys.executable, "-c", ""]), 10.0, "one that ends")
