"""Phases of the clutch: idle, fill, slip control, release, fault.

idle --engage or pressure, once idle has been asked for--> fill --pressure above contact for the dwell--> slip_control
fill, slip_control --neither engage nor pressure--> release --pressure below the springs--> idle
fill --time-out--> fault;  slip_control --pressure lost, torque implausible--> fault
any --guard trips--> fault --guard healthy, request idle--> idle

Each engagement needs a request for idle before it: a controller that restarts, or that finds its supervisor again, in the
middle of a demand does not close the clutch by itself. A lost supervisor counts as a request for release. A request for a
pressure closes the clutch as one for a torque does; what is then followed is no matter of phases (law.py).
"""

from dataclasses import dataclass
from enum import IntEnum

from protocols.request import Request


class Phase(IntEnum):
    """Values of CONTROLLER_STATUS.PHASE."""

    IDLE = 0
    FILL = 1
    SLIP_CONTROL = 2
    RELEASE = 3
    FAULT = 4


class Fault(IntEnum):
    """Values of CONTROLLER_STATUS.FAULT; the first four are the guard's."""

    NONE = 0
    STALE_SENSORS = 1
    OVERPRESSURE = 2
    OVERTEMPERATURE = 3
    OVERSPEED = 4
    FILL_TIMEOUT = 5
    PRESSURE_LOST = 6
    TORQUE_IMPLAUSIBLE = 7


@dataclass(frozen=True, slots=True)
class PhaseSettings:
    """Pressures [Pa] and times [s], names as in `controller.toml`."""

    contact_pressure: float
    released_pressure: float
    fill_dwell: float
    fill_timeout: float
    lost_pressure: float
    lost_dwell: float
    torque_mismatch: float  # Nm
    mismatch_dwell: float


@dataclass(slots=True)
class PhaseMachine:
    """Phase, why it is in fault, and for how long [s] each condition has lasted."""

    settings: PhaseSettings
    phase: Phase = Phase.IDLE
    fault: Fault = Fault.NONE
    time_in_phase: float = 0.0
    time_in_contact: float = 0.0
    time_lost: float = 0.0
    time_implausible: float = 0.0
    permitted: bool = False  # to close the clutch: idle has been asked for since the last engagement

    def step(self, request: Request, pressure: float, mismatch: float, guard_fault: Fault, step: float) -> Phase:
        """Next phase.

        `pressure` [Pa] of the cylinder; `mismatch` [Nm] between the torque observed at the motor and the estimate;
        the guard's finding; `step` [s] since the last call.
        """
        s = self.settings
        self.time_in_phase += step
        self.time_in_contact = self.time_in_contact + step if pressure >= s.contact_pressure else 0.0
        self.time_lost = self.time_lost + step if pressure < s.lost_pressure else 0.0
        self.time_implausible = self.time_implausible + step if abs(mismatch) > s.torque_mismatch else 0.0
        self.permitted = self.permitted or request is Request.IDLE
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
        close = request.closes
        if phase is Phase.IDLE:
            if not (close and self.permitted):
                return Phase.IDLE, Fault.NONE
            self.permitted = False
            return Phase.FILL, Fault.NONE
        if phase is Phase.RELEASE:
            return (Phase.IDLE if pressure < s.released_pressure else Phase.RELEASE), Fault.NONE
        if not close:
            return Phase.RELEASE, Fault.NONE
        if phase is Phase.FILL:
            if self.time_in_contact >= s.fill_dwell:
                return Phase.SLIP_CONTROL, Fault.NONE
            if self.time_in_phase > s.fill_timeout:
                return Phase.FAULT, Fault.FILL_TIMEOUT
        elif self.time_lost >= s.lost_dwell:
            return Phase.FAULT, Fault.PRESSURE_LOST
        elif self.time_implausible >= s.mismatch_dwell:
            return Phase.FAULT, Fault.TORQUE_IMPLAUSIBLE
        return phase, Fault.NONE
