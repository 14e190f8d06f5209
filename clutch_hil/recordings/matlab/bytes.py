"""Bytes of a MATLAB file: plain, deflated, or inside other data; read forwards, a bounded part at a time."""

import os
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import IO, Protocol

import numpy as np

from clutch_hil.recordings.matlab.value import Line, make_line_slice
from protocols.errors import InputError
from protocols.files.bounds import MOST_BYTES, check_rows

MOST_INFLATED = MOST_BYTES  # of one file: they are not kept, but take 3 s a GiB; a zip bomb inflates to any number
_STEP = 1 << 18  # bytes that are inflated at once
_BLOCK = 1 << 22  # bytes of numbers that are converted at once


class Bytes(Protocol):
    """A stretch of bytes. Reading in order costs one pass."""

    def read(self, offset: int, size: int) -> bytes:
        """Exactly `size` bytes at `offset`. Raises InputError where there are fewer."""

    def check(self) -> None:
        """Raise InputError where the bytes are damaged as far as a checksum tells."""


class BinaryFile:
    """A file that is open inside a `with`, as often as is wanted. name: for messages."""

    def __init__(self, path: Path) -> None:
        self.path, self.name = path, f"recording {path}"
        self.size = 0
        self._file: IO[bytes] | None = None

    def __enter__(self) -> "BinaryFile":
        try:
            self._file = self.path.open("rb")
            self.size = self._file.seek(0, os.SEEK_END)
        except OSError as error:
            raise InputError(f"{self.name} cannot be read: {error.strerror or error}") from None
        return self

    def __exit__(self, *_: object) -> None:
        if self._file:
            self._file.close()

    def read(self, offset: int, size: int) -> bytes:
        """Exactly `size` bytes at `offset`. Raises InputError where there are fewer."""
        assert self._file is not None
        if offset + size > self.size:
            raise InputError(f"{self.name} is cut or damaged: {size} bytes are missing at byte {offset}")
        try:
            self._file.seek(offset)
            raw = self._file.read(size)
        except OSError as error:
            raise InputError(f"{self.name} cannot be read: {error.strerror or error}") from None
        if len(raw) < size:
            raise InputError(f"{self.name} became shorter while it was read")
        return raw


@dataclass
class PlainBytes:
    """Bytes of a file from `begin` to `end`."""

    file: BinaryFile
    begin: int
    end: int

    def read(self, offset: int, size: int) -> bytes:
        if self.begin + offset + size > self.end:
            raise InputError(f"{self.file.name} is damaged: {size} bytes are missing at byte {self.begin + offset}")
        return self.file.read(self.begin + offset, size)

    def check(self) -> None:
        pass


class DeflatedBytes:
    """What the bytes of a file from `begin` to `end` inflate to. Only a small part is in memory."""

    def __init__(self, file: BinaryFile, begin: int, end: int, budget: list[int]) -> None:
        self._name, self._file, self._begin, self._end = file.name, file, begin, end
        self._budget = budget  # bytes that all of a file's variables may still inflate to
        self._reached = 0  # furthest byte that was charged to the budget
        self._restart()

    def _restart(self) -> None:
        self._inflater, self._next, self._tail = zlib.decompressobj(), self._begin, b""
        self._offset, self._buffer = 0, b""  # bytes before, and those at hand

    def _inflate(self) -> bool:
        """Take further bytes in place of those at hand; whether there are any."""
        self._offset += len(self._buffer)
        self._buffer = b""
        try:
            while not self._buffer and not self._inflater.eof:
                if not self._tail:
                    self._tail = self._file.read(self._next, min(_STEP, self._end - self._next))
                    self._next += len(self._tail)
                    if not self._tail:
                        return False
                self._buffer = self._inflater.decompress(self._tail, _STEP)
                self._tail = self._inflater.unconsumed_tail
        except zlib.error as error:
            raise InputError(
                f"{self._name} is damaged: the deflated variable at byte {self._begin} ({error})"
            ) from None
        new = self._offset + len(self._buffer) - self._reached
        if new > 0:
            self._reached += new
            self._budget[0] -= new
            if self._budget[0] < 0:
                raise InputError(
                    f"{self._name} inflates to more than {MOST_INFLATED / (1 << 30):g} GiB; save fewer variables in one file"
                )
        return bool(self._buffer)

    def read(self, offset: int, size: int) -> bytes:
        if offset < self._offset:
            self._restart()
        parts, missing = [], size
        while True:
            begin = offset + size - missing - self._offset
            if begin < len(self._buffer):
                part = self._buffer[begin : begin + missing]
                parts.append(part)
                missing -= len(part)
            if not missing:
                return b"".join(parts)
            if not self._inflate():
                raise InputError(
                    f"{self._name} is cut or damaged: the deflated variable at byte {self._begin} is too short"
                )

    def check(self) -> None:
        while self._inflate():
            pass
        if not self._inflater.eof:
            raise InputError(
                f"{self._name} is cut or damaged: the deflated variable at byte {self._begin} is too short"
            )


@dataclass
class InnerBytes:
    """Bytes that are the numbers of another variable, from its byte `begin` on, `size` of them."""

    outer: Bytes
    begin: int
    size: int
    name: str

    def read(self, offset: int, size: int) -> bytes:
        if offset + size > self.size:
            raise InputError(f"{self.name} is damaged: the data of its objects are too short")
        return self.outer.read(self.begin + offset, size)

    def check(self) -> None:
        self.outer.check()


@dataclass(frozen=True)
class NumberBlock:
    """Numbers of `dtype` from byte `offset` of `source` on. variable: number of the variable in the file."""

    name: str
    source: Bytes
    offset: int
    dtype: np.dtype
    variable: int

    @property
    def place(self) -> tuple[int, int]:
        return (self.variable, self.offset)

    def check(self) -> None:
        self.source.check()

    def read_exact(self, count: int) -> np.ndarray:
        raw = self.source.read(self.offset, count * self.dtype.itemsize)
        return np.frombuffer(raw, self.dtype)

    def read(self, shape: tuple[int, ...], lines: Sequence[Line]) -> list[np.ndarray]:
        """See Block.read. Lines whose numbers are neighbours are read alone; all others in one pass through the array."""
        slices = [make_line_slice(shape, line) for line in lines]
        check_rows(f"{self.name} has", max((shape[line.axis] for line in lines), default=0), len(lines))
        values = [np.empty(shape[line.axis]) for line in lines]
        for one, numbers in zip(slices, values, strict=True):
            if one.step == 1:
                self._fill(numbers, one.start)
        if any(one.step > 1 for one in slices):
            self._fill_strided(prod(shape), slices, values)
        return values

    def _fill(self, numbers: np.ndarray, start: int) -> None:
        item = self.dtype.itemsize
        for begin in range(0, len(numbers), most := _BLOCK // item):
            count = min(most, len(numbers) - begin)
            raw = self.source.read(self.offset + (start + begin) * item, count * item)
            numbers[begin : begin + count] = np.frombuffer(raw, self.dtype)

    def _fill_strided(self, size: int, slices: Sequence[slice], values: Sequence[np.ndarray]) -> None:
        item = self.dtype.itemsize
        for begin in range(0, size, most := _BLOCK // item):
            count = min(most, size - begin)
            part = np.frombuffer(self.source.read(self.offset + begin * item, count * item), self.dtype)
            for one, numbers in zip(slices, values, strict=True):
                if one.step == 1:
                    continue
                first = max(0, -(-(begin - one.start) // one.step))  # row of the first number in this part
                last = min(len(numbers), -(-(begin + count - one.start) // one.step))
                if last > first:
                    numbers[first:last] = part[one.start + first * one.step - begin :: one.step][: last - first]
