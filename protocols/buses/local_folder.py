"""Folder of a `local:NAME` bus, where its participants find each other, and the lock that they hold while they join."""

import contextlib
import fcntl
import os
import re
import stat
import time
from collections.abc import Iterator
from pathlib import Path

import can

_NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")
_LOCK_PATIENCE_S = 5.0  # s: joining takes milliseconds; a participant that holds the lock longer was stopped


def find_bus_root() -> Path:
    """Return the folder of all buses of this user."""
    if chosen := os.environ.get("CLUTCH_HIL_BUS_DIR"):
        return Path(chosen).absolute()
    if runtime := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(runtime) / "clutch-hil"
    return Path(f"/tmp/clutch-hil-{os.getuid()}")


def make_bus_folder(name: str) -> Path:
    """Return the folder of a bus, created if it is missing. Raises can.CanInitializationError."""
    if not _NAME.fullmatch(name):
        raise can.CanInitializationError(f"bus name {name!r}; allowed are 1 to 32 of A-Z a-z 0-9 _ -")
    root = find_bus_root()
    folder = root / name
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = root.lstat()
        # In /tmp another user could have created the folder first. In $CLUTCH_HIL_BUS_DIR sharing may be intended.
        private = status.st_uid == os.getuid() and stat.S_ISDIR(status.st_mode) and not status.st_mode & 0o077
        if not private and not os.environ.get("CLUTCH_HIL_BUS_DIR"):
            raise can.CanInitializationError(f"bus folder {root} must be a folder of user {os.getuid()} with mode 0700")
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise can.CanInitializationError(f"bus folder {folder} cannot be used: {error}") from error
    return folder


@contextlib.contextmanager
def hold_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of the folder, so that participants join one after another. Raises can.CanInitializationError."""
    descriptor = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o600)
    deadline = time.monotonic() + _LOCK_PATIENCE_S
    try:
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError as error:
                if time.monotonic() > deadline:
                    raise can.CanInitializationError(
                        f"{folder / 'lock'} was locked for {_LOCK_PATIENCE_S:g} s: a process stopped while joining"
                    ) from error
                time.sleep(0.001)
        yield
    finally:
        os.close(descriptor)
