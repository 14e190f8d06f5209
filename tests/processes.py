"""Commands as real processes, for the tests, and in this one where only their words matter."""

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from clutch_hil.command import make_application
from protocols.errors import InputError
from protocols.realtime.child import list_command

PATIENCE = 120.0  # s for what takes a second or two on an idle machine
# plant and controller on one CPU, as `up` has them: a CPU of a shared machine that stands still does so for both
ONE_CPU = ("--cpu", str(max(os.sched_getaffinity(0))))


_PROGRESS = "loading modules", "compiling kernels: ", "kernels are compiled", "waiting for ", "at work for ", " % done"


def is_progress(line: str) -> bool:
    """Whether a line on stderr only says that a command is on its way, as it does on a busy machine."""
    return any(words in line for words in _PROGRESS)


def list_errors(errors: str) -> list[str]:
    """The lines on stderr that are no progress."""
    return [line for line in errors.strip().splitlines() if not is_progress(line)]


def await_file(path: Path, holding: str = "") -> None:
    """Wait until another process has made a file, and written `holding` into it."""
    deadline = time.monotonic() + PATIENCE
    while not (path.exists() and holding in path.read_text(errors="replace")):
        assert time.monotonic() < deadline, f"{path} never came" + (f" to hold {holding!r}" if holding else "")
        time.sleep(0.02)


def play_here(*words: object) -> subprocess.CompletedProcess[str]:
    """A `clutch-hil` command, played to its end in this process: what it is started for costs a second or two of CPU time.

    An InputError is what a process prints as one sentence with exit code 2 (tests/clutch_hil/commands/test_command.py).
    A command that changes how this process is scheduled, as `record` does, fails here: all later tests would have its priority.
    """
    before = os.sched_getscheduler(0), os.sched_getaffinity(0)
    arguments = [str(word) for word in words]
    result = CliRunner().invoke(make_application(), arguments)
    assert (os.sched_getscheduler(0), os.sched_getaffinity(0)) == before
    if isinstance(result.exception, InputError):
        return subprocess.CompletedProcess(arguments, 2, result.stdout, f"{result.stderr}error: {result.exception}\n")
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return subprocess.CompletedProcess(arguments, result.exit_code, result.stdout, result.stderr)


@contextmanager
def service(*arguments: str, **settings: Any) -> Iterator[subprocess.Popen]:
    """A `clutch-hil` command while it runs, with pipes unless `settings` of Popen say else; killed when it is left running."""
    settings = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | settings
    process = subprocess.Popen(list_command(*arguments), **settings)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()
