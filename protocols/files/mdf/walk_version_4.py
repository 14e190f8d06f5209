"""Walk over the blocks of an MDF 4 file.

Source: ASAM MDF 4.2, section 6 (blocks).
"""

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path

from protocols.files.bounds import check_bytes
from protocols.files.mdf.rows import ID_FORMS, VARYING, inflate_piece
from protocols.files.mdf.walk import (
    ID_BYTES,
    MOST_BLOCKS,
    PYTHON_BYTES,
    BlockWalk,
    Condition,
    check_inflated,
    make_damage_error,
)

_MOST_INFLATED = 64 << 20  # bytes of one compressed block: writers use 4 MB
_BEST_DEFLATE = 1032  # highest compression ratio (zlib, technical details)
_MOST_NESTED = 10  # nested conversions: writers nest two
_VARIABLE = 1  # MDF 4: flag of a group that holds the values of a channel of varying length
_DEFLATE = (0, 1)  # kinds of compression in a DZ block: deflated; transposed and deflated


class Mdf4Walk(BlockWalk):
    """MDF 4. A block: "##", two letters, four bytes, its length and number of links, the links, its data."""

    def __init__(self, path: Path, content: mmap.mmap, condition: Condition) -> None:
        super().__init__(path, content, condition)
        (flags,) = struct.unpack_from("<H", content, 60)  # steps that the writer did not complete
        self._whole = not (condition.unfinished and flags)
        self._conversions: dict[int, int] = {}
        self._unsorted = 0  # bytes of the groups whose rows must be sorted
        self._pieces: list[tuple[int, int]] = []  # address and size of each existing block of rows

    def check(self) -> None:
        groups, history, _, attachments, events = self._read_links(ID_BYTES, "HD", 6)[:5]
        for kind, first in (("FH", history), ("AT", attachments), ("EV", events)):
            for _ in self._follow_chain(first, kind):
                pass
        for links, data in self._follow_chain(groups, "DG", 4):
            channel_groups = list(self._follow_chain(links[1], "CG", 6))
            row_bytes = [self._check_channel_group(*group) for group in channel_groups]
            (id_bytes,) = struct.unpack_from("<B", self._content, data)
            link_at = data - 8 * len(links) + 16
            if links[2] and self._whole and not id_bytes and len(channel_groups) == 1:
                self._check_sorted_rows(link_at, channel_groups[0][1] + 8, row_bytes[0])
            elif links[2] and self._whole and id_bytes in ID_FORMS:
                self._check_unsorted_rows(link_at, [fields for _, fields in channel_groups], row_bytes, id_bytes)
            elif links[2]:
                self._check_data_block(links[2], min(row_bytes, default=0) + id_bytes if id_bytes else 0)
        self._check_cut()
        if self._unsorted or not self._whole:
            check_bytes(f"recording {self._path}, which must be sorted, has", max(self._unsorted, self._size))

    def _read_links(self, address: int, kind: str, least: int) -> tuple[int, ...]:
        """Return the links of the block at `address`, at least `least` of them. Raises InputError if there is no such block."""
        if address + 24 > self._size:
            raise self._fail(address, kind)
        name, length, count = struct.unpack_from("<4s4xQQ", self._content, address)
        if name != b"##" + kind.encode() or count < least or 24 + 8 * count > length or address + length > self._size:
            raise self._fail(address, kind)
        return struct.unpack_from(f"<{count}Q", self._content, address + 24)

    def _follow_chain(self, address: int, kind: str, least: int = 1) -> Iterator[tuple[tuple[int, ...], int]]:
        """Yield the links and the data address of a block and of the blocks that follow it."""
        while address:
            self._visit(address, kind)
            links = self._read_links(address, kind, least)
            yield links, address + 24 + 8 * len(links)
            address = links[0]

    def _check_channel_group(self, links: tuple[int, ...], data: int) -> int:
        """Check the channels of a group; return the size of a row [bytes]."""
        self._check_channels(links[1])
        data_bytes, invalidation_bytes = struct.unpack_from("<II", self._content, data + 24)
        return data_bytes + invalidation_bytes

    def _check_channels(self, first: int, depth: int = 0) -> None:
        if depth > _MOST_NESTED:
            raise self._fail(first, "CN, nested so deep")
        for links, data in self._follow_chain(first, "CN", 8):
            self._count_conversions(links[4], 0)
            if links[1]:
                self._check_composition(links[1], depth)
            (kind,) = struct.unpack_from("<B", self._content, data)
            if links[5] and kind == 1 and not self._is(links[5], b"##CG"):  # values of varying length
                self._check_data_block(links[5], 0)

    def _check_composition(self, address: int, depth: int) -> None:
        if self._is(address, b"##CA"):
            self._visit(address, "CA")
            links = self._read_links(address, "CA", 1)
            if links[0]:
                self._check_composition(links[0], depth + 1)
        else:
            self._check_channels(address, depth + 1)

    def _count_conversions(self, address: int, depth: int) -> int:
        """Return the number of conversions in a conversion, including itself."""
        if not address:
            return 0
        if address not in self._conversions:
            if depth > _MOST_NESTED:
                raise self._fail(address, "CC, nested so deep")
            inner = [link for link in self._read_links(address, "CC", 4)[4:] if link and self._is(link, b"##CC")]
            self._conversions[address] = 1 + sum(self._count_conversions(link, depth + 1) for link in inner)
            if self._conversions[address] > MOST_BLOCKS:
                raise self._fail(address, "CC, with so many others inside")
        return self._conversions[address]

    def _is(self, address: int, name: bytes) -> bool:
        return self._content[address : address + 4] == name

    def _check_sorted_rows(self, link_at: int, rows_at: int, row_bytes: int) -> None:
        """Check the data of the only group behind the link at `link_at`. If they are cut, keep the complete rows."""
        cuts = len(self._cuts)
        size = self._measure_size(link_at, False)
        (rows,) = struct.unpack_from("<Q", self._content, rows_at)
        if len(self._cuts) > cuts and rows * row_bytes > size:
            self._keep_rows(rows_at, "<Q", rows, size // row_bytes)

    def _check_unsorted_rows(self, link_at: int, groups: list[int], row_bytes: list[int], id_bytes: int) -> None:
        """Check the data of several groups behind the link at `link_at`.

        groups: addresses of the fields of each group.
        """
        cuts, self._pieces = len(self._cuts), []
        self._measure_size(link_at, False)
        for address, size in self._pieces:
            if self._is(address, b"##DZ"):
                self._check_compressed(address, max(1, min(row_bytes, default=0) + id_bytes))
            else:
                self._unsorted += size
        if len(self._cuts) == cuts:
            return
        check_bytes(f"recording {self._path}, which must be sorted, has", self._unsorted)
        sizes = {}
        for fields, size in zip(groups, row_bytes, strict=True):
            record, _, flags = struct.unpack_from("<QQH", self._content, fields)
            sizes[record] = VARYING if flags & _VARIABLE else size
        there = self._count_rows(
            b"".join(inflate_piece(self._content, *piece) for piece in self._pieces), id_bytes, sizes
        )
        for fields in groups:
            record, rows = struct.unpack_from("<QQ", self._content, fields)
            self._keep_rows(fields + 8, "<Q", rows, min(rows, there[record]))

    def _measure_size(self, link_at: int, in_list: bool) -> int:
        """Return the bytes of rows behind the link at `link_at`, as far as the file reaches.

        in_list: whether the block belongs to a list of blocks.
        """
        (address,) = struct.unpack_from("<Q", self._content, link_at)
        if address + 24 > self._size:
            return self._cut(address, link_at, 0)
        name = bytes(self._content[address : address + 4])
        (length,) = struct.unpack_from("<Q", self._content, address + 8)
        if name == b"##DT":
            self._visit(address, "DT")
            if length < 24:
                raise self._fail(address, "DT")
            if address + length > self._size:
                self._cut(address, address + 8, self._size - address)
            size = min(length, self._size - address) - 24
            self._pieces.append((address, size))
            return size
        if name == b"##DZ":
            if address + length > self._size:
                return self._cut(address, link_at, 0)
            self._check_data_block(address, 0)
            (size,) = struct.unpack_from("<Q", self._content, address + 32)
            self._pieces.append((address, size))
            return int(size)
        if name == b"##HL" and not in_list:
            self._visit(address, "HL")
            return self._measure_size(address + 24, in_list) if self._read_links(address, "HL", 1)[0] else 0
        if name == b"##DL" and not in_list:
            return self._measure_list(link_at, address)
        self._check_data_block(address, 0)
        return 0

    def _measure_list(self, link_at: int, address: int) -> int:
        size = 0
        while address:
            if address + 24 > self._size or address + self._read_length(address) > self._size:
                return size + self._cut(address, link_at, 0)
            self._visit(address, "DL")
            links = self._read_links(address, "DL", 1)
            for k, link in enumerate(links[1:]):
                if not link:
                    raise self._fail(link, "of data")
                cuts, part = len(self._cuts), self._measure_size(address + 32 + 8 * k, True)
                size += part
                if len(self._cuts) > cuts:
                    behind = (*links[k + 2 :], links[0])
                    self._seen.update(
                        link for link in behind if link + 24 <= self._size
                    )  # then the file is damaged, not cut
                    self._shorten_list(address, links, k + bool(part))
                    return size
            link_at, address = address + 24, links[0]
        return size

    def _shorten_list(self, address: int, links: tuple[int, ...], keep: int) -> None:
        """Shorten a list to its first `keep` blocks: its links, flags, number and offsets."""
        data = address + 24 + 8 * len(links)
        flags = bytes(self._content[data : data + 4])
        rest = bytes(self._content[data + 8 : data + 8 + 8 * max(keep, 1)])
        content = struct.pack(f"<{2 + keep}Q", 1 + keep, 0, *links[1 : 1 + keep])
        self._condition.mends.append((address + 16, content + flags + struct.pack("<I", keep) + rest))

    def _read_length(self, address: int) -> int:
        (length,) = struct.unpack_from("<Q", self._content, address + 8)
        return int(length)

    def _cut(self, address: int, place: int, value: int) -> int:
        """Note that the block at `address` is incomplete, and the value at `place` in a repaired copy. Return 0, its size."""
        self._cuts.append(address)
        self._condition.mends.append((place, struct.pack("<Q", value)))
        return 0

    def _check_data_block(self, address: int, row_bytes: int) -> None:
        """Check a data block or a list of them. row_bytes: size of the shortest row, if rows must be sorted."""
        self._visit(address, "of data")
        name = bytes(self._content[address : address + 4])
        if name == b"##HL":
            if inner := self._read_links(address, "HL", 1)[0]:
                self._check_data_block(inner, row_bytes)
        elif name in (b"##DL", b"##LD"):
            self._list(address, name[2:].decode(), row_bytes)
        elif name == b"##DZ":
            self._check_compressed(address, row_bytes)
        else:
            if name not in (b"##DT", b"##SD", b"##DV", b"##DI", b"##RD") or address + 24 > self._size:
                raise self._fail(address, "of data")
            (length,) = struct.unpack_from("<Q", self._content, address + 8)
            if self._whole and not 24 <= length <= self._size - address:
                raise self._fail(address, name[2:].decode())
            self._unsorted += min(length, self._size - address) if row_bytes else 0

    def _list(self, address: int, kind: str, row_bytes: int) -> None:
        while address:
            links = self._read_links(address, kind, 1)
            for link in links[1:]:
                if link:
                    self._check_data_block(link, row_bytes)
                elif self._whole and kind == "DL":
                    raise self._fail(link, "of data")
            if address := links[0]:
                self._visit(address, kind)

    def _check_compressed(self, address: int, row_bytes: int) -> None:
        method, size, packed = struct.unpack_from("<2xBx4xQQ", self._content, address + 24)
        if address + 48 + packed > self._size:
            raise self._fail(address, "DZ")
        if size > _MOST_INFLATED or (method in _DEFLATE and size > _BEST_DEFLATE * packed):
            raise make_damage_error(
                self._path,
                f"{packed} bytes of data at byte {address} expand to {size} by their header;"
                f" allowed are {min(_MOST_INFLATED, _BEST_DEFLATE * packed)}",
            )
        if row_bytes:
            if method in _DEFLATE:
                check_inflated(self._path, self._content[address + 48 : address + 48 + packed], size, address)
            check_bytes(f"sorting recording {self._path} needs", size / row_bytes * (row_bytes + PYTHON_BYTES))
            self._unsorted += size
