"""Input files of persons and other programs. Kind, size and encoding are checked before anything is parsed.

The first bytes decide the format. A pipe or device is refused before it is opened. Text can drive parsers into deep recursion,
or into integers of thousands of digits; such text is refused like any invalid text.
"""

import json
import os
import stat
import tomllib
from math import inf
from pathlib import Path
from typing import Any

from protocols.errors import InputError

HEAD_BYTES = 4096  # bytes from the beginning of a file that decide its format
_MOST_BYTES = 4_000_000  # a parameter file has 30 kB, a report of the discrepancy workflow 1 MB
_SHOWN = 200  # characters of a parser's reason


def check_name(path: Path, what: str) -> None:
    """Raise InputError, which calls the file `what`, for a path that is not text: reports and libraries cannot handle it."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        try:  # Python reads names by the locale: that of C knows no letter beyond ASCII
            os.fsencode(path).decode()
        except UnicodeError:
            raise InputError(f"{what} {path} has a name that is not UTF-8 text; rename it") from None
        raise InputError(
            f"{what} {path} has letters in its name that the locale of this shell does not know; set LC_ALL=C.UTF-8"
        ) from None


def check_file(path: Path, what: str, most: float = inf) -> None:
    """Raise InputError, which calls the file `what`, for a pipe, device, folder, missing file, or more than `most` bytes."""
    check_name(path, what)
    try:
        status = os.stat(path)
    except FileNotFoundError:
        raise InputError(f"{what} {path} does not exist") from None
    except (OSError, ValueError) as error:  # ValueError: a name with a null character
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{what} {path} cannot be read: {reason}") from None
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
        raise InputError(f"{what} {path} cannot be read: it is {kind}; allowed is a file")
    if status.st_size > most:
        raise InputError(f"{what} {path} has {status.st_size / 1e6:.0f} MB; allowed are {most / 1e6:.0f}")


def read_head(path: Path, what: str = "recording") -> bytes:
    """Return the first HEAD_BYTES of a file. Raises InputError, which calls it `what`, as `check_file`."""
    check_file(path, what)
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise InputError(f"{what} {path} cannot be read: {error.strerror}") from None
    if not head:
        raise InputError(f"{what} {path} cannot be read: it is empty")
    return head


def read_raw(path: Path, what: str, most: int = _MOST_BYTES) -> bytes:
    """Return the bytes of a file, at most `most`. Raises InputError, which calls it `what`, as `check_file`."""
    check_file(path, what, most)
    try:
        with path.open("rb") as file:
            return file.read(most + 1)[:most]  # the file may grow while it is read
    except OSError as error:
        raise InputError(f"{what} {path} cannot be read: {error.strerror}") from None


def read_text(path: Path, what: str, most: int = _MOST_BYTES) -> str:
    """Return the text of a file in UTF-8, with or without a mark. Raises InputError."""
    try:
        return read_raw(path, what, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{what} {path} cannot be read: it is not UTF-8 text ({error.reason})") from None


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """Return the document in a TOML file. Raises InputError."""
    text = read_text(path, what)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{what} {path} cannot be read: its tables and lists are nested too deep") from None
    except ValueError as error:  # TOMLDecodeError, and whole numbers of more than 4300 digits
        raise InputError(f"{what} {path} cannot be read: {str(error)[:_SHOWN]}") from None


def read_json(path: Path, what: str) -> Any:
    """Return the document in a JSON file. Raises InputError."""
    text = read_text(path, what)
    try:
        return json.loads(text)
    except RecursionError:
        raise InputError(f"{what} {path} cannot be read: its objects and lists are nested too deep") from None
    except ValueError as error:
        raise InputError(f"{what} {path} cannot be read: {str(error)[:_SHOWN]}") from None
