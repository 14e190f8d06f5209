"""Overrun: policies of a loop for missed slots. Each returns how many of them are skipped."""

from collections.abc import Callable

from protocols.errors import InputError, join_names


class OverrunError(Exception):
    """A slot was missed, and the policy does not allow it."""


def skip(slots: int) -> int:
    """Skip the missed `slots` and continue with the grid: right for a controller, which cannot act in the past."""
    return slots


def catch_up(slots: int) -> int:
    """Run every missed slot, without waiting, until the grid is reached again: right for a model that must not lose time."""
    return 0


def raise_fault(slots: int) -> int:
    """Raise OverrunError: a missed slot ends the run."""
    raise OverrunError(f"{slots} cycles were missed, and the overrun policy is fault")


POLICIES: dict[str, Callable[[int], int]] = {"skip": skip, "catch-up": catch_up, "fault": raise_fault}


def find_overrun_policy(name: str) -> Callable[[int], int]:
    """Return the policy called `name`. Raises InputError."""
    if name not in POLICIES:
        raise InputError(f"overrun policy {name!r} is unknown; allowed are {join_names(POLICIES)}")
    return POLICIES[name]
