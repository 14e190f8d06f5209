"""Objects of a BLF file, checked before python-can reads them: damaged ones can make its reader loop or fill the memory.

Reference: T. Lorenz, vector_blf (layout of objects); python-can, can.io.blf
"""

import zlib
from pathlib import Path

from can.io.blf import (
    CAN_ERROR_EXT,
    CAN_ERROR_EXT_STRUCT,
    CAN_FD_MESSAGE,
    CAN_FD_MESSAGE_64,
    CAN_FD_MSG_64_STRUCT,
    CAN_FD_MSG_STRUCT,
    CAN_MESSAGE,
    CAN_MESSAGE2,
    CAN_MSG_STRUCT,
    FILE_HEADER_STRUCT,
    LOG_CONTAINER,
    LOG_CONTAINER_STRUCT,
    OBJ_HEADER_BASE_STRUCT,
    OBJ_HEADER_V1_STRUCT,
    OBJ_HEADER_V2_STRUCT,
)

from protocols.errors import InputError

_MOST_OBJECT = 64 << 20  # bytes of an object or an unpacked container; Vector's and python-can's have 128 kB
_MOST_UNPACKED = 2 << 30  # bytes of all containers, unpacked one by one
_HEADERS = {1: OBJ_HEADER_V1_STRUCT.size, 2: OBJ_HEADER_V2_STRUCT.size}
_CONTENT = {
    CAN_MESSAGE: CAN_MSG_STRUCT.size,
    CAN_MESSAGE2: CAN_MSG_STRUCT.size,
    CAN_ERROR_EXT: CAN_ERROR_EXT_STRUCT.size,
    CAN_FD_MESSAGE: CAN_FD_MSG_STRUCT.size,
    CAN_FD_MESSAGE_64: CAN_FD_MSG_64_STRUCT.size,
}


def count_sound_objects(path: Path, most: int) -> tuple[int, str]:
    """Return the number of frames before the first damage, at most `most` + 1, and why the rest is missing ("" if none).

    Raises InputError if the file header cannot be read, or its containers unpack to more than is allowed.
    """
    with path.open("rb") as file:
        head = file.read(FILE_HEADER_STRUCT.size)
        if len(head) < FILE_HEADER_STRUCT.size:
            raise InputError(f"log {path} cannot be read: it ends within the head of a BLF file")
        fields = FILE_HEADER_STRUCT.unpack(head)
        head_bytes, stated, size = fields[1], fields[10], path.stat().st_size
        if not FILE_HEADER_STRUCT.size <= head_bytes <= size:
            raise InputError(f"log {path} cannot be read: the head of the BLF file is damaged")
        file.seek(head_bytes)
        frames, total, tail = 0, 0, b""
        while base := file.read(OBJ_HEADER_BASE_STRUCT.size):
            at = file.tell() - len(base)
            if len(base) < OBJ_HEADER_BASE_STRUCT.size:
                return frames, _describe_cut(at)
            signature, _, _, bytes_of_object, kind = OBJ_HEADER_BASE_STRUCT.unpack(base)
            if signature != b"LOBJ" or bytes_of_object < OBJ_HEADER_BASE_STRUCT.size or bytes_of_object > _MOST_OBJECT:
                return frames, f"the log is damaged at byte {at}"
            content = file.read(bytes_of_object - OBJ_HEADER_BASE_STRUCT.size)
            whole = len(content) == bytes_of_object - OBJ_HEADER_BASE_STRUCT.size
            file.read(bytes_of_object % 4)  # padding
            if kind == LOG_CONTAINER:
                unpacked, good = _unpack(path, content)
                total += len(unpacked)
                if total > _MOST_UNPACKED:
                    raise InputError(
                        f"log {path} unpacks to more than {_MOST_UNPACKED >> 30} GiB; allowed is that much"
                    )
                count, tail, sound = _walk(tail + unpacked)
                frames += count
                if frames > most or not sound or (not good and whole):
                    return frames, "" if frames > most else f"the log is damaged in the container at byte {at}"
            if not whole:
                return frames, _describe_cut(at)
    if tail.strip(b"\0"):
        return frames, "the log ends within an object"
    if stated != size:
        return frames, f"the log was not closed, or is cut: its header states {stated} bytes, the file has {size}"
    return frames, ""


def _describe_cut(at: int) -> str:
    return f"the log ends within the object at byte {at}"


def _unpack(path: Path, content: bytes) -> tuple[bytes, bool]:
    """Return the content of a container, and whether it is complete. Raises InputError if it is too large."""
    if len(content) < LOG_CONTAINER_STRUCT.size:
        return b"", False
    method = LOG_CONTAINER_STRUCT.unpack_from(content)[0]
    packed = content[LOG_CONTAINER_STRUCT.size :]
    if method == 0:
        return packed, True
    if method != 2:
        return b"", False
    unpacker = zlib.decompressobj()
    try:
        unpacked = unpacker.decompress(packed, _MOST_OBJECT)
    except zlib.error:
        return b"", False
    if unpacker.unconsumed_tail:
        raise InputError(f"log {path} cannot be read: a container of it unpacks to more than {_MOST_OBJECT >> 20} MiB")
    return unpacked, unpacker.eof


def _walk(data: bytes) -> tuple[int, bytes, bool]:
    """Return the number of frames in `data`, the rest that continues in the next container, and whether all were sound."""
    frames = at = 0
    while True:
        begin = data.find(b"LOBJ", at, at + 8)
        if begin < 0:
            return frames, data[at:], at + 8 > len(data)
        if begin + OBJ_HEADER_BASE_STRUCT.size > len(data):
            return frames, data[at:], True
        _, _, version, size, kind = OBJ_HEADER_BASE_STRUCT.unpack_from(data, begin)
        least = OBJ_HEADER_BASE_STRUCT.size + _HEADERS.get(version, 0)
        if version in _HEADERS:
            least += _CONTENT.get(kind, 0)
        if not least <= size <= _MOST_OBJECT:
            return frames, b"", False
        if begin + size > len(data):
            return frames, data[at:], True
        frames += version in _HEADERS and kind in _CONTENT
        at = begin + size
