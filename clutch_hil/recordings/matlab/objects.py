"""Objects of MATLAB classes (timeseries, Dataset, table, ...): their properties, which a file has in one table.

Undocumented by MathWorks. Source: "Subsystem Data Format" of the package mat-io (github.com/foreverallama/matio), read
2026-11-25. The tests read files that mat-io wrote; MATLAB files of 2023 and 2024 with Datasets and a SimulationOutput were
read once.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from math import prod
from typing import Protocol

import numpy as np

from clutch_hil.recordings.matlab.value import SMALL, Cell, LeftOut, Numbers, Struct, Text, Value
from protocols.errors import InputError

_MAGIC = 0xDD000000  # first number of an array of uint32 that stands for an object
_TRAILING = {2: 1, 3: 2, 4: 3}  # version of the table -> cells at its end that are no property
_HEADER = 40  # bytes: version, number of names, eight offsets
_MOST_BYTES = 1 << 26  # of the table: 64 MiB are a million objects
_NAME, _VALUE, _FLAG = 0, 1, 2  # what the third number of a property is: index of a name, of a cell, the value itself


class Objects(Protocol):
    """Where the properties of a file's objects are; known when the whole file has been walked through."""

    def read_properties(self, number: int) -> Mapping[str, Value]: ...

    def find_class_name(self, number: int) -> str: ...


@dataclass(frozen=True)
class Object:
    """An object, or an array of them. numbers: of the elements in `source`; class_number: of their class there."""

    numbers: tuple[int, ...]
    class_number: int
    source: Objects = field(repr=False)
    name: str = ""

    @property
    def class_name(self) -> str:
        return self.name or self.source.find_class_name(self.class_number)

    @property
    def fields(self) -> Mapping[str, Value]:
        return self.read_element(0)

    def read_element(self, number: int) -> Mapping[str, Value]:
        """Properties of an element; where the class saves itself as a structure, also that one's fields."""
        own = self.source.read_properties(self.numbers[number]) if number < len(self.numbers) else {}
        saved = own.get("any")
        return {**own, **saved.read_element(0)} if isinstance(saved, Struct) and saved.size == 1 else own


def read_reference(value: Value, source: Objects, class_name: str = "") -> Value:
    """The object that an array of uint32 stands for; LeftOut where it stands for none that can be read."""
    if isinstance(value, Numbers) and value.small is not None and is_reference(value):
        numbers = [int(number) for number in value.small]
        axes = numbers[1]
        count = prod(numbers[2 : 2 + axes])
        if len(numbers) == axes + count + 3 and count <= SMALL:
            return Object(tuple(numbers[2 + axes : -1]), numbers[-1], source, class_name)
    return LeftOut(f"an object of the class {class_name or 'unknown'}")


def is_reference(value: Numbers) -> bool:
    """Whether an array of numbers stands for an object."""
    few = value.small
    return value.kind == "u" and few is not None and len(few) > 3 and few[0] == _MAGIC and 1 <= few[1] <= len(few) - 3


class ObjectTable:
    """Properties by number of the object. name: of the file. order: of its bytes. Raises InputError where they are damaged.

    is_known: whether its version is one of those that can be read; where not, objects have no properties.
    """

    def __init__(self, name: str, cells: Cell, order: str) -> None:
        self._name = name
        table = cells.items[0] if cells.items else None
        if not isinstance(table, Numbers) or not _HEADER <= table.size <= _MOST_BYTES:
            raise self._make_damage_error()
        raw = table.block.read_exact(table.size).astype(np.uint8).tobytes()
        words = np.frombuffer(raw[: len(raw) // 4 * 4], np.dtype(order + "u4"))
        version, offsets = int(words[0]), [int(offset) for offset in words[2:10]]
        self.is_known = version in _TRAILING
        if not self.is_known:
            return
        if any(a > b or b > len(raw) for a, b in pairwise(offsets[:6])):
            raise self._make_damage_error()
        self._names = [text.decode("utf-8", "replace") for text in raw[_HEADER : offsets[0]].split(b"\x00") if text]
        self._classes, saved, self._objects, own = (
            words[begin // 4 : end // 4] for begin, end in pairwise(offsets[:5])
        )
        self._properties = (_split_blocks(own), _split_blocks(saved))
        self._cells = cells.items[2 : -_TRAILING[version]]
        defaults = cells.items[-1]
        self._defaults = defaults.items if isinstance(defaults, Cell) else ()

    def _make_damage_error(self) -> InputError:
        return InputError(f"{self._name} is damaged: the table of its objects")

    def find_class_name(self, number: int) -> str:
        if not self.is_known:
            return ""
        names = [int(n) for n in self._classes[4 * number : 4 * number + 2]]
        if len(names) < 2 or max(names) > len(self._names):
            raise self._make_damage_error()
        return ".".join(self._names[n - 1] for n in names if n)

    def read_properties(self, number: int) -> Mapping[str, Value]:
        if not self.is_known:
            return {}
        entry = [int(word) for word in self._objects[6 * number : 6 * number + 6]]
        if not number:  # an object that was deleted
            return {}
        if len(entry) < 6:
            raise self._make_damage_error()
        class_number, _, _, saved, own, _ = entry
        blocks, block = (self._properties[1], saved) if saved else (self._properties[0], own)
        properties: dict[str, Value] = {}
        if class_number < len(self._defaults) and isinstance(defaults := self._defaults[class_number], Struct):
            properties.update(defaults.read_element(0))
        if block >= len(blocks):
            raise self._make_damage_error()
        for name, kind, index in blocks[block]:
            if not 0 < name <= len(self._names):
                raise self._make_damage_error()
            if kind == _VALUE and index < len(self._cells):
                properties[self._names[name - 1]] = self._cells[index]
            elif kind == _NAME and 0 < index <= len(self._names):
                properties[self._names[name - 1]] = Text((self._names[index - 1],))
        return properties


def _split_blocks(words: np.ndarray) -> list[list[tuple[int, int, int]]]:
    """Blocks of properties: a count, as many triples, and a word more where their number would be odd."""
    blocks, at = [], 0
    while at < len(words):
        count = int(words[at])
        triples = words[at + 1 : at + 1 + 3 * count].reshape(-1, 3) if at + 1 + 3 * count <= len(words) else ()
        blocks.append([(int(a), int(b), int(c)) for a, b, c in triples])
        at += 1 + 3 * count
        at += at % 2
    return blocks


class LateTable:
    """The table of a file's objects, which may stand behind the variables that use it."""

    def __init__(self) -> None:
        self.table: ObjectTable | None = None

    def read_properties(self, number: int) -> Mapping[str, Value]:
        return self.table.read_properties(number) if self.table else {}

    def find_class_name(self, number: int) -> str:
        return self.table.find_class_name(number) if self.table else ""
