"""Level 5 of MATLAB's MAT-files (`save -v6`, `-v7`, and before 7.3 by default), also as Octave and SciPy write it.

The tags are walked through here, with every length checked against what is there, so that nothing is allocated by a number in a
file and only the asked-for arrays are read. (scipy.io reads whole variables, and ends the process on deeply nested ones.)
Source: MathWorks, MAT-File Format, version R2025a, chapter "Level 5 MAT-File Format". Objects: objects.py.
"""

import struct
from collections.abc import Iterator
from math import prod

import numpy as np

from clutch_hil.recordings.matlab.bytes import (
    MOST_INFLATED,
    BinaryFile,
    Bytes,
    DeflatedBytes,
    InnerBytes,
    NumberBlock,
    PlainBytes,
)
from clutch_hil.recordings.matlab.objects import LateTable, ObjectTable, is_reference, read_reference
from clutch_hil.recordings.matlab.value import (
    FUNCTION,
    MOST_DEPTH,
    MOST_VALUES,
    SMALL,
    SPARSE,
    TOO_DEEP,
    Cell,
    LeftOut,
    Numbers,
    Struct,
    Text,
    Value,
)  # fmt: skip
from protocols.errors import InputError

HEADER = 128  # bytes before the first element
_MATRIX, _DEFLATED = 14, 15  # types of elements
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}  # and of numbers
_ENCODINGS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}  # and of characters
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17  # classes of arrays
_KINDS = {6: "f", 7: "f", 8: "i", 9: "u", 10: "i", 11: "u", 12: "i", 13: "u", 14: "i", 15: "u"}  # class -> NumPy's kind
_IS_COMPLEX, _IS_LOGICAL = 0x800, 0x200  # flags
_MOST_TEXT = 1 << 20  # bytes of one text: a longer one is no name, unit or remark
_MOST_AXES = 16
_TABLE = "FileWrapper__"  # class of the table of all objects


def is_level5(head: bytes) -> bool:
    """Whether a file that begins with `head` is of level 5."""
    return len(head) >= HEADER and head[124:HEADER] in (b"\x00\x01IM", b"\x01\x00MI")


def read_level5(file: BinaryFile) -> dict[str, Value]:
    """All variables of an open file. Raises InputError."""
    head = file.read(0, HEADER)
    order = "<" if head[126:] == b"IM" else ">"
    (subsystem,) = struct.unpack(order + "Q", head[116:124])
    reader = _Reader(file.name, order)
    variables: dict[str, Value] = {}
    for variable, (begin, source, length) in enumerate(_read_elements(file, order)):
        reader.variable = variable + 1
        key, value = reader.read_matrix(source, 0, length, 0)
        if not isinstance(value, Numbers) or value.small is not None:
            source.check()  # it has been read to its end
        if key:
            variables[f"{key} (2)" if key in variables else key] = value
        elif begin == subsystem and isinstance(value, Numbers):
            reader.read_objects(value)
    return variables


def _read_elements(file: BinaryFile, order: str) -> Iterator[tuple[int, Bytes, int]]:
    """For each element of the file: where its tag is, the bytes of the array in it, and how many they are."""
    name, size, budget = file.name, file.size, [MOST_INFLATED]
    position = HEADER
    while position < size:
        if position + 8 > size:
            raise InputError(f"{name} is cut: it ends inside the tag at byte {position}")
        kind, length = struct.unpack(order + "II", file.read(position, 8))
        begin, position = position, position + 8 + length
        if position > size:
            raise InputError(
                f"{name} is cut or damaged: the variable at byte {begin} needs {position - size} more bytes"
            )
        if kind == _DEFLATED:
            packed = DeflatedBytes(file, begin + 8, position, budget)
            kind, length = struct.unpack(order + "II", packed.read(0, 8))
            source: Bytes = InnerBytes(packed, 8, length, name)
        else:
            source = PlainBytes(file, begin + 8, position)
        if kind != _MATRIX:
            raise InputError(
                f"{name} is damaged: at byte {begin} stands an element of type {kind}; allowed is 14, an array"
            )
        yield begin, source, length


class _Reader:
    """Reads arrays. A place in a file is `source` and a byte in it; an array ends before byte `end`."""

    def __init__(self, name: str, order: str) -> None:
        self.name, self.variable = name, 0
        self._order, self._left = order, MOST_VALUES
        self._objects, self._inside_objects = LateTable(), False

    def make_damage_error(self, what: str) -> InputError:
        return InputError(f"{self.name} is damaged: {what} in variable number {self.variable}")

    def _read_tag(self, source: Bytes, at: int, end: int) -> tuple[int, int, int, int]:
        """Type and size of the element at byte `at`, where its data begin, and where the next element begins."""
        if at + 8 > end:
            raise self.make_damage_error("an element is missing")
        kind, size = struct.unpack(self._order + "II", source.read(at, 8))
        if kind >> 16:  # up to four bytes of data are in the tag
            kind, size, begin, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
            if size > 4:
                raise self.make_damage_error(f"{size} bytes in a tag, where 4 are allowed,")
        else:
            begin = at + 8
            after = begin + size + (-size % 8 if kind != _MATRIX else 0)
        if begin + size > end:
            raise self.make_damage_error(f"an element of {size} bytes, where {end - begin} are left,")
        return kind, size, begin, min(after, end) if kind != _MATRIX else after

    def _read_data(self, source: Bytes, at: int, end: int, most: int = _MOST_TEXT) -> tuple[bytes, int]:
        """Data of the small element at byte `at`, and where the next begins."""
        _, size, begin, after = self._read_tag(source, at, end)
        if size > most:
            raise self.make_damage_error(f"{size} bytes, where {most} are allowed,")
        return source.read(begin, size), after

    def read_matrix(self, source: Bytes, at: int, end: int, depth: int) -> tuple[str, Value]:
        """Name and value of the array whose content begins at byte `at`."""
        self._left -= 1
        if self._left < 0:
            raise InputError(
                f"{self.name} has more than {MOST_VALUES} values in structures and cells; save fewer of them"
            )
        if at == end:
            return "", Cell((0, 0), ())
        if depth > MOST_DEPTH:
            return "", TOO_DEEP
        raw, at = self._read_data(source, at, end, 16)
        if len(raw) != 8:
            raise self.make_damage_error(f"flags of {len(raw)} bytes, where 8 are allowed,")
        flags = struct.unpack(self._order + "II", raw)[0]
        kind = flags & 0xFF
        if kind == _OPAQUE:
            return self._read_opaque(source, at, end, depth)
        raw, at = self._read_data(source, at, end, 4 * _MOST_AXES)
        shape = tuple(struct.unpack(f"{self._order}{len(raw) // 4}i", raw[: len(raw) // 4 * 4]))
        if len(shape) < 2 or min(shape) < 0:
            raise self.make_damage_error(f"an array of the shape {shape}")
        raw, at = self._read_data(source, at, end)
        name = raw.decode("utf-8", "replace").rstrip("\x00")
        if kind in _KINDS:
            return name, self._read_numbers(source, at, end, shape, flags)
        if kind == _CHAR:
            return name, self._read_text(source, at, end, shape)
        if kind == _CELL:
            items = self._read_items(source, at, end, prod(shape), depth)
            return name, Cell(shape, items)
        if kind in (_STRUCT, _OBJECT):
            return name, self._read_struct(source, at, end, shape, depth, is_object=kind == _OBJECT)
        if kind == _SPARSE:
            return name, SPARSE
        if kind == _FUNCTION:
            return name, FUNCTION
        raise self.make_damage_error(f"an array of the unknown class {kind}")

    def _read_numbers(self, source: Bytes, at: int, end: int, shape: tuple[int, ...], flags: int) -> Value:
        if not prod(shape):
            return Numbers(shape, "f", NumberBlock(self.name, source, at, np.dtype("f8"), self.variable))
        stored, size, begin, _ = self._read_tag(source, at, end)
        if stored not in _STORED:
            raise self.make_damage_error(f"numbers of the unknown type {stored}")
        dtype = np.dtype(self._order + _STORED[stored])
        if size != prod(shape) * dtype.itemsize:
            raise self.make_damage_error(f"{size} bytes for {prod(shape)} numbers")
        block = NumberBlock(self.name, source, begin, dtype, self.variable)
        kind = "b" if flags & _IS_LOGICAL else _KINDS[flags & 0xFF]
        few = block.read_exact(prod(shape)) if prod(shape) <= SMALL else None
        numbers = Numbers(shape, kind, block, bool(flags & _IS_COMPLEX), few)
        if self._inside_objects and is_reference(numbers):
            return read_reference(numbers, self._objects)
        return numbers

    def _read_text(self, source: Bytes, at: int, end: int, shape: tuple[int, ...]) -> Value:
        if not prod(shape):
            return Text(())
        stored, size, begin, _ = self._read_tag(source, at, end)
        if stored not in _ENCODINGS:
            raise self.make_damage_error(f"characters of the unknown type {stored}")
        if size > _MOST_TEXT or prod(shape) > _MOST_TEXT:
            return LeftOut(f"a text of {size} bytes")
        encoding = _ENCODINGS[stored]
        if encoding in ("utf-16", "utf-32"):
            encoding += "-le" if self._order == "<" else "-be"
        text = source.read(begin, size).decode(encoding, "replace")
        rows = shape[0]
        return Text(tuple(text[row::rows] for row in range(min(rows, len(text)))))

    def _read_items(self, source: Bytes, at: int, end: int, count: int, depth: int) -> list[Value]:
        if count > (end - at) // 8:  # every item has a tag
            raise self.make_damage_error(f"{count} items in {end - at} bytes")
        items = []
        for _ in range(count):
            kind, size, begin, at = self._read_tag(source, at, end)
            if kind != _MATRIX:
                raise self.make_damage_error(f"an element of type {kind} in a cell or structure, where 14 is allowed,")
            items.append(self.read_matrix(source, begin, begin + size, depth + 1)[1])
        return items

    def _read_struct(
        self, source: Bytes, at: int, end: int, shape: tuple[int, ...], depth: int, is_object: bool
    ) -> Value:
        if is_object:
            _, at = self._read_data(source, at, end)  # the class's name
        raw, at = self._read_data(source, at, end, 8)
        length = struct.unpack(self._order + "i", raw)[0] if len(raw) == 4 else 0
        names, at = self._read_data(source, at, end)
        if length <= 0:
            if names:
                raise self.make_damage_error(f"field names of {length} bytes")
            return Struct(shape, {})
        raws = [names[begin : begin + length] for begin in range(0, len(names), length)]
        keys = _make_unlike([raw.split(b"\x00")[0].decode("utf-8", "replace") for raw in raws])
        items = self._read_items(source, at, end, prod(shape) * len(keys), depth)
        return Struct(shape, {key: items[number :: len(keys)] for number, key in enumerate(keys)})

    def _read_opaque(self, source: Bytes, at: int, end: int, depth: int) -> tuple[str, Value]:
        texts = []
        for _ in range(3):  # name, type system, class
            raw, at = self._read_data(source, at, end)
            texts.append(raw.decode("utf-8", "replace").rstrip("\x00"))
        name, _, class_name = texts
        kind, size, begin, _ = self._read_tag(source, at, end)
        if kind != _MATRIX:
            raise self.make_damage_error(f"an object of the class {class_name} whose data are of type {kind}")
        data = self.read_matrix(source, begin, begin + size, depth + 1)[1]
        return name, data if class_name == _TABLE else read_reference(data, self._objects, class_name)

    def read_objects(self, numbers: Numbers) -> None:
        """Take the objects of the file, which are a file themselves, stored as the numbers of an array without name."""
        block = numbers.block
        if not isinstance(block, NumberBlock) or numbers.size < 16:
            return
        source = InnerBytes(block.source, block.offset, numbers.size * block.dtype.itemsize, self.name)
        self._order = "<" if source.read(2, 2) == b"IM" else ">"
        kind, length = struct.unpack(self._order + "II", source.read(8, 8))
        if kind != _MATRIX or 16 + length > source.size:
            raise self.make_damage_error("the data of objects")
        self._inside_objects = True
        _, matrix = self.read_matrix(source, 16, 16 + length, 0)
        for table in matrix.fields.get("MCOS", ()) if isinstance(matrix, Struct) else ():
            if isinstance(table, Cell):
                self._objects.table = ObjectTable(self.name, table, self._order)


def _make_unlike(names: list[str]) -> list[str]:
    """Names, of which the second and further ones that are alike get their number: MATLAB writes no such, others do."""
    counts: dict[str, int] = {}
    unlike = []
    for name in names:
        counts[name] = counts.get(name, 0) + 1
        unlike.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
    return unlike
