"""Rows of an unsorted MDF file, in which rows of several groups are mixed, each after its record identifier.

Source: ASAM MDF 4.2, 4.14.3 (unsorted data groups, records of varying length), 4.19 (transposed blocks); MDF 3.3, section 4
"""

import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from mmap import mmap

import numpy as np

ID_FORMS = {1: "<B", 2: "<H", 4: "<I", 8: "<Q"}  # bytes of a number -> how it is stored
VARYING = -1  # size of a row that begins with its length, in 4 bytes
_LENGTH = struct.Struct("<I")
_TRANSPOSED = 1  # kind of compression
_MOST_ROWS = 20_000_000  # 5 s of counting


def count_rows(content: bytes, id_bytes: int, sizes: Mapping[int, int], behind: int = 0) -> Counter[int]:
    """Return the number of complete rows of each group in `content`, which may end within a row.

    id_bytes: size of the record identifier before each row. sizes: bytes of a row by identifier. behind: bytes after each row.
    Raises ValueError for an unknown identifier, or if there are too many rows to count in seconds.
    """
    number_at, place, end = struct.Struct(ID_FORMS[id_bytes]).unpack_from, 0, len(content)
    counts: Counter[int] = Counter()
    for _ in range(_MOST_ROWS):
        if place + id_bytes > end:
            return counts
        (number,) = number_at(content, place)
        if number not in sizes:
            raise ValueError(f"a row is of group {number}; the groups are {', '.join(map(str, sorted(sizes)))}")
        size = sizes[number]
        if size == VARYING:
            if place + id_bytes + _LENGTH.size > end:
                return counts
            size = _LENGTH.size + _LENGTH.unpack_from(content, place + id_bytes)[0]
        place += id_bytes + size + behind
        if place <= end:
            counts[number] += 1
    raise ValueError(f"it has more than {_MOST_ROWS} rows that must be sorted")


def inflate_piece(content: mmap, address: int, size: int) -> bytes:
    """Return the `size` bytes of rows in the checked block DT or DZ at `address`."""
    if content[address : address + 4] != b"##DZ":
        return content[address + 24 : address + 24 + size]
    kind, columns, packed = struct.unpack_from("<2xBxI8xQ", content, address + 24)
    rows = zlib.decompress(content[address + 48 : address + 48 + packed])
    if kind != _TRANSPOSED or not columns:
        return rows
    whole = size // columns * columns
    turned = np.frombuffer(rows[:whole], np.uint8).reshape(columns, -1).T
    return turned.tobytes() + rows[whole:]
