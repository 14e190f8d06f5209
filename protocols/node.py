"""Node: a participant of a bus. The same object runs on its own clock, in lock-step, or in one process with the other node."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from protocols.entry_points import load_entry

if TYPE_CHECKING:  # reading the DBC takes 0.2 s, which a process that only reads a file does not need
    from protocols.can.frames import Frame


class Column(NamedTuple):
    """A column of a node's record."""

    name: str
    unit: str
    meaning: str


def make_record_type(columns: Sequence[Column]) -> np.dtype:
    """Return the record type with a double for each column; a row of plain numbers can be viewed as one."""
    return np.dtype([(column.name, "f8") for column in columns])


class Node(Protocol):
    """A participant that is stepped once a cycle. It has no clock, opens nothing and sends nothing itself."""

    columns: Sequence[Column]
    outbox: np.ndarray  # frames of the last cycle, (n,) of batch.FRAME
    record: np.ndarray  # its row, in the order of `columns`, (columns,)

    def run_cycle(self, inbox: np.ndarray, count: int, slots: int = 1) -> int:
        """Run one cycle, and return the number of frames in `outbox`. Raises InputError to stop the run.

        inbox: batch whose first `count` frames came since the last cycle. slots: periods since the last cycle.
        """
        ...

    def step(self, inbox: Sequence["Frame"], slots: int = 1) -> list["Frame"]:
        """Run one cycle with frames as objects: take `inbox`, and return the frames to send; see `run_cycle`."""
        ...

    def list_safe_frames(self) -> list["Frame"]:
        """Return the frames that leave the actuators safe; they are sent last."""
        ...

    def make_row(self) -> tuple[float, ...]:
        """Return the record of the last cycle as plain numbers."""
        ...


def load_node(name: str) -> Callable[..., Any]:
    """Return the class of a node by entry point (`plant`, `controller`), so that neither side imports the other."""
    factory: Callable[..., Any] = load_entry("clutch_hil.nodes", "node", name)
    return factory
