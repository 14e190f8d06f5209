"""What the supervisor asks the controller for."""

from enum import IntEnum


class Request(IntEnum):
    """Values of TORQUE_SETPOINT.REQUEST."""

    IDLE = 0
    ENGAGE = 1  # follow the torque demand
    RELEASE = 2
    PRESSURE = 3  # follow the pressure demand, whatever the torque demand
    LOCK = 4  # close the clutch totally: carry whatever is applied, with a margin

    @property
    def closes(self) -> bool:
        """Whether it keeps the clutch closed."""
        return self in (Request.ENGAGE, Request.PRESSURE, Request.LOCK)
