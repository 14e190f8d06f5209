"""Frames in a database of SQLite, as python-can's SqliteWriter keeps them.

python-can's own reader opens the file for writing, and runs whatever view is called `messages`. This one reads the table only.
"""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

import can

from protocols.errors import InputError

_LONGEST_DATA = 64  # bytes of a frame
_CLASSIC_BYTES = 8
_ROWS = (
    f"SELECT ts, arbitration_id, extended, remote, error, dlc, CAST(substr(data, 1, {_LONGEST_DATA + 1}) AS BLOB)"
    " FROM messages ORDER BY rowid"
)


def read_sqlite_frames(path: Path) -> Iterator[can.Message]:
    """Yield the messages of a database. Raises InputError for one without the table, sqlite3.Error for a damaged one."""
    address = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True)) as database:
        kinds = database.execute("SELECT type FROM sqlite_master WHERE name = 'messages'").fetchall()
        if kinds != [("table",)]:
            raise InputError(f"log {path} is a database of SQLite without a table 'messages', as python-can writes it")
        for stamp, can_id, extended, remote, error, dlc, data in database.execute(_ROWS):
            data = data or b""
            is_fd = _CLASSIC_BYTES < len(data) == dlc <= _LONGEST_DATA  # others with so much data are no frames
            yield can.Message(
                float(stamp), int(can_id), bool(extended), bool(remote), bool(error), None, int(dlc), data,
                is_fd=is_fd,
            )  # fmt: skip
