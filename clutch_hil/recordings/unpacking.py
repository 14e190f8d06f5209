"""Compressed files: what packed a file, told by its first bytes, and its content, unpacked into a file of bounded size.

No size that a file states is believed: bytes are counted while they are unpacked.
"""

import bz2
import gzip
import lzma
import zlib
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any
from zipfile import ZIP_BZIP2, ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile, ZipInfo

import pyarrow as pa

from protocols.errors import InputError, suggest_closest

MOST_UNPACKED = 1 << 31  # bytes: as much as a day of ten columns at 1 kHz of text; /tmp may be memory
_MOST_WORKING = 1 << 27  # bytes that a decoder may take: `xz -9` needs half of them
_PIECE = 1 << 20  # bytes that are unpacked at once
_METHODS = (ZIP_STORED, ZIP_DEFLATED, ZIP_BZIP2)  # of ZIP, whose decoders take little memory
_ENCRYPTED = 1  # bit of a ZIP member's flags
_MOST_NAMED = 10  # members in a message
_BROKEN = (OSError, EOFError, ValueError, RuntimeError, NotImplementedError, zlib.error, lzma.LZMAError, BadZipFile)
_MAGIC = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"\x28\xb5\x2f\xfd": "zstd", b"PK\x03\x04": "ZIP"}


def find_packing(head: bytes) -> str:
    """Return what compressed a file that begins with `head`, "" for none."""
    return next((name for magic, name in _MAGIC.items() if head.startswith(magic)), "")


def unpack(path: Path, packing: str, member: str, target: Path) -> str:
    """Write the content of a compressed file to `target`. Return the name of the ZIP's member, "" for other files.

    member: wanted file of a ZIP, "" for the only one. Raises InputError.
    """
    try:
        if packing == "ZIP":
            with ZipFile(path) as archive:
                info = _choose_member(path, archive, member)
                with archive.open(info) as file:
                    _copy(path, file.read, target)
                return info.filename
        if member:
            raise InputError(
                f"import map: file.member is {member!r}, and {path} is compressed by {packing}, of one file"
            )
        with closing(_READERS[packing](path)) as file:
            _copy(path, file.read, target)
        return ""
    except _BROKEN as error:
        raise InputError(f"recording {path} cannot be unpacked by {packing}: {error or 'it is damaged'}") from None


def _choose_member(path: Path, archive: ZipFile, member: str) -> ZipInfo:
    """Return the member of this name, or the only one. Raises InputError, also for one that cannot be unpacked."""
    members = {info.filename: info for info in archive.infolist() if _is_file(info.filename)}
    if member and member not in members:
        raise InputError(f"recording {path} has no member {member!r}; {suggest_closest(member, members)}")
    if not member and len(members) != 1:
        names = ", ".join(list(members)[:_MOST_NAMED])
        more = f" and {len(members) - _MOST_NAMED} more" if len(members) > _MOST_NAMED else ""
        first = next(iter(members), "")
        raise InputError(
            f"recording {path} is a ZIP archive of {len(members)} files{f': {names}{more}' if members else ''}; allowed is"
            f" one, or member = {first or 'NAME'!r} in [file] of a map, which --list and --draft take, too"
        )
    info = members[member] if member else next(iter(members.values()))
    if info.flag_bits & _ENCRYPTED:
        raise InputError(f"recording {path}: {info.filename} is encrypted; unpack it with its password")
    if info.compress_type not in _METHODS:
        raise InputError(
            f"recording {path}: {info.filename} is packed by method {info.compress_type} of ZIP; allowed are stored, deflate"
            " and bzip2, else unpack it"
        )
    return info


def _is_file(name: str) -> bool:
    """Return whether a member is a file of somebody: no folder, and none that systems add for themselves."""
    last = name.rpartition("/")[2]
    return bool(last) and not name.startswith("__MACOSX/") and last not in (".DS_Store", "Thumbs.db", "desktop.ini")


def _copy(path: Path, read: Callable[[int], bytes], target: Path) -> None:
    """Write what `read` returns to `target`. Raises InputError where it is more than is allowed."""
    size = 0
    with target.open("wb") as out:
        while piece := read(_PIECE):
            size += len(piece)
            if size > MOST_UNPACKED:
                raise InputError(
                    f"recording {path} has more than {MOST_UNPACKED / (1 << 30):g} GiB when unpacked, which is the most that"
                    " is allowed; unpack it, and import the file"
                )
            out.write(piece)


class _XzFile:
    """The content of a file of xz, of one or several streams. `lzma.open` has no bound on the memory of its decoder."""

    def __init__(self, path: Path) -> None:
        self._file, self._rest = path.open("rb"), b""
        self._decoder = self._make_decoder()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def read(self, most: int) -> bytes:
        """Return the next bytes, b"" at the end. Raises LZMAError and EOFError for a damaged file."""
        while True:
            if self._decoder.eof:
                self._rest = self._decoder.unused_data.lstrip(b"\0") or self._file.read(_PIECE).lstrip(b"\0")
                if not self._rest:
                    return b""
                self._decoder = self._make_decoder()
            elif self._decoder.needs_input:
                self._rest = self._rest or self._file.read(_PIECE)
                if not self._rest:
                    raise EOFError("it is cut")
            piece, self._rest = self._decoder.decompress(self._rest, most), b""
            if piece:
                return piece

    @staticmethod
    def _make_decoder() -> lzma.LZMADecompressor:
        return lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_MOST_WORKING)


def _open_zstd(path: Path) -> Any:
    return pa.input_stream(str(path), compression="zstd")  # refuses windows above 128 MiB


_READERS: Mapping[str, Callable[[Path], Any]] = {
    "gzip": gzip.GzipFile, "bzip2": bz2.BZ2File, "xz": _XzFile, "zstd": _open_zstd,
}  # fmt: skip
