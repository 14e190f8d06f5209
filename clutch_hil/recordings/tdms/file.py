"""A TDMS file, opened so that no number in it asks for more than there is, with what its segments say about times."""

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from clutch_hil.recordings.tdms.times import TIMING, Statement
from protocols.errors import InputError

if TYPE_CHECKING:
    from nptdms import TdmsFile

INDEX_MAGIC = b"TDSh"  # first bytes of the index beside a file


class BoundedFile(io.BufferedReader):
    """A file of which no more is read than there is, whatever number a reader asks for."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._size = path.stat().st_size
        if self.peek(4)[:4] == INDEX_MAGIC:
            raise InputError(f"recording {path} is the index of a TDMS file; give the .tdms file itself")

    def read(self, size: int | None = -1) -> bytes:
        left = max(self._size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))


def open_file(path: Path) -> tuple["TdmsFile", dict[str, list[Statement]]]:
    """A file, and by the path of a channel what its segments say about its times: of nptdms each outlives only the last."""
    from nptdms import TdmsFile
    from nptdms.reader import _number_of_segment_values

    statements: dict[str, list[Statement]] = {}

    class Listener(TdmsFile):
        def _read_file(self, reader: Any, *options: Any) -> None:
            add_rows, add_properties = reader._update_object_metadata, reader._update_object_properties
            segments: list[Any] = [None]  # the one that is read

            def take_rows(segment: Any) -> None:
                segments[0] = segment
                add_rows(segment)

            def take_properties(properties: Any) -> None:
                add_properties(properties)
                number = len(reader._segments) + 1
                for name, value in (properties or {}).items():
                    if any(key in TIMING for key, _ in value):
                        known = reader.object_metadata[name]
                        stored = segments[0].get_segment_object(name)
                        rows = _number_of_segment_values(stored, segments[0]) if stored is not None else 0
                        values = tuple(map(known.properties.get, TIMING))
                        before = statements.setdefault(name, [])
                        if not before or repr(before[-1].properties) != repr(values):
                            before.append(Statement(number, known.num_values - rows, values))

            reader._update_object_metadata, reader._update_object_properties = take_rows, take_properties
            super()._read_file(reader, *options)

    file = Listener(BoundedFile(path), raw_timestamps=True, read_metadata_only=True, keep_open=True)
    return file, statements
