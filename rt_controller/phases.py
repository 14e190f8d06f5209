"""Phases of the clutch: idle, fill, slip control, release, fault.

idle --engage--> fill --pressure above contact for the dwell--> slip_control
fill, slip_control --no engage--> release --pressure below the springs--> idle
fill --time-out--> fault;  any --guard trips--> fault --guard healthy, request idle--> idle
"""

from dataclasses import dataclass
from enum import IntEnum


class Phase(IntEnum):
    """Values of CONTROLLER_STATUS.PHASE."""

    IDLE = 0
    FILL = 1
    SLIP_CONTROL = 2
    RELEASE = 3
    FAULT = 4


class Request(IntEnum):
    """Values of TORQUE_SETPOINT.REQUEST."""

    IDLE = 0
    ENGAGE = 1
    RELEASE = 2


class Fault(IntEnum):
    """Values of CONTROLLER_STATUS.FAULT; the first four are the guard's."""

    NONE = 0
    STALE_SENSORS = 1
    OVERPRESSURE = 2
    OVERTEMPERATURE = 3
    OVERSPEED = 4
    FILL_TIMEOUT = 5


@dataclass(frozen=True, slots=True)
class PhaseSettings:
    """Pressures [Pa] and times [s], names as in `controller.toml`."""

    contact_pressure: float
    released_pressure: float
    fill_dwell: float
    fill_timeout: float


@dataclass(slots=True)
class PhaseMachine:
    """Phase, why it is in fault, time in the phase [s] and time above the contact pressure [s]."""

    settings: PhaseSettings
    phase: Phase = Phase.IDLE
    fault: Fault = Fault.NONE
    time_in_phase: float = 0.0
    time_in_contact: float = 0.0

    def step(self, request: Request, pressure: float, guard_fault: Fault, step: float) -> Phase:
        """Next phase from the request, cylinder `pressure` [Pa], the guard's finding and the time since [s]."""
        self.time_in_phase += step
        self.time_in_contact = self.time_in_contact + step if pressure >= self.settings.contact_pressure else 0.0
        after, fault = self._next(request, pressure, guard_fault)
        if after != self.phase:
            self.phase, self.time_in_phase = after, 0.0
        self.fault = fault
        return after

    def _next(self, request: Request, pressure: float, guard_fault: Fault) -> tuple[Phase, Fault]:
        s, phase = self.settings, self.phase
        if guard_fault:
            return Phase.FAULT, guard_fault
        if phase is Phase.FAULT:
            return (Phase.IDLE, Fault.NONE) if request is Request.IDLE else (Phase.FAULT, self.fault)
        engage = request is Request.ENGAGE
        if phase is Phase.IDLE:
            return (Phase.FILL if engage else Phase.IDLE), Fault.NONE
        if phase is Phase.RELEASE:
            return (Phase.IDLE if pressure < s.released_pressure else Phase.RELEASE), Fault.NONE
        if not engage:
            return Phase.RELEASE, Fault.NONE
        if phase is Phase.FILL:
            if self.time_in_contact >= s.fill_dwell:
                return Phase.SLIP_CONTROL, Fault.NONE
            if self.time_in_phase > s.fill_timeout:
                return Phase.FAULT, Fault.FILL_TIMEOUT
        return phase, Fault.NONE
