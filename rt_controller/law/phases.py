"""Phases of the clutch: idle, fill, slip control, lock, release, fault.

idle --engage, pressure or lock, after a request for idle--> fill
fill --pressure above contact for the dwell--> lock if requested, else slip_control
slip_control --lock--> lock --engage or pressure--> slip_control
fill, slip_control, lock --none of the three--> release --pressure below the springs--> idle
fill --time-out--> fault;  slip_control, lock --pressure lost, torque implausible--> fault
any --guard trips, another sender on the bus--> fault --neither, request idle--> idle

Each engagement needs a request for idle before it. So a controller that restarts during a demand, or receives its supervisor
again, does not close the clutch by itself. A lost supervisor counts as a request for release. When the supervisor changes, the
clutch opens first (`let_go`). A request for a pressure closes the clutch like a request for a torque; torque_law.py decides
which of the two is controlled.

With a request for a pressure the torque is not checked. This allows experiments with a clutch that is not calibrated.
"""

from enum import IntEnum

import numpy as np
from numba import njit

from protocols.can.request import Request
from rt_controller.law.record import make_float_type


class Phase(IntEnum):
    """Values of CONTROLLER_STATUS.PHASE."""

    IDLE = 0
    FILL = 1
    SLIP_CONTROL = 2
    RELEASE = 3
    FAULT = 4
    LOCK = 5


class Fault(IntEnum):
    """Values of CONTROLLER_STATUS.FAULT; 1 to 4, 10 and 11 are the guard's, 8 and 9 those of the bus (`loop/cycle.py`)."""

    NONE = 0
    STALE_SENSORS = 1
    OVERPRESSURE = 2
    OVERTEMPERATURE = 3
    OVERSPEED = 4
    FILL_TIMEOUT = 5
    PRESSURE_LOST = 6
    TORQUE_IMPLAUSIBLE = 7
    SECOND_SENDER = 8
    WRONG_RATE = 9
    SENSOR_IMPLAUSIBLE = 10
    SENSOR_FROZEN = 11


# Pressures [Pa] and times [s], names of `controller.toml`
PHASE_SETTINGS = make_float_type("contact_pressure", "released_pressure", "fill_dwell", "fill_timeout")
# phase; fault: reason of the phase fault; time_...: duration [s] of the phase, and of pressure above contact. permitted: the
# clutch may close, as idle has been requested after the last engagement
PHASES = np.dtype(
    [("phase", "i8"), ("fault", "i8"), ("time_in_phase", "f8"), ("time_in_contact", "f8"), ("permitted", "?")]
)


@njit
def advance(state, settings, request, pressure, lost, implausible, finding, step):
    """Advance PHASES by `step` [s]; return the next Phase.

    `request` of the supervisor; `pressure` [Pa] of the cylinder; `lost`: the pressure signal is invalid; `implausible`: the
    torque is not plausible (both from `plausibility.py`); `finding`: Fault of guard or bus, 0 for none.
    """
    state.time_in_phase += step
    state.time_in_contact = state.time_in_contact + step if pressure >= settings.contact_pressure else 0.0
    state.permitted = state.permitted or request == Request.IDLE
    after, state.fault = _find_next(state, settings, request, pressure, lost, implausible, finding)
    if after != state.phase:
        state.phase, state.time_in_phase = after, 0.0
    return after


@njit
def let_go(state):
    """Open the clutch, and keep it open until idle is requested: from now on another supervisor, or none, is followed."""
    state.permitted = False
    if state.phase == Phase.FILL or state.phase == Phase.SLIP_CONTROL or state.phase == Phase.LOCK:
        state.phase, state.time_in_phase = Phase.RELEASE.value, 0.0


@njit
def _find_next(state, settings, request, pressure, lost, implausible, finding):
    """Return the next Phase and Fault; arguments of `advance`."""
    phase = state.phase
    if finding:
        return Phase.FAULT.value, finding
    if phase == Phase.FAULT:
        return (Phase.IDLE.value, Fault.NONE.value) if request == Request.IDLE else (phase, state.fault)
    locks = request == Request.LOCK
    close = request == Request.ENGAGE or request == Request.PRESSURE or locks
    closed = Phase.LOCK.value if locks else Phase.SLIP_CONTROL.value
    if phase == Phase.IDLE:
        if not (close and state.permitted):
            return phase, Fault.NONE.value
        state.permitted = False
        return Phase.FILL.value, Fault.NONE.value
    if phase == Phase.RELEASE:
        return (Phase.IDLE.value if pressure < settings.released_pressure else phase), Fault.NONE.value
    if not close:
        return Phase.RELEASE.value, Fault.NONE.value
    if phase == Phase.FILL:
        if state.time_in_contact >= settings.fill_dwell:
            return closed, Fault.NONE.value
        if state.time_in_phase > settings.fill_timeout:
            return Phase.FAULT.value, Fault.FILL_TIMEOUT.value
        return phase, Fault.NONE.value
    if lost:
        return Phase.FAULT.value, Fault.PRESSURE_LOST.value
    if implausible:
        return Phase.FAULT.value, Fault.TORQUE_IMPLAUSIBLE.value
    return closed, Fault.NONE.value
