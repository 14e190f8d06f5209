"""Recording: the rows of both nodes joined into a run file, while they come.

The plant's rows are the run: one a sample at a constant rate. To row k come the controller's terms of the cycle that
answered sample k (`controller_...`); where none did, those of the cycle before still act and stand there
(`controller_sample_tick` tells); before the first cycle they are not-a-number.
"""

import contextlib
import os
from collections.abc import Mapping, Sequence
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from protocols.errors import InputError
from protocols.node import Column
from protocols.runs import RunWriter

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


class Recording:
    """Collects rows and writes the run file at `path`."""

    def __init__(self, path: Path, plant: Sequence[Column], controller: Sequence[Column], rate: int) -> None:
        self.path = path
        self.rows = 0
        self._rate = rate
        self._demand = [column.name for column in controller].index("torque_demand_nm")
        self._tick = [column.name for column in controller].index("sample_tick")
        terms = [Column(f"controller_{name}", unit, meaning) for name, unit, meaning in controller]
        self._columns = [*plant, Column("torque_demand_nm", "Nm", "the controller's M_d"), *terms]
        self._writer = RunWriter(path, self._columns)
        self._plant: list[np.ndarray] = []
        self._controller = [np.empty((0, len(controller)))]

    def add(self, plant: np.ndarray, controller: np.ndarray) -> None:
        """Take new rows of both nodes, each of shape (rows, columns of the node)."""
        if len(plant):
            self._plant.append(plant)
        if len(controller):
            self._controller.append(controller)
        waiting = sum(map(len, self._plant))
        answered = 0
        if waiting and len(self._controller[-1]):
            answered = int(self._controller[-1][-1, self._tick] - np.rint(self._plant[0][0, 0] * self._rate))
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

    def _write(self, count: int) -> None:
        """Write the first `count` of the rows that wait."""
        if not count:
            return
        rows, controller = np.concatenate(self._plant), np.concatenate(self._controller)
        ready, rest = rows[:count], rows[count:]
        ticks = np.rint(ready[:, 0] * self._rate)
        terms = np.full((len(ready), controller.shape[1]), np.nan)
        if len(controller):
            answered = controller[:, self._tick]
            held = np.searchsorted(answered, ticks, side="right") - 1  # newest cycle that knew no later sample
            known = held >= 0
            # several cycles may hold one sample: the first of them answered it
            first = np.searchsorted(answered, answered[held[known]], side="left")
            terms[known] = controller[first]
            controller = controller[first[-1] if len(first) else 0 :]
        self._writer.append(np.column_stack([ready, terms[:, self._demand], terms]))
        self.rows += len(ready)
        self._plant, self._controller = [rest] if len(rest) else [], [controller]
