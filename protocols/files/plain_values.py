"""Plain values through a pipe: texts, numbers, lists, dictionaries with names, and arrays of numbers; nothing that runs code.

One line of JSON contains the value, with references in place of arrays, and the type and shape of each array. The bytes of the
arrays follow in order. Lists and tuples arrive as lists.
"""

import json
from math import prod
from typing import IO, Any

import numpy as np

_MOST_LINE = 64 << 20  # bytes: a file of 100 000 channels has 30 MB of names
_MOST_ARRAY = 4 << 30  # bytes: a file has 1 GiB of numbers at most (matlab.py)
_KINDS = "fiubcU"  # kinds of NumPy types that hold numbers or text, not objects
_ARRAY = (
    "array"  # {"array": "3"} refers to array number 3; with a number or an array as value it is an ordinary dictionary
)


def write_value(value: Any, stream: IO[bytes]) -> None:
    """Write a value. Raises TypeError or ValueError for a value that is not plain."""
    arrays: list[np.ndarray] = []

    def name(part: Any) -> Any:
        if isinstance(part, np.generic):
            return part.item()
        if not isinstance(part, np.ndarray) or part.dtype.kind not in _KINDS:
            raise TypeError(f"{type(part).__name__} is not a plain value")
        arrays.append(np.ascontiguousarray(part).reshape(part.shape))
        return {_ARRAY: str(len(arrays) - 1)}

    text = json.dumps(value, default=name)
    kinds = json.dumps([[array.dtype.str, array.shape] for array in arrays])
    stream.write(f"[{kinds}, {text}]\n".encode())
    for array in arrays:
        stream.write(array.tobytes() if array.dtype.kind == "U" else array.reshape(-1).view(np.uint8).data)
    stream.flush()


def read_value(stream: IO[bytes]) -> Any:
    """Read a value. Raises EOFError at the end of the stream, ValueError for data that `write_value` does not write."""
    line = stream.readline(_MOST_LINE)
    if not line.endswith(b"\n"):
        raise EOFError
    arrays: list[np.ndarray] = []

    def put_in(part: dict[str, Any]) -> Any:
        number = part.get(_ARRAY)
        if len(part) != 1 or not isinstance(number, str):
            return part
        if not number.isdecimal() or int(number) >= len(arrays):
            raise ValueError(f"array {number[:60]} is not among {len(arrays)}")
        return arrays[int(number)]

    whole = json.loads(line)
    if not isinstance(whole, list) or len(whole) != 2 or not isinstance(whole[0], list):
        raise ValueError("a plain value has its arrays and itself")
    arrays += [_read_array(stream, described) for described in whole[0]]
    return json.loads(line, object_hook=put_in)[1]


def _read_array(stream: IO[bytes], described: Any) -> np.ndarray:
    try:
        kind, shape = np.dtype(str(described[0])), tuple(int(length) for length in described[1])
    except (TypeError, LookupError) as error:
        raise ValueError(f"an array is described by {str(described)[:60]}") from error
    size = prod(shape) * kind.itemsize
    if kind.kind not in _KINDS or min(shape, default=0) < 0 or size > _MOST_ARRAY:
        raise ValueError(f"an array of type {kind} and shape {shape} is not allowed")
    data = bytearray(stream.read(size))
    if len(data) != size:
        raise EOFError
    return np.frombuffer(data, kind).reshape(shape)
