"""Excel: a sheet of a workbook (.xlsx, .xlsm), whose rows are read as those of a text file, from a file beside.

A separate process unpacks the workbook, with limits of time and memory. The file of text is in the folder of temporary files,
and is removed when nobody uses the recording any more.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any, ClassVar
from weakref import finalize
from zipfile import BadZipFile, ZipFile

from clutch_hil.recordings.channel import Recording
from clutch_hil.recordings.formats.text import Text
from clutch_hil.recordings.unpacked_recording import UnpackedRecording, shown_as
from protocols.files.child_reader import ChildReader

_BEGIN, _BOOK = b"PK\x03\x04", re.compile(r"(?i)(?:.*[/\\])?workbook\d*\.xml")
_TYPES = "[Content_Types].xml"  # part of each file of Office
# s of computing for a sheet: 8 us for each of the cells that are allowed, on a machine of half the speed
_MOST_SECONDS = 400
_LINE = re.compile(r"\bline(s? )(?=\d)")
_NOT_OPTIONS = "delimiter, decimal, encoding or skip_lines"


class Excel:
    """A workbook; `sheet` of [file] names the sheet that is read. decimal and thousands are those of numbers as text."""

    name = "Excel workbook"
    keys: ClassVar[Mapping[str, type]] = {
        "sheet": str,
        **{key: kind for key, kind in Text.keys.items() if key not in ("encoding", "delimiter")},
    }
    order = 0

    def recognises(self, head: bytes, path: Path) -> bool:
        if not head.startswith(_BEGIN):
            return False
        try:
            with ZipFile(path) as archive:
                return _TYPES in archive.namelist() and any(map(_BOOK.fullmatch, archive.namelist()))
        except (OSError, ValueError, NotImplementedError, BadZipFile):
            return False

    def open(self, path: Path, options: Mapping[str, Any]) -> Recording:
        given = dict(options)
        sheet, decimal = given.pop("sheet", ""), "," if given.get("thousands") == "." else "."
        folder = Path(mkdtemp(prefix="clutch-hil-"))
        try:
            target = folder / "recording"
            reader = f"recording {path}"
            arguments = str(path), str(target), sheet, given.get("decimal", decimal)
            name, columns, has_fractions, notes = ChildReader(
                reader, "clutch_hil.recordings.excel.workbook:serve", *arguments, most_seconds=_MOST_SECONDS
            ).ask()
            if columns > 1:  # else cells may hold whole lines of a CSV file
                given["delimiter"] = "\t"
            if has_fractions:  # numbers as text may have another one
                given["decimal"] = arguments[3]
            shown = f"{path} ({name})"
            with shown_as(target, shown, _reword):
                own = Text().open(target, {**given, "encoding": "utf-8"})
            own.notes[:] = [*notes, *map(_reword, own.notes[1 if columns > 1 else 0 :])]
            unpacked = UnpackedRecording(own, target, shown, _reword)
        except BaseException:
            rmtree(folder, ignore_errors=True)
            raise
        finalize(unpacked, rmtree, folder, ignore_errors=True)
        return unpacked


def _reword(message: str) -> str:
    """Return a message about a text file in the words of a sheet."""
    return _LINE.sub(r"row\1", message).replace(_NOT_OPTIONS, "decimal, skip_lines or sheet")
