"""Requests of the supervisor to the controller."""

from enum import IntEnum


class Request(IntEnum):
    """Values of TORQUE_SETPOINT.REQUEST."""

    IDLE = 0
    ENGAGE = 1  # follow the torque demand
    RELEASE = 2
    PRESSURE = 3  # follow the pressure demand and ignore the torque demand
    LOCK = 4  # close the clutch totally: carry the applied torque with a margin

    @property
    def closes(self) -> bool:
        """Whether the request closes the clutch or keeps it closed."""
        return self in (Request.ENGAGE, Request.PRESSURE, Request.LOCK)
