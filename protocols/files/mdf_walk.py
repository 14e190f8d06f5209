"""Walk over the blocks of an MDF file, link by link: what MDF 3 and MDF 4 have in common.

Each block is visited once, so that links that form a circle end in an error. What a walk finds is in a `Condition`.
"""

import mmap
import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from protocols.errors import InputError
from protocols.files.mdf_rows import count_rows

ID_BYTES = 64  # length of the identification, after which the header begins
PYTHON_BYTES = 60  # of memory for a row as an object of Python, beside its content
MOST_BLOCKS = 2_000_000  # of all kinds: a file of 100 000 channels has 600 000


@dataclass
class Condition:
    """What a file is like. unfinished: its writer never closed it. cut: rows that are there and rows by the header, of each
    group that was cut. mends: places and bytes to be written into a copy of a cut file, so that it ends where its rows do.
    """

    unfinished: bool
    cut: list[tuple[int, int]] = field(default_factory=list)
    mends: list[tuple[int, bytes]] = field(default_factory=list)

    def cut_text(self) -> str:
        """How much is there of the groups that were cut, "" where none was."""
        return ", ".join(f"{there} of {rows} rows" for there, rows in self.cut)


def check_inflated(path: Path, packed: bytes, size: int, address: int) -> None:
    """Raise InputError where a deflated block at `address` does not become exactly `size` bytes."""
    inflater = zlib.decompressobj()
    try:
        good = len(inflater.decompress(packed, size + 1)) == size
    except zlib.error:
        good = False
    if not good:
        raise InputError(
            f"recording {path} cannot be read, it is damaged: its compressed data at byte {address} do not make {size} bytes"
        )


def make_damage_error(path: Path, what: str) -> InputError:
    """The error of a file that is cut or damaged; `what` says where."""
    return InputError(f"recording {path} cannot be read, it is cut or damaged: {what}")


class BlockWalk:
    """Blocks of a file, of which each is visited once."""

    def __init__(self, path: Path, content: mmap.mmap, condition: Condition) -> None:
        self._path, self._content, self._size = path, content, len(content)
        self._condition = condition
        self._seen: set[int] = set()
        self._cuts: list[int] = []  # addresses of blocks that are not whole, or behind the end

    def _visit(self, address: int, kind: str) -> None:
        if address in self._seen:
            raise make_damage_error(self._path, f"its blocks form a circle at byte {address} ({kind})")
        self._seen.add(address)
        if len(self._seen) > MOST_BLOCKS:
            raise InputError(f"recording {self._path} has more than {MOST_BLOCKS} blocks; allowed are fewer")

    def _keep_rows(self, place: int, form: str, rows: int, there: int) -> None:
        """Keep the first `there` of the `rows` that the header tells at `place`."""
        self._condition.mends.append((place, struct.pack(form, there)))
        self._condition.cut.append((there, rows))

    def _count_rows(self, content: bytes, id_bytes: int, sizes: Mapping[int, int], behind: int = 0) -> Counter[int]:
        """Rows of each group in `content`; see `count_rows`. Raises InputError."""
        try:
            return count_rows(content, id_bytes, sizes, behind)
        except ValueError as error:
            raise make_damage_error(self._path, str(error)) from None

    def _check_cut(self) -> None:
        """Raise InputError where what is not whole is not the end of the file, or nothing of the rows is left."""
        if not self._cuts:
            return
        first = min(self._cuts)
        if max(self._seen) > first:
            raise self._fail(first, "of data")
        if not any(there for there, _ in self._condition.cut):
            raise make_damage_error(self._path, f"it ends at byte {self._size}, before its first row")

    def _fail(self, address: int, kind: str) -> InputError:
        return make_damage_error(self._path, f"no whole block {kind} at byte {address} of {self._size}")
