"""Real services for the tests of telemetry, and what a listener hears of them."""

import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

import numpy as np

from protocols.errors import InputError
from protocols.telemetry.batch import Batch
from protocols.telemetry.feed import Feed, ask, find_bench
from protocols.telemetry.keys import NODES, Keys
from protocols.telemetry.message import check_last
from tests.processes import ONE_CPU, PATIENCE, service


@contextmanager
def bench(bus: str, *arguments: str) -> Iterator[dict[str, subprocess.Popen]]:
    """Plant and controller on `bus`, playing the engagement over and over."""
    profile = ("--profile", "engagement", "--seconds", "1000")
    with ExitStack() as stack:
        yield {
            "controller": stack.enter_context(service("controller", "--bus", bus, *ONE_CPU, *arguments)),
            "plant": stack.enter_context(service("plant", "--bus", bus, *profile, *ONE_CPU, *arguments)),
        }


def wait_until(condition: Callable[[], object], what: str) -> object:
    """The first true value of `condition`."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if value := condition():
            return value
        time.sleep(0.02)
    raise AssertionError(f"{what}: not within {PATIENCE:g} s")


def wait_for_bench(session, bus: str) -> str:
    """The bench on `bus` once both of its services publish."""

    def look() -> str | None:
        try:
            name = find_bench(session, bus)
        except InputError:
            return None
        return name if all(ask(session, Keys(name, node).last, check_last) for node in NODES) else None

    return str(wait_until(look, f"bench on {bus}"))


def collect_batches(feed: Feed, enough: Callable[[dict[str, list[Batch]]], bool]) -> dict[str, list[Batch]]:
    """Batches by node until there are `enough`."""
    batches: dict[str, list[Batch]] = {"plant": [], "controller": []}
    deadline = time.monotonic() + PATIENCE
    while not enough(batches):
        assert time.monotonic() < deadline, "telemetry never came"
        for batch in feed.read(0.2):
            batches[batch.node].append(batch)
    return batches


def list_row_numbers(batches: Sequence[Batch]) -> np.ndarray:
    """Numbers of all rows, in the order in which they came."""
    return np.concatenate([np.arange(batch.first_row, batch.end) for batch in batches])
