"""Head of a file: its first bytes, which tell its format. What is no file with content is refused before it is opened."""

import os
import stat
from pathlib import Path

from protocols.errors import InputError

HEAD_BYTES = 4096  # bytes from the beginning of a file that decide its format


def read_head(path: Path, what: str = "recording") -> bytes:
    """The first HEAD_BYTES of a file. Raises InputError, naming `what` it is, for a pipe, a device, a folder or nothing."""
    try:
        mode = os.stat(path).st_mode
        if not stat.S_ISREG(mode):
            kind = "a folder" if stat.S_ISDIR(mode) else "a pipe or a device"
            raise InputError(f"{what} {path} cannot be read: it is {kind}; allowed is a file")
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except FileNotFoundError:
        raise InputError(f"{what} {path} does not exist") from None
    except (OSError, ValueError) as error:  # ValueError: a name with a null character
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{what} {path} cannot be read: {reason}") from None
    if not head:
        raise InputError(f"{what} {path} cannot be read: it is empty")
    return head
