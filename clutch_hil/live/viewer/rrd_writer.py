"""RRD writer: write an .rrd file, rerun's format, that gets its name only when it is complete."""

import errno
import os
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import rerun.blueprint as rrb

from clutch_hil.live.viewer.screen import Screen
from clutch_hil.live.viewer.stream import join_batches, make_recording
from protocols.errors import InputError
from protocols.files.output_file import check_new_file, make_part_path, open_part, put_in_place
from protocols.telemetry.batch import Batch

# bytes that stay free: on a full disk rerun's writer may block for ever, and only SIGKILL then ends the process
_LEAST_SPACE = 16 << 20
_GROWTH = 2  # growth of a file per byte of rows: 1.4 measured


class RrdWriter:
    """Write screens, one for each of `prefixes`, to the file at `path`, with their layout. Use as a context manager.

    Leaving it by an exception, or without `finish`, leaves `path` as it was. Raises InputError when the file has another suffix
    or cannot be written.
    """

    def __init__(
        self, path: Path, name: str, blueprint: rrb.Blueprint, timeline: str = "time", prefixes: Sequence[str] = ("",)
    ) -> None:
        _check_suffix(path)
        self.path, self._part = path, make_part_path(path)
        self.rows: Counter[str] = Counter()
        self._finished = False
        self._recording = make_recording(name)
        try:
            self._file = open_part(path)  # locked while it is open
        except OSError as error:
            raise InputError(f"file {path} cannot be written: {error.strerror}") from None
        try:
            check_space(path, 0)
            self._recording.save(self._part, default_blueprint=blueprint)
            self._recording.send_recording_name(name)
            self.screens = [Screen(self._recording, timeline, prefix) for prefix in prefixes]
            for screen in self.screens:
                screen.open()
        except InputError:
            self._remove()
            raise
        except RuntimeError as error:
            self._remove()
            raise InputError(f"file {path} cannot be written: {error}") from None

    def put(self, batches: Iterable[Batch], events: Iterable[dict[str, Any]] = (), screen: int = 0) -> None:
        """Add rows and changes of parameters. Raises InputError when the disk is full."""
        try:
            for batch in join_batches(list(batches)):
                check_space(self.path, batch.rows.nbytes)
                self.screens[screen].log(batch)
                self._recording.flush()
                self.rows[batch.node] += len(batch.rows)
            for event in events:
                self.screens[screen].log_event(event)
        except RuntimeError as error:
            raise InputError(f"file {self.path} cannot be written: {error}") from None

    def finish(self) -> None:
        """Write the rest and name the file. Raises InputError when the disk is full."""
        try:
            self._recording.flush()
            self._recording.disconnect()
            put_in_place(self._part, self.path)
            self._file.close()
        except (OSError, RuntimeError) as error:
            raise InputError(f"file {self.path} cannot be written: {error}") from None
        self._finished = True

    def __enter__(self) -> "RrdWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._finished:
            self._remove()

    def _remove(self) -> None:
        self._recording.disconnect()
        self._part.unlink(missing_ok=True)
        self._file.close()


def check_space(path: Path, size: int) -> None:
    """Raise InputError where the disk of `path`, an .rrd file, has no space for `size` [bytes] more of rows."""
    disk = os.statvfs(path.parent)
    if disk.f_bavail * disk.f_frsize < _LEAST_SPACE + _GROWTH * size:
        raise InputError(f"file {path} cannot be written: {os.strerror(errno.ENOSPC)}")


def check_rrd(path: Path, overwrite: bool = False, inputs: Iterable[Path] = ()) -> Path:
    """Return `path` if an .rrd file can be written there without loss of another file (`check_new_file`). Raises InputError."""
    _check_suffix(path)
    return check_new_file(path, overwrite, inputs)


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() != ".rrd":
        raise InputError(f"file {path} has the suffix {path.suffix or '-'}; a saved view ends with .rrd")
