"""Overrun: what a loop does about slots that it has slept through."""

from collections.abc import Callable

from protocols.errors import InputError, listing


class OverrunError(Exception):
    """A slot was missed where none may be."""


def skip(slots: int) -> int:
    """Leave the missed `slots` out and go on with the grid: a controller has nothing to say about the past."""
    return slots


def catch_up(slots: int) -> int:
    """Run every slot, without waiting, until the grid is reached again: a model that must not lose time."""
    return 0


def fault(slots: int) -> int:
    """End: where a missed slot is a fault. Raises OverrunError."""
    raise OverrunError(f"{slots} slots were missed, and the policy for overruns is fault")


POLICIES: dict[str, Callable[[int], int]] = {"skip": skip, "catch-up": catch_up, "fault": fault}


def overrun_policy(name: str) -> Callable[[int], int]:
    """The policy of that name: of a number of missed slots those that are left out. Raises InputError."""
    if name not in POLICIES:
        raise InputError(f"overrun policy {name!r} is unknown; allowed are {listing(POLICIES)}")
    return POLICIES[name]
