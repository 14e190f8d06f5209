"""Level 4 of MATLAB's MAT-files (`save -v4`, and many small tools): arrays of numbers and texts, one after the other.

Source: MathWorks, MAT-File Format, version R2025a, chapter "Level 4 MAT-File Format". It has no first bytes of its own.
"""

import re
import struct

import numpy as np

from clutch_hil.recordings.matlab.bytes import BinaryFile, NumberBlock, PlainBytes
from clutch_hil.recordings.matlab.value import SMALL, SPARSE, LeftOut, Numbers, Text, Value
from protocols.errors import InputError

_HEADER = 20  # bytes: type, rows, columns, whether there is an imaginary part, length of the name
_DTYPES = ("f8", "f4", "i4", "i2", "u2", "u1")
_FULL, _TEXT, _SPARSE = 0, 1, 2
_LONGEST_NAME = 64  # bytes with the null at the end: MATLAB's longest name has 63 characters
_NAME = re.compile(rb"[A-Za-z][A-Za-z0-9_.]*\x00+")
_MOST_TEXT = 1 << 20  # characters


def _read_header(raw: bytes) -> tuple[str, np.dtype, int, int, int, int, int] | None:
    """Byte order, type of the numbers, kind of array, rows, columns, imaginary part, length of the name; None for no header."""
    for order, machine in (("<", 0), (">", 1)):
        kind, rows, columns, imaginary, length = struct.unpack(order + "5i", raw)
        thousands, hundreds, stored, array = kind // 1000, kind // 100 % 10, kind // 10 % 10, kind % 10
        if (thousands, hundreds) != (machine, 0) or stored >= len(_DTYPES) or array > _SPARSE:
            continue
        if min(rows, columns) >= 0 and imaginary in (0, 1) and 1 < length <= _LONGEST_NAME:
            return order, np.dtype(order + _DTYPES[stored]), array, rows, columns, imaginary, length
    return None


def is_level4(head: bytes) -> bool:
    """Whether a file that begins with `head` is of level 4: its first header has only allowed values, and a name."""
    header = _read_header(head[:_HEADER]) if len(head) > _HEADER else None
    return header is not None and bool(_NAME.fullmatch(head[_HEADER : _HEADER + header[-1]]))


def read_level4(file: BinaryFile) -> dict[str, Value]:
    """All variables of an open file. Raises InputError."""
    name, size = file.name, file.size
    variables: dict[str, Value] = {}
    at = 0
    while at < size:
        header = _read_header(file.read(at, _HEADER)) if at + _HEADER < size else None
        key = file.read(at + _HEADER, min(header[-1], size - at - _HEADER)) if header else b""
        if header is None or not _NAME.fullmatch(key):
            raise InputError(f"{name} is cut or damaged: at byte {at} stands no variable of a MATLAB file of level 4")
        _, dtype, array, rows, columns, imaginary, length = header
        begin = at + _HEADER + length
        at = begin + rows * columns * dtype.itemsize * (1 + imaginary)
        if at > size:
            missing = at - size
            raise InputError(
                f"{name} is cut or damaged: {key.split(bytes(1))[0].decode()!r} needs {missing} more bytes"
            )
        source = PlainBytes(file, begin, at)
        block = NumberBlock(name, source, 0, dtype, len(variables))
        count, shape = rows * columns, (rows, columns)
        value: Value
        if array == _SPARSE:
            value = SPARSE
        elif array == _FULL:
            value = Numbers(
                shape, dtype.kind, block, bool(imaginary), block.read_exact(count) if count <= SMALL else None
            )
        elif count > _MOST_TEXT:
            value = LeftOut(f"a text of {count} characters")
        else:
            codes = block.read_exact(count).reshape(columns, rows)
            value = Text(tuple("".join(chr(int(code) & 0xFF) for code in codes[:, row]) for row in range(rows)))
        variables[key.split(b"\x00")[0].decode()] = value
    return variables
