"""A bench that publishes rows which anybody can compute again from their number."""

import threading
import time
from types import TracebackType

import numpy as np

from plant_sim.node.plant_node import COLUMNS as PLANT
from protocols.node import Column
from protocols.telemetry.batch import ENCODING, BatchEncoder, list_run_columns
from protocols.telemetry.keys import Keys, make_bench_name
from protocols.telemetry.session import open_publisher_session
from rt_controller.loop.node import COLUMNS as CONTROLLER

PERIOD = 0.02  # s between batches, as of the real publisher
_COLUMNS = {
    node: (*list_run_columns(node, columns), Column(f"{node}_clock_s", "s", ""), Column(f"{node}_work_us", "us", ""))
    for node, columns in (("plant", PLANT), ("controller", CONTROLLER))
}


def make_rows(node: str, begin: int, end: int, rate: float, start: float) -> np.ndarray:
    """Rows `begin` to `end` of a node that began at `start` [s, CLOCK_MONOTONIC]; shape (rows, columns)."""
    number = np.arange(begin, end)[:, None]
    values = 10.0 + 5.0 * np.sin(number / rate + np.arange(len(_COLUMNS[node])))
    for index, column in enumerate(_COLUMNS[node]):
        if column.name == "time_s":
            values[:, index] = number[:, 0] / rate
        elif column.name == "controller_sample_tick":
            values[:, index] = number[:, 0]
        elif column.name in ("controller_phase", "controller_fault"):
            values[:, index] = number[:, 0] // rate % 5
        elif column.name == "controller_clutch_state":
            values[:, index] = number[:, 0] // rate % 4
        elif column.name.endswith("_clock_s"):
            values[:, index] = start + number[:, 0] / rate
    return values


class FakeBench:
    """Publishes both nodes at `rate` [Hz] in a thread, `speed` times as fast as real time. Use as a context manager."""

    def __init__(self, bus: str, rate: float = 1000.0, speed: float = 1.0, session: int = 1) -> None:
        self.start = time.monotonic()
        self.published = 0  # rows of each node
        self.rate = rate
        self._bus, self._speed, self._session = bus, speed, session
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> "FakeBench":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end.set()
        self._thread.join()

    def list_published(self, node: str, begin: int, end: int) -> np.ndarray:
        """What was published under these numbers, shape (rows, columns)."""
        return make_rows(node, begin, end, self.rate, self.start)

    def _run(self) -> None:
        import zenoh

        epoch = time.time() - time.monotonic()
        encoders = {node: BatchEncoder(node, self._session, self.rate, epoch, _COLUMNS[node]) for node in _COLUMNS}
        with open_publisher_session() as session:
            keys = {node: Keys(make_bench_name(self._bus), node) for node in _COLUMNS}
            tokens = [session.liveliness().declare_token(key.alive) for key in keys.values()]
            records = {
                node: session.declare_publisher(
                    key.record,
                    encoding=ENCODING,
                    congestion_control=zenoh.CongestionControl.DROP,
                    priority=zenoh.Priority.REAL_TIME,
                )
                for node, key in keys.items()
            }
            while not self._end.wait(PERIOD):
                due = int((time.monotonic() - self.start) * self.rate * self._speed)
                for node, record in records.items():
                    record.put(encoders[node].encode(self.published, self.list_published(node, self.published, due), 0))
                self.published = due
            for token in tokens:
                token.undeclare()
