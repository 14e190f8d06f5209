"""SharedFolder: a folder in memory, shared by processes of a bench. It is removed after its owner has ended or was killed."""

import contextlib
import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

_MEMORY = Path("/dev/shm")
_PREFIX = "clutch-hil-"
_LOCK = "owner"  # file that its owner keeps locked while it lives
_PATIENCE = 5.0  # s for the lock of all folders, normally held for milliseconds: a longer holder was stopped
_POLL_PERIOD = 0.002  # s between attempts


class SharedFolder:
    """`path` is a new folder of this process, in /dev/shm where there is one. Folders of dead owners are removed.

    As a context manager it gives its path, and is removed at the end.
    """

    def __init__(self) -> None:
        root = _find_root()
        with _hold_lock(root) as held:
            if held:
                _remove_dead(root)
            self.path = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=root))
            self._lock = (self.path / _LOCK).open("w")
            fcntl.flock(self._lock, fcntl.LOCK_EX)

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *_: object) -> None:
        self.remove()

    def remove(self) -> None:
        """Remove the folder with its content."""
        shutil.rmtree(self.path, ignore_errors=True)
        self._lock.close()


def remove_dead_folders() -> None:
    """Remove the folders whose owners have ended."""
    root = _find_root()
    with _hold_lock(root) as held:
        if held:
            _remove_dead(root)


def list_dead_folders() -> list[Path]:
    """Return the folders whose owners have ended, or that never had one."""
    root = _find_root()
    with _hold_lock(root):
        return [folder for folder in root.glob(f"{_PREFIX}*") if _is_dead(folder)]


def _find_root() -> Path:
    return _MEMORY if os.access(_MEMORY, os.W_OK) else Path(tempfile.gettempdir())


@contextlib.contextmanager
def _hold_lock(root: Path) -> Iterator[bool]:
    """Hold the lock of all folders in `root`, so that no folder is seen half made; yield whether it is held."""
    descriptor = os.open(root, os.O_RDONLY | os.O_DIRECTORY)
    deadline = time.monotonic() + _PATIENCE
    held = False
    try:
        while not held and time.monotonic() < deadline:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                held = True
            except BlockingIOError:
                time.sleep(_POLL_PERIOD)
        yield held
    finally:
        os.close(descriptor)


def _remove_dead(root: Path) -> None:
    for folder in root.glob(f"{_PREFIX}*"):
        if _is_dead(folder):
            shutil.rmtree(folder, ignore_errors=True)


def _is_dead(folder: Path) -> bool:
    """Return whether the owner of a folder has ended. Call it while holding the lock of all folders."""
    try:
        with (folder / _LOCK).open() as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
    except FileNotFoundError:
        # its owner was killed before it locked it, or a process wrote into it while it was removed. Outside /dev/shm a folder
        # of this name may belong to another program part: that of the local buses
        return folder.parent == _MEMORY and folder.is_dir()
    except OSError:
        return False  # its owner lives, or it is of another user
