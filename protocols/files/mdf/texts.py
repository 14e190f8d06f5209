"""Texts of an MDF channel: in the rows themselves, or in blocks beside them, at the offsets that the rows have.

They are found here, as the C library of asammdf follows such offsets unchecked.
"""

import struct
from collections.abc import Iterable

import numpy as np

_OFFSET_BYTES, _LENGTH_BYTES = 8, 4  # of an offset in a row; of the length before a text
# MDF 4: data type of a channel -> encoding; MDF 3 has one
_ENCODINGS = {6: "latin-1", 7: "utf-8", 8: "utf-16-le", 9: "utf-16-be"}
_ENCODING_3 = "latin-1"


def cut_cells(rows: bytes, row_bytes: int, first: int, size: int) -> np.ndarray:
    """Return the bytes (n, size) of a channel that begins at byte `first` of each of n whole rows. Raises ValueError."""
    table = np.frombuffer(rows, np.uint8)
    if row_bytes <= 0 or len(table) % row_bytes or first + size > row_bytes:
        raise ValueError("its rows have another size than its header says")
    return np.ascontiguousarray(table.reshape(-1, row_bytes)[:, first : first + size])


def follow_offsets(cells: np.ndarray, beside: bytes) -> Iterable[bytes]:
    """Yield the text at each offset (n, 8 bytes) in `beside`, where its length stands before it. Raises ValueError."""
    for offset in cells.view("<u8").ravel().tolist():
        begin = offset + _LENGTH_BYTES
        if begin > len(beside):
            raise ValueError("a text is beyond the end of its data")
        (length,) = struct.unpack_from("<I", beside, offset)
        if begin + length > len(beside):
            raise ValueError("a text is beyond the end of its data")
        yield beside[begin : begin + length]


def decode(texts: Iterable[bytes], data_type: int, version: int) -> list[str]:
    """Return the texts of a channel of this data type, without what fills its place."""
    encoding = _ENCODINGS.get(data_type, _ENCODING_3) if version == 4 else _ENCODING_3
    return [text.decode(encoding, "replace").partition("\0")[0].strip() for text in texts]
