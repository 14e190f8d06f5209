"""Value: one MATLAB value as a file of any level has it. Arrays are not read until they are asked for.

Shapes and indices are MATLAB's: the first index counts fastest. A scalar is an array of shape (1, 1).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any, Protocol

import numpy as np

MOST_DEPTH = (
    32  # of values inside values: real files have less than 15; a file may claim any, and each level costs stack
)
MOST_VALUES = 400_000  # in one file: 2 s to walk through
SMALL = 128  # numbers of an array that is read while the file is walked through: scalars, indices, references


@dataclass(frozen=True)
class Line:
    """The numbers of an array along one axis. fixed: index from 0 of every axis, of which that of `axis` does not count."""

    axis: int
    fixed: tuple[int, ...]


class Block(Protocol):
    """Where an array's numbers are: the part of a file, which knows how to read them."""

    def read(self, shape: tuple[int, ...], lines: Sequence[Line]) -> list[np.ndarray]:
        """Numbers along `lines`, each (n,) float64. Raises InputError."""

    def read_exact(self, count: int) -> np.ndarray:
        """The first `count` numbers, which must be few, as they are stored. Raises InputError."""

    def check(self) -> None:
        """Raise InputError where the file's part is damaged as far as a checksum tells; called after the last reading."""

    @property
    def place(self) -> tuple[int, int]:
        """Order in the file: blocks that are read in this order are read in one pass."""


@dataclass(frozen=True)
class Numbers:
    """An array of numbers. kind: NumPy's, of f, i, u, b. imaginary: whether there is an imaginary part, which is not read."""

    shape: tuple[int, ...]
    kind: str
    block: Block
    imaginary: bool = False
    small: np.ndarray | None = None  # all numbers (n,), where they are few

    @property
    def size(self) -> int:
        return prod(self.shape)

    @property
    def scalar(self) -> float | None:
        """The number, where it is one real one."""
        return float(self.small[0]) if self.size == 1 and self.small is not None and not self.imaginary else None

    def read(self, lines: Sequence[Line]) -> list[np.ndarray]:
        return self.block.read(self.shape, lines)


@dataclass(frozen=True)
class Text:
    """Characters: one string a row of the char array."""

    rows: tuple[str, ...]

    def __str__(self) -> str:
        return self.rows[0].strip() if self.rows else ""


@dataclass(frozen=True)
class Struct:
    """A structure, or an array of them: fields name -> its value in each element."""

    shape: tuple[int, ...]
    fields: Mapping[str, Sequence["Value"]]

    @property
    def size(self) -> int:
        return prod(self.shape)

    def read_element(self, number: int) -> Mapping[str, "Value"]:
        return {name: values[number] for name, values in self.fields.items() if number < len(values)}


@dataclass(frozen=True)
class Cell:
    shape: tuple[int, ...]
    items: Sequence["Value"]


@dataclass(frozen=True)
class LeftOut:
    """What cannot become channels. what: in words, with what to save instead."""

    what: str


Value = Any  # of Numbers, Text, Struct, Cell, LeftOut, and Object in objects.py
SPARSE = LeftOut("a sparse matrix: save full(...)")
FUNCTION = LeftOut("a function handle")
TOO_DEEP = LeftOut(f"nested more than {MOST_DEPTH} levels deep")


def compute_strides(shape: tuple[int, ...]) -> list[int]:
    """Numbers between neighbours along each axis."""
    return [prod(shape[:axis]) for axis in range(len(shape))]


def make_line_slice(shape: tuple[int, ...], line: Line) -> slice:
    """A line as a slice of all numbers in the order of the file."""
    steps = compute_strides(shape)
    start = sum(
        step * index for axis, (step, index) in enumerate(zip(steps, line.fixed, strict=True)) if axis != line.axis
    )
    step = steps[line.axis]
    return slice(start, start + step * (shape[line.axis] - 1) + 1 if shape[line.axis] else start, step)


@dataclass(frozen=True)
class Gathered:
    """A block made of single numbers: a field of a structure array. values (n,)."""

    values: np.ndarray

    def read(self, shape: tuple[int, ...], lines: Sequence[Line]) -> list[np.ndarray]:
        return [self.values[make_line_slice(shape, line)] for line in lines]

    def read_exact(self, count: int) -> np.ndarray:
        return self.values[:count]

    def check(self) -> None:
        pass

    @property
    def place(self) -> tuple[int, int]:
        return (0, 0)


@dataclass(frozen=True)
class Translated:
    """A block of codes that stand for values. values (n,): of the codes 1 to n; any other code stands for none."""

    codes: Block
    values: np.ndarray

    def read(self, shape: tuple[int, ...], lines: Sequence[Line]) -> list[np.ndarray]:
        return [self._translate(codes) for codes in self.codes.read(shape, lines)]

    def read_exact(self, count: int) -> np.ndarray:
        return self._translate(self.codes.read_exact(count))

    def check(self) -> None:
        self.codes.check()

    @property
    def place(self) -> tuple[int, int]:
        return self.codes.place

    def _translate(self, codes: np.ndarray) -> np.ndarray:
        known = (codes >= 1) & (codes <= len(self.values))
        return np.concatenate([[np.nan], self.values])[np.where(known, codes, 0).astype(np.intp)]
