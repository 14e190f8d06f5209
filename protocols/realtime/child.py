"""Child: a process that ends with its parent process."""

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import IO

from protocols.errors import InputError

_LIBC = ctypes.CDLL(None)  # before a fork, in which another thread may hold the loader's lock
_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def list_command(*arguments: str) -> list[str]:
    """Return the command line of `clutch-hil ARGUMENTS...` with this interpreter."""
    return list_module_command("clutch_hil", *arguments)


def list_module_command(name: str, *arguments: str) -> list[str]:
    """Return the command line of the module `name` with this interpreter."""
    # -P: modules in the current folder must not replace ours
    return [sys.executable, "-P", "-m", name, *arguments]


def spawn(
    command: Sequence[str],
    output: IO[str] | int | None = None,
    environment: Mapping[str, str] | None = None,
    when_parent_dies: signal.Signals = signal.SIGTERM,
    keep: Sequence[int] = (),
) -> "subprocess.Popen[bytes]":
    """Start a process in a new session, so that it does not receive Ctrl-C; `output`: for stdout and stderr, as of Popen.

    keep: descriptors that it inherits. when_parent_dies: signal that it receives when the calling thread ends.
    """

    parent = os.getpid()

    def die_with_parent() -> None:
        if (
            when_parent_dies != signal.SIGKILL
        ):  # else the parent's handler catches a signal before the new program begins
            signal.signal(when_parent_dies, signal.SIG_DFL)
        _LIBC.prctl(_PR_SET_PDEATHSIG, when_parent_dies)
        if os.getppid() != parent:  # the parent died before the call above: no signal will come
            os._exit(128 + when_parent_dies)

    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=output,
        env=environment,
        pass_fds=keep,
        start_new_session=True,
        preexec_fn=die_with_parent,
    )


def await_end(process: "subprocess.Popen[bytes]", patience: float, what: str) -> None:
    """Wait for a process, named `what`, to end; kill it after `patience` [s] and raise InputError."""
    try:
        process.wait(patience)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        raise InputError(f"the {what} did not end within {patience:g} s and was killed") from None


def end_child(process: "subprocess.Popen[bytes]", patience: float) -> None:
    """Ask a process to end, and kill it if it has not ended after `patience` [s]."""
    process.terminate()
    try:
        process.wait(patience)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
