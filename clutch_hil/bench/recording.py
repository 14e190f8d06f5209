"""Recording: the rows of both nodes joined into a run file, while they come.

The plant's rows are the run: one a sample at a constant rate. To row k come the controller's terms of the cycle that
answered sample k (`controller_...`, of clutch b's `controller_b_...`); where none did, those of the cycle before still act and
stand there (`controller_sample_tick` tells); before the first cycle they are not-a-number.
"""

import contextlib
import os
from collections.abc import Mapping, Sequence
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError
from protocols.files.runs import RunWriter
from protocols.node import Column

TORQUE_DEMAND = Column("torque_demand_nm", "Nm", "the controller's M_d")  # of clutch a's where there are two
_CHUNK = 20_000  # rows a row group: 20 s at 1 kHz, some MB of memory
_WAIT = 60_000  # rows a plant row waits for the controller's answer before it is written without one: its past may come late


def writable(folder: Path) -> Path:
    """`folder`, made if need be. Raises InputError when nothing can be written there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"folder {folder} cannot be made: {error.strerror}") from None
    if not os.access(folder, os.W_OK):
        raise InputError(f"folder {folder} cannot be written")
    return folder


def run_path(folder: Path, name: str, suffix: str = ".parquet") -> Path:
    """A path for a new file in a `writable` folder, named by date and time, that no other process has or is writing."""
    stem = f"{datetime.now():%Y%m%d-%H%M%S}-{name}"
    candidates = (f"{stem}{f'-{k}' if k else ''}" for k in count())
    for candidate in candidates:
        path = folder / f"{candidate}{suffix}"
        part = path.with_name(path.name + ".part")  # what RunWriter writes; making it reserves the name
        with contextlib.suppress(FileExistsError):
            part.touch(exist_ok=False)
            if not path.exists():
                return path
            part.unlink()
    raise AssertionError  # count() never ends


def run_columns(plant: Sequence[Column], controllers: Sequence[Sequence[Column]]) -> list[Column]:
    """The columns of a run file, of those of the plant and of each controller, in the order of CONTROLLERS."""
    terms = [
        Column(f"{name}_{column.name}", column.unit, column.meaning)
        for name, columns in zip(CONTROLLERS, controllers, strict=False)
        for column in columns
    ]
    return [*plant, TORQUE_DEMAND, *terms]


class Answers:
    """The rows of one controller, by the sample they answered."""

    def __init__(self, columns: Sequence[Column]) -> None:
        self._tick = [column.name for column in columns].index("sample_tick")
        self._rows = [np.empty((0, len(columns)))]

    def add(self, rows: np.ndarray) -> None:
        """Take new rows, shape (rows, columns)."""
        if len(rows):
            self._rows.append(rows)

    @property
    def newest(self) -> float:
        """Tick of the newest sample that was answered by what came last; NaN when that was nothing."""
        return float(self._rows[-1][-1, self._tick]) if len(self._rows[-1]) else np.nan

    def to(self, ticks: np.ndarray) -> np.ndarray:
        """Terms that act at each of `ticks`, not-a-number before the first cycle; forgets what came before the last of them."""
        rows = np.concatenate(self._rows)
        terms = np.full((len(ticks), rows.shape[1]), np.nan)
        if len(rows):
            answered = rows[:, self._tick]
            held = np.searchsorted(answered, ticks, side="right") - 1  # newest cycle that knew no later sample
            known = held >= 0
            # several cycles may hold one sample: the first of them answered it
            first = np.searchsorted(answered, answered[held[known]], side="left")
            terms[known] = rows[first]
            rows = rows[first[-1] if len(first) else 0 :]
        self._rows = [rows]
        return terms


class Recording:
    """Collects rows and writes the run file at `path`. Use as a context manager.

    `plant` are the plant's columns, `controllers` those of each controller, clutch a's first where there are two; rate [Hz].
    """

    def __init__(
        self,
        path: Path,
        plant: Sequence[Column],
        controllers: Sequence[Sequence[Column]],
        rate: int,
    ) -> None:
        self.path = path
        self.rows = 0
        self._rate = rate
        self._time = [column.name for column in plant].index("time_s")
        self._demand = [column.name for column in controllers[0]].index(TORQUE_DEMAND.name)
        self._answers = [Answers(columns) for columns in controllers]
        self._columns = run_columns(plant, controllers)
        self._writer = self._new_writer(path, self._columns)
        self._plant: list[np.ndarray] = []

    def add(self, plant: np.ndarray, *controllers: np.ndarray) -> None:
        """Take new rows of all nodes, each of shape (rows, columns of the node)."""
        if len(plant):
            self._plant.append(plant)
        for answers, rows in zip(self._answers, controllers, strict=True):
            answers.add(rows)
        waiting = sum(map(len, self._plant))
        newest = float(np.min([answers.newest for answers in self._answers]))
        answered = 0
        if waiting and newest == newest:
            answered = int(newest - np.rint(self._plant[0][0, self._time] * self._rate))
        ready = max(min(answered, waiting), waiting - _WAIT)
        if ready >= _CHUNK:
            self._write(ready)

    def finish(self, metadata: Mapping[str, Any]) -> None:
        """Write what is left and close the file. Raises InputError when there are less than two rows: no run."""
        self._write(sum(map(len, self._plant)))
        if self.rows < 2:
            raise InputError(f"the run ended after {self.rows} samples; nothing was recorded")
        self._writer.finish(metadata)

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, *exception: Any) -> None:
        self._writer.__exit__(*exception)

    def _new_writer(self, path: Path, columns: Sequence[Column]) -> RunWriter:
        return RunWriter(path, columns)

    def _write(self, count: int) -> None:
        """Write the first `count` of the rows that wait."""
        if not count:
            return
        rows = np.concatenate(self._plant)
        ready, rest = rows[:count], rows[count:]
        terms = [answers.to(np.rint(ready[:, self._time] * self._rate)) for answers in self._answers]
        self._writer.append(np.column_stack([ready, terms[0][:, self._demand], *terms]))
        self.rows += len(ready)
        self._plant = [rest] if len(rest) else []
