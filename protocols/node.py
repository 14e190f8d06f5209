"""Node: what runs on a bus. The same object runs on its own clock, in lock-step, or in one process with the other."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from protocols.can.frames import Frame
from protocols.entry_points import load_entry


class Column(NamedTuple):
    """A column of a node's record."""

    name: str
    unit: str
    meaning: str


def record_type(columns: Sequence[Column]) -> np.dtype:
    """The type of a record that has a double by the name of each column; a row of plain numbers views as one."""
    return np.dtype([(column.name, "f8") for column in columns])


class Node(Protocol):
    """A participant that is stepped once a cycle. It has no clock, opens nothing and sends nothing itself."""

    columns: Sequence[Column]
    outbox: np.ndarray  # frames of the last cycle, (n,) of batch.FRAME
    record: np.ndarray  # its row, in the order of `columns`, (columns,)

    def cycle(self, inbox: np.ndarray, count: int, slots: int = 1) -> int:
        """Take the first `count` frames of a batch, which came since the last cycle, `slots` periods ago; return how many are
        in `outbox`. Raises InputError to be stopped."""
        ...

    def step(self, inbox: Sequence[Frame], slots: int = 1) -> list[Frame]:
        """The same with frames as objects."""
        ...

    def safe(self) -> list[Frame]:
        """Frames that leave the actuators safe; the last thing sent."""
        ...

    def row(self) -> tuple[float, ...]:
        """The record of the last cycle as plain numbers."""
        ...


def node_factory(name: str) -> Callable[..., Any]:
    """The class of a node by entry point (`plant`, `controller`), so that no side imports the other."""
    factory: Callable[..., Any] = load_entry("clutch_hil.nodes", "node", name)
    return factory
