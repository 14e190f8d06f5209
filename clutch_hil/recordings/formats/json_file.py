"""JSON: tables as programs, web pages and loggers write them, also one object a line; read from a Feather file beside.

A separate process parses the file, with limits of time and memory. The file beside is in the folder of temporary files, and is
removed when nobody uses the recording any more.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any, ClassVar
from weakref import finalize

from clutch_hil.recordings.channel import Recording
from clutch_hil.recordings.formats.arrow_table import ArrowRecording
from clutch_hil.recordings.unpacked_recording import UnpackedRecording, shown_as
from protocols.files.child_reader import ChildReader

# A line of JSON above rows is none: `{"dt": 0.01}` and then names. Lists, one a line, are text, as Python prints them
_BEGIN = re.compile(
    rb"(?!(\xef\xbb\xbf)?\{[^\n]{0,1000}\}[ \r]*\n[^\s{}\[\],])(\xef\xbb\xbf)?\s*(\{\s*\"|\[\s*(\{\s*\"|\[\s*[-\d\"]))"
)
_MOST_SECONDS = 100  # s of computing for a file: 30 us for each kB, on a machine of half the speed


class Json:
    """A JSON file."""

    name = "JSON"
    keys: ClassVar[Mapping[str, type]] = {}
    order = 1

    def recognises(self, head: bytes, path: Path) -> bool:
        return _BEGIN.match(head) is not None

    def open(self, path: Path, options: Mapping[str, Any]) -> Recording:
        folder = Path(mkdtemp(prefix="clutch-hil-"))
        try:
            target = folder / "recording"
            arguments = str(path), str(target)
            server = "clutch_hil.recordings.json_table:serve"
            notes = ChildReader(f"recording {path}", server, *arguments, most_seconds=_MOST_SECONDS).ask()
            with shown_as(target, str(path)):
                own = ArrowRecording(target)
            own.notes[:0] = notes
            unpacked = UnpackedRecording(own, target, str(path))
        except BaseException:
            rmtree(folder, ignore_errors=True)
            raise
        finalize(unpacked, rmtree, folder, ignore_errors=True)
        return unpacked
