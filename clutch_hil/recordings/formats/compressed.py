"""Compressed: a recording of any other format that is compressed by gzip, bzip2, xz, zstd or ZIP, read from a file beside.

The file is in the folder of temporary files, and is removed when nobody uses the recording any more.
"""

from collections.abc import Mapping
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any
from weakref import finalize

from clutch_hil.recordings.channel import Recording
from clutch_hil.recordings.foreign import describe_foreign
from clutch_hil.recordings.format import load_formats, open_recording, recognise
from clutch_hil.recordings.unpacked_recording import UnpackedRecording, shown_as
from clutch_hil.recordings.unpacking import find_packing, unpack
from protocols.errors import InputError
from protocols.input_file import read_head


class Compressed:
    """A compressed file of any format; `member` of [file] names the file of a ZIP archive that has several."""

    name = "compressed file"
    order = 0

    @property
    def keys(self) -> Mapping[str, type]:
        """All entries of other formats: which ones are allowed is known when the file is unpacked."""
        others = (one.keys for one in load_formats() if not isinstance(one, Compressed))
        return {"member": str, **{key: kind for keys in others for key, kind in keys.items()}}

    def recognises(self, head: bytes, path: Path) -> bool:
        return bool(find_packing(head)) and not describe_foreign(head)

    def open(self, path: Path, options: Mapping[str, Any]) -> Recording:
        packing, given = find_packing(read_head(path)), dict(options)
        if "dbc" in given:
            from clutch_hil.recordings.bus_recording import find_database  # loads what decodes frames: 0.3 s

            given["dbc"] = str(find_database(path, given["dbc"]))
        folder = Path(mkdtemp(prefix="clutch-hil-"))
        try:
            target = folder / "recording"
            member = unpack(path, packing, given.pop("member", ""), target)
            shown = f"{path} ({member})" if member else str(path)
            with shown_as(target, shown):
                inside = recognise(target)
                if isinstance(inside, Compressed):
                    raise InputError(f"recording {shown} holds another compressed file; unpack it")
                unpacked = UnpackedRecording(open_recording(target, given), target, shown)
        except BaseException:
            rmtree(folder, ignore_errors=True)
            raise
        finalize(unpacked, rmtree, folder, ignore_errors=True)
        unpacked.notes.insert(0, f"unpacked by {packing}{f': {member}' if member else ''}, which is {inside.name}")
        return unpacked
