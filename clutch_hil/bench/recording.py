"""Recording: join the rows of all nodes into a run file as they arrive.

A run has one row for each sample of the plant, at a constant rate. Row k also contains the controller's terms of the cycle
that answered sample k, as `controller_...`, and those of clutch b's controller as `controller_b_...`. Where no cycle answered
it, the terms of the previous cycle still act, and row k contains these; `controller_sample_tick` shows which. Before the first
cycle the terms are NaN.
"""

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError
from protocols.files.disk import Disk
from protocols.files.journal import Journal
from protocols.files.output_file import make_folder, without_new_folders
from protocols.files.runs import RunWriter
from protocols.input_file import check_name
from protocols.node import Column

TORQUE_DEMAND = Column("torque_demand_nm", "Nm", "the controller's M_d")  # of clutch a's controller on a rig of two
# Plant rows that may wait for the controller's answer: 60 s at 1 kHz. Older rows are written without it. A recorder that joins
# a running bench may receive the controller's past rows late.
_MOST_WAITING = 60_000
# Endings of the files that commands write. A folder with such a name would be taken for the file.
_FILE_ENDINGS = (".parquet", ".mf4", ".csv", ".json", ".toml", ".html", ".png", ".rrd")
_FEWEST_LATE = 20_000  # of the older rows that are written together: the remaining rows are copied each time


class TooShortError(InputError):
    """Raised when a run has too few rows."""


def make_writable(folder: Path) -> Path:
    """Return `folder`, created if missing. Raises InputError when nothing can be written there.

    A new folder may not have the name of a file that the bench writes. Who gives such a name expects a file there.
    """
    check_name(folder, "folder")
    if folder.suffix in _FILE_ENDINGS and not folder.exists():
        plain = folder.with_suffix("")
        raise InputError(
            f"{folder} would be a folder, but its name ends like that of a file; give a folder, such as {plain}"
        )
    make_folder(folder)
    if not os.access(folder, os.W_OK):
        raise InputError(f"folder {folder} cannot be written")
    return folder


@contextlib.contextmanager
def writable_folder(folder: Path) -> Iterator[Path]:
    """Yield `folder`, see `make_writable`. A new folder that is still empty after an exception is removed again."""
    with without_new_folders(folder):
        yield make_writable(folder)


def reserve_run_path(folder: Path, name: str, suffix: str = ".parquet") -> Path:
    """Reserve a path for a new file in a `make_writable` folder, named by date and time and unique among processes.

    Raises InputError.
    """
    stem = f"{datetime.now():%Y%m%d-%H%M%S}-{name}"
    candidates = (f"{stem}{f'-{k}' if k else ''}" for k in count())
    for candidate in candidates:
        path = folder / f"{candidate}{suffix}"
        part = path.with_name(path.name + ".part")  # RunWriter writes to this file; creating it reserves the name
        try:
            part.touch(exist_ok=False)
        except FileExistsError:
            continue
        except OSError as error:
            raise InputError(f"file {path} cannot be written: {error.strerror}") from None
        if not path.exists():
            return path
        part.unlink()
    raise AssertionError  # count() never ends


def list_run_columns(plant: Sequence[Column], controllers: Sequence[Sequence[Column]]) -> list[Column]:
    """Return the columns of a run file, from those of the plant and of each controller, in the order of CONTROLLERS."""
    terms = [
        Column(f"{name}_{column.name}", column.unit, column.meaning)
        for name, columns in zip(CONTROLLERS, controllers, strict=False)
        for column in columns
    ]
    return [*plant, TORQUE_DEMAND, *terms]


class Answers:
    """Rows of one controller, found by the sample that they answer."""

    def __init__(self, columns: Sequence[Column]) -> None:
        self._tick = [column.name for column in columns].index("sample_tick")
        self._rows = [np.empty((0, len(columns)))]

    def add(self, rows: np.ndarray) -> None:
        """Add new rows, shape (rows, columns)."""
        if len(rows):
            self._rows.append(rows)

    @property
    def newest(self) -> float:
        """Return the tick of the newest sample that the last added rows answer; NaN where no rows were added."""
        return float(self._rows[-1][-1, self._tick]) if len(self._rows[-1]) else np.nan

    def to(self, ticks: np.ndarray) -> np.ndarray:
        """Return the terms that act at each of `ticks`, shape (ticks, columns), NaN before the first cycle. Drop older rows."""
        rows = np.concatenate(self._rows)
        terms = np.full((len(ticks), rows.shape[1]), np.nan)
        if len(rows):
            answered = rows[:, self._tick]
            # the newest cycle that did not answer a later sample
            cycles = np.searchsorted(answered, ticks, side="right") - 1
            known = cycles >= 0
            # several cycles may have the same sample: the first of them answered it
            first = np.searchsorted(answered, answered[cycles[known]], side="left")
            terms[known] = rows[first]
            rows = rows[first[-1] if len(first) else 0 :]
        self._rows = [rows]
        return terms


class Recording:
    """Writer of the run file at `path`, from rows as they arrive. Use as a context manager.

    plant: columns of the plant. controllers: columns of each controller, that of clutch a first. rate: of samples [Hz].
    disk: the one of `path`.

    After an exception, the run file is finished if `keep_journal` was called; its metadata then state why it is `incomplete`.
    Otherwise the file is removed.
    """

    def __init__(
        self,
        path: Path,
        plant: Sequence[Column],
        controllers: Sequence[Sequence[Column]],
        rate: int,
        disk: Disk | None = None,
    ) -> None:
        self.path, self._disk = path, disk or Disk()
        self.rows = 0
        self._rate = rate
        self._time = [column.name for column in plant].index("time_s")
        self._demand = [column.name for column in controllers[0]].index(TORQUE_DEMAND.name)
        self._answers = [Answers(columns) for columns in controllers]
        self._columns = list_run_columns(plant, controllers)
        self._writer = self._make_writer(path, self._columns)
        self._plant: list[np.ndarray] = []
        self._journal: Journal | None = None
        self._opening: Mapping[str, Any] = {}

    def keep_journal(self, metadata: Mapping[str, Any]) -> None:
        """Also write each joined row to a journal, which survives a kill of this process by any signal.

        metadata: of the run, as far as known at its start. Raises InputError.
        """
        self._opening = metadata
        self._journal = Journal(self._journal_of, self._columns, metadata, self._disk)

    def add(self, plant: np.ndarray, *controllers: np.ndarray) -> None:
        """Add new rows of all nodes, each of shape (rows, columns of the node)."""
        if len(plant):
            self._plant.append(plant)
        for answers, rows in zip(self._answers, controllers, strict=True):
            answers.add(rows)
        waiting = sum(map(len, self._plant))
        newest = float(np.min([answers.newest for answers in self._answers]))
        answered = 0
        if waiting and newest == newest:
            answered = int(newest - np.rint(self._plant[0][0, self._time] * self._rate))
        late = waiting - _MOST_WAITING
        self._join(max(min(answered, waiting), late if late >= _FEWEST_LATE else 0))

    def finish(self, metadata: Mapping[str, Any]) -> None:
        """Write the remaining rows and close the file. Raises InputError; TooShortError for fewer than two rows."""
        self._join(sum(map(len, self._plant)))
        if self.rows < 2:
            raise TooShortError(f"the run ended after {self.rows} samples; nothing was recorded")
        self._writer.finish(metadata)
        if self._journal:
            self._journal.remove()
            self._journal = None

    def __enter__(self) -> "Recording":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._journal is None:
            self._writer.__exit__(kind, error, trace)
            return
        journal = self._journal
        try:
            with contextlib.suppress(InputError):  # too few rows, or the disk is full
                self.finish({**self._opening, "incomplete": str(error) if error else "the recording was not finished"})
        finally:
            self._writer.__exit__(kind, error, trace)
        if self._journal and self.rows < 2:
            journal.remove()
        journal.close()
        if not isinstance(error, InputError) or self.rows < 2:
            return
        where = f"in {self.path}"
        if self._journal:
            where = f"in {journal.path}, for clutch-hil recover" if journal.path.exists() else "lost"
        raise InputError(f"{error}; the {self.rows} samples until then are {where}") from None

    @property
    def _journal_of(self) -> Path:
        """Return the file that has all rows of the journal."""
        return self.path

    def _make_writer(self, path: Path, columns: Sequence[Column]) -> RunWriter:
        return RunWriter(path, columns, self._disk)

    def _join(self, count: int) -> None:
        """Join the first `count` waiting rows of the plant with the controllers' terms."""
        if count < 1:
            return
        rows = np.concatenate(self._plant)
        ready, rest = rows[:count], rows[count:]
        terms = [answers.to(np.rint(ready[:, self._time] * self._rate)) for answers in self._answers]
        joined = np.column_stack([ready, terms[0][:, self._demand], *terms])
        if self._journal:
            self._journal.append(joined)  # first, so that rows it refuses are in no file
        self.rows += len(ready)
        self._plant = [rest] if len(rest) else []
        self._writer.append(joined)
