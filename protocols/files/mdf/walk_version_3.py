"""Walk over the blocks of an MDF 3 file.

Source: MDF 3.3, section 4 (blocks).
"""

import struct
from collections.abc import Iterator

from protocols.errors import InputError
from protocols.files.bounds import check_bytes
from protocols.files.mdf.walk import ID_BYTES, PYTHON_BYTES, BlockWalk, make_damage_error

_MOST_UNSORTED_ROWS = 10_000_000  # of MDF 3: each is a Python object while rows are sorted


class Mdf3Walk(BlockWalk):
    """MDF 3. A block: two letters, its length in 16 bits, links of 32 bits at fixed places."""

    def check(self) -> None:
        (order,) = struct.unpack_from("<H", self._content, 24)
        if order:
            raise InputError(
                f"recording {self._path} is MDF 3 in the byte order of Motorola; allowed is Intel's: convert it to MDF 4"
            )
        for group in self._follow_chain(self._check_block(ID_BYTES + 4), "DG", 24):
            channel_groups, id_bytes = self._check_block(group + 20, "H"), self._check_block(group + 22, "H")
            self._check_channel_groups(
                self._check_block(group + 8), self._check_block(group + 16), channel_groups, id_bytes
            )
        self._check_cut()

    def _check_block(self, address: int, kind: str = "I") -> int:
        (value,) = struct.unpack_from("<" + kind, self._content, address)
        return int(value)

    def _follow_chain(self, address: int, kind: str, least: int) -> Iterator[int]:
        """Yield the addresses of a block and of those that follow it."""
        while address:
            self._visit(address, kind)
            if address + least > self._size or self._content[address : address + 2] != kind.encode():
                raise self._fail(address, kind)
            yield address
            address = self._check_block(address + 4)

    def _check_channel_groups(self, first: int, data: int, count: int, id_bytes: int) -> None:
        total, rows_of_all, groups = 0, 0, 0
        row_bytes, rows, rows_at = 0, 0, 0
        places, sizes = {}, {}  # of the number of rows, by the identifier of the group; bytes of a row
        for address in self._follow_chain(first, "CG", 26):
            row_bytes, rows, rows_at = (
                self._check_block(address + 20, "H"),
                self._check_block(address + 22),
                address + 22,
            )
            record = self._check_block(address + 16, "H") & 0xFF
            places[record], sizes[record] = rows_at, row_bytes
            total += rows * (row_bytes + id_bytes)
            rows_of_all, groups = rows_of_all + rows, groups + 1
            for channel in self._follow_chain(self._check_block(address + 8), "CN", 24):
                for link in (self._check_block(channel + place) for place in (8, 12, 16, 20)):
                    if link + 4 > self._size:
                        raise self._fail(link, "of a channel")
        if groups != count:
            raise make_damage_error(self._path, f"it has {groups} channel groups in a data group of {count}")
        if total and data + total > self._size and groups == 1 and not id_bytes:
            self._cuts.append(data)
            self._keep_rows(rows_at, "<I", rows, max(0, self._size - data) // row_bytes)
        elif total and data + total > self._size and not id_bytes:
            raise make_damage_error(self._path, f"its rows need {total} bytes from byte {data}, of {self._size}")
        if id_bytes and rows_of_all > _MOST_UNSORTED_ROWS:
            raise InputError(
                f"recording {self._path} has {rows_of_all} rows that must be sorted; allowed are {_MOST_UNSORTED_ROWS}"
            )
        if id_bytes:
            check_bytes(f"sorting recording {self._path} needs", 2 * total + rows_of_all * PYTHON_BYTES)
        if id_bytes and total and data + total > self._size:
            self._cuts.append(data)
            there = self._count_rows(self._content[data:], 1, sizes, id_bytes - 1)
            for record, place in places.items():
                self._keep_rows(place, "<I", self._check_block(place), min(self._check_block(place), there[record]))
