"""Lifecycle states of a service, with the names of ROS 2 managed nodes."""

from enum import IntEnum


class Lifecycle(IntEnum):
    """Values of the LIFECYCLE signal of both heartbeats."""

    UNCONFIGURED = 0
    INACTIVE = 1
    ACTIVE = 2
    FINALIZED = 3
