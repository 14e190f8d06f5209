"""SharedFolder: a folder in memory that processes of a bench share. It is removed after its owner, even a killed one."""

import fcntl
import os
import shutil
import tempfile
from pathlib import Path

_PREFIX = "clutch-hil-"
_LOCK = "owner"  # file that its owner keeps locked while it lives


class SharedFolder:
    """`path` is a new folder of this process, in /dev/shm where there is one. Folders of dead owners are removed.

    As a context manager it gives its path, and is removed at the end.
    """

    def __init__(self) -> None:
        memory = Path("/dev/shm")
        root = memory if os.access(memory, os.W_OK) else Path(tempfile.gettempdir())
        for folder in root.glob(f"{_PREFIX}*"):
            _remove_if_dead(folder)
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


def _remove_if_dead(folder: Path) -> None:
    try:
        with (folder / _LOCK).open() as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)
    except OSError:
        pass  # its owner lives, or it is of another user
