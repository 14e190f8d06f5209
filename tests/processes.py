"""Run `clutch-hil` commands for tests: as processes, or in this process if only their output matters."""

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

PATIENCE = 120.0  # s, timeout for actions that take a second or two on an idle machine
# plant and controller on one CPU, as with `up`: if a shared machine stops this CPU, it stops both
ONE_CPU = ("--cpu", str(max(os.sched_getaffinity(0))))


_PROGRESS = "loading modules", "compiling kernels: ", "kernels are compiled", "waiting for ", "working for ", " % done"


def is_progress(line: str) -> bool:
    """Return whether a line on stderr only reports progress, which commands print on a busy machine."""
    return any(words in line for words in _PROGRESS)


def list_errors(errors: str) -> list[str]:
    """Return the lines of stderr that do not report progress."""
    return [line for line in errors.strip().splitlines() if not is_progress(line)]


def await_file(path: Path, holding: str = "") -> None:
    """Wait until another process has made the file `path` and written the text `holding` into it."""
    deadline = time.monotonic() + PATIENCE
    while not (path.exists() and holding in path.read_text(errors="replace")):
        assert time.monotonic() < deadline, f"{path} never came" + (f" to hold {holding!r}" if holding else "")
        time.sleep(0.02)


def play_here(*words: object) -> subprocess.CompletedProcess[str]:
    """Run a `clutch-hil` command in this process, which saves the second or two of CPU time that a new process needs.

    For an InputError the result has exit code 2 and the sentence that a process prints
    (tests/clutch_hil/commands/test_command.py). A command that changes the scheduling of this process, such as `record`, fails
    here, because all later tests would run with its priority.
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
    """Run a `clutch-hil` command as a process, killed at the end. `settings`: arguments of Popen; default: pipes and text."""
    settings = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | settings
    process = subprocess.Popen(list_command(*arguments), **settings)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()
