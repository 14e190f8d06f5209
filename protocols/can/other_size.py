"""Other size: detects frames, on a bus or in a log, of a bench whose database has another size (`size.py`).

Equation        a CRC is linear: CRC with the data ID a XOR b = CRC with a XOR CRC of the bytes of b from the remainder 0
Assumptions     a damaged frame fits another key by chance in 1 of 8 cases; two damaged frames then fit different keys
"""

from collections import Counter
from collections.abc import Iterable
from functools import cache

from e2e.crc import calculate_crc16

from protocols.can.claim import BOUND
from protocols.can.frames import DBC, Frame, FrameCodec
from protocols.can.size import DATABASE, KEY_BITS, SHIPPED
from protocols.can.version import VERSION_2
from protocols.errors import InputError, join_names

# frames that one other key fits, while no frame is right: two damages by chance agree in 1 of 65 536 cases
_AGREEING = 2
_OF_SESSIONS = frozenset(BOUND.values())  # frames that have another data ID while a supervisor holds the claim


@cache
def _list_keys() -> dict[int, int]:
    """Return change of the CRC by a key -> the key, or the difference of two keys.

    Made when the first frame is wrong.
    """
    keys = (key for key in range(1, KEY_BITS + 1) if not key & ~KEY_BITS)
    return {int(calculate_crc16(bytes((key & 0xFF, key >> 8)), 0, False)): key for key in keys}


def find_key(codec: FrameCodec, data: bytes) -> int:
    """Return the key that, XOR the data ID of `codec`, corrects the CRC of a payload; 0 if the CRC is right, or no key fits."""
    if len(data) != codec.length or codec.version is not VERSION_2 or codec.name in _OF_SESSIONS:
        return 0
    own = bytearray(data)
    codec.version.protect(own, codec.data_id)
    return _list_keys().get(int.from_bytes(own[:2], "little") ^ int.from_bytes(data[:2], "little"), 0)


class SizeWatch:
    """Watches for frames of a bench of another size.

    codecs: those of this process. where: follows `frames X` in the message, such as "on vcan0".
    """

    def __init__(self, codecs: Iterable[FrameCodec], where: str) -> None:
        self._codecs = {codec.can_id: codec for codec in codecs if codec.name not in _OF_SESSIONS}
        self._where = where
        self._names: dict[int, set[str]] = {}
        self._keys: Counter[int] = Counter()
        self._right = False

    def hear(self, frames: Iterable[Frame]) -> None:
        """Check frames. Raises InputError if they are of a bench of another size, until one frame is right."""
        for can_id, data in frames:
            if self._right:
                return
            if codec := self._codecs.get(can_id):
                self._take(codec, data)

    def _take(self, codec: FrameCodec, data: bytes) -> None:
        if codec.is_valid(data):
            self._right = True
        elif key := find_key(codec, data):
            self._keys[key] += 1
            self._names.setdefault(key, set()).add(codec.name)
            if self._keys[key] >= _AGREEING:
                raise InputError(_describe(self._where, self._names[key]))


def _describe(where: str, names: Iterable[str]) -> str:
    """Return the message for frames `names` of a bench of another size."""
    here = f"{DATABASE}={DBC}" if DBC != SHIPPED else f"no {DATABASE}"
    return (
        f"frames {join_names(names)} {where} come from a bench of another size, as their CRC fits other data IDs than the"
        f" database here; every process of a bench needs the same database, and this one has {here} (docs/real_rig.md)"
    )
