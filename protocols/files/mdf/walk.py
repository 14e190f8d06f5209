"""Walk over the blocks of an MDF file, link by link: what MDF 3 and MDF 4 have in common.

Each block is visited once, so that circular links cause an error. The result of a walk is a `Condition`.
"""

import mmap
import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from protocols.errors import InputError
from protocols.files.mdf.rows import count_rows

ID_BYTES = 64  # length of the identification, after which the header begins
PYTHON_BYTES = 60  # of memory for a row as a Python object, in addition to its content
MOST_BLOCKS = 2_000_000  # of all kinds: a file of 100 000 channels has 600 000


@dataclass
class Condition:
    """Condition of a file. unfinished: its writer never closed it.

    cut: existing rows and rows by the header, for each group that was cut. mends: positions and bytes to write into a copy of a
    cut file, so that it ends where its rows end.
    """

    unfinished: bool
    cut: list[tuple[int, int]] = field(default_factory=list)
    mends: list[tuple[int, bytes]] = field(default_factory=list)

    def cut_text(self) -> str:
        """Text on how much of the cut groups exists; "" if none was cut."""
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
    """Return the error for a file that is cut or damaged; `what` names the place."""
    return InputError(f"recording {path} cannot be read, it is cut or damaged: {what}")


class BlockWalk:
    """Visits each block of a file once."""

    def __init__(self, path: Path, content: mmap.mmap, condition: Condition) -> None:
        self._path, self._content, self._size = path, content, len(content)
        self._condition = condition
        self._seen: set[int] = set()
        self._cuts: list[int] = []  # addresses of blocks that are incomplete, or after the end of the file

    def _visit(self, address: int, kind: str) -> None:
        if address in self._seen:
            raise make_damage_error(self._path, f"its blocks form a circle at byte {address} ({kind})")
        self._seen.add(address)
        if len(self._seen) > MOST_BLOCKS:
            raise InputError(f"recording {self._path} has more than {MOST_BLOCKS} blocks; allowed are fewer")

    def _keep_rows(self, place: int, form: str, rows: int, there: int) -> None:
        """Reduce the number of `rows` that the header declares at `place` to the `there` existing ones."""
        self._condition.mends.append((place, struct.pack(form, there)))
        self._condition.cut.append((there, rows))

    def _count_rows(self, content: bytes, id_bytes: int, sizes: Mapping[int, int], behind: int = 0) -> Counter[int]:
        """Return the rows of each group in `content`; see `count_rows`. Raises InputError."""
        try:
            return count_rows(content, id_bytes, sizes, behind)
        except ValueError as error:
            raise make_damage_error(self._path, str(error)) from None

    def _check_cut(self) -> None:
        """Raise InputError if an incomplete block is not at the end of the file, or no rows are left."""
        if not self._cuts:
            return
        first = min(self._cuts)
        if max(self._seen) > first:
            raise self._fail(first, "of data")
        if not any(there for there, _ in self._condition.cut):
            raise make_damage_error(self._path, f"it ends at byte {self._size}, before its first row")

    def _fail(self, address: int, kind: str) -> InputError:
        return make_damage_error(self._path, f"no whole block {kind} at byte {address} of {self._size}")
