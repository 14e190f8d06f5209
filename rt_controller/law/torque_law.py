"""The control law of section 6.5: estimate, feedforward, torque feedback, pressure regulator; all terms are published.

With a pressure request the pressure regulator follows that pressure, and the torque is still estimated. In the phase `lock` the
pressure holds more than the torque that the clutch carries (`lock.py`). The torque demand is a magnitude; torque and slip have
a sign.

Overshoot       the pressure passes a step of its demand by a quarter to two fifths of it, and a step to the highest pressure
                would end above the guard's limit. So above `pressure.slow_above` the demand rises at `pressure.slow_rate` only.
Anti-windup     conditional integration: an integrator is held only while its error would drive it further into the active
                limit. So each loop leaves its limit at once, needs no additional gain, and does not stop the other loop: the
                pressure settles while the torque loop is at its limit. The torque loop is also held while the valve is at its
                limit.
"""

from math import nan
from typing import Any

import numpy as np
from numba import njit

from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.files.units import BAR, ZERO_CELSIUS
from protocols.node import Column
from rt_controller.law.clutch_state import ClutchState, find_clutch_state
from rt_controller.law.feedforward import holding_pressure, inverse_model
from rt_controller.law.lock import LOCK_SETTINGS, hold
from rt_controller.law.phases import Phase
from rt_controller.law.record import make_record
from rt_controller.law.regulator import PI, follow, proportional_integral
from rt_controller.law.transmitted import TORQUE, TORQUE_SETTINGS, estimate, make_torque_at_rest, make_torque_settings

LAWS = ("both", "feedforward", "feedback")  # the three rows of Table 6.6

# Terms of the law that are published in each step, in the order of the run file: declared here and filled in `_note_terms`
TERMS = tuple(
    Column(*column)
    for column in (
        ("torque_demand_nm", "Nm", "M_d; not a number while a pressure is followed"),
        ("torque_estimate_nm", "Nm", "torque transmitted: M_sim of eq. 6.9, trimmed; signed as the slip"),
        ("coulomb_part_nm", "Nm", "M_C m before the level, signed"),
        ("viscous_part_nm", "Nm", "viscous part before level and correction, signed"),
        ("friction_state", "1", "m of eq. 6.9"),
        ("feedforward_bar", "bar", "p_ff of eq. 6.8"),
        ("proportional_bar", "bar", "P of the torque feedback"),
        ("integral_bar", "bar", "I of the torque feedback"),
        ("pressure_demand_bar", "bar", "p_d"),
        ("pressure_bar", "bar", "measured cylinder pressure"),
        ("pressure_proportional_bar", "bar", "P of the pressure regulator"),
        ("pressure_integral_bar", "bar", "I of the pressure regulator"),
        ("voltage_v", "V", "command to the valve, before the guard"),
        ("slip_rad_s", "rad/s", "slip speed from the encoder, mean since the previous sample: the input of eq. 6.9"),
        ("slip_acceleration_rad_s2", "rad/s^2", "observed slip acceleration"),
        ("temperature_degc", "degC", "measured oil temperature"),
        ("observed_torque_nm", "Nm", "M_m - J alpha with the lag of the slip observer: the input of the adaptation"),
        ("friction_level", "1", "adapted level"),
        ("viscous_correction", "1", "adapted correction of the viscous part"),
        ("adaptation_active", "1", "1 while the adaptation is active"),
        ("in_contact", "1", "1 while the plates are assumed to touch"),
        ("frozen", "1", "1 while the torque integrator is held"),
        ("saturated", "1", "1 while pressure demand or voltage is at its limit"),
        ("clutch_state", "1", f"state of the plates: {', '.join(f'{s.value} {s.name.lower()}' for s in ClutchState)}"),
        (
            "capacity_nm",
            "Nm",
            "torque at which the plates would slide: level M_C, or the torque that they carry if it is higher",
        ),
        (
            "trimmed_level",
            "1",
            "momentary level: the adapted one with the motor's torque of the last 0.1 s",
        ),
    )
)

# Rate at which the capacity falls after lock, as a multiple of its rate into lock: 25 Nm in 0.25 s, which the pressure loop can
# follow. A step would open the clutch
_LOCK_EXIT_RATE = 4.0
# Parameters in SI. feeds_forward, feeds_back: selected row of Table 6.6
LAW_SETTINGS = np.dtype(
    [("torque", TORQUE_SETTINGS), ("lock", LOCK_SETTINGS), ("feeds_forward", "?"), ("feeds_back", "?"),
     ("torque_k_p", "f8"), ("torque_k_i", "f8"), ("pressure_k_p", "f8"), ("pressure_k_i", "f8"), ("pressure_limit", "f8"),
     ("slow_above", "f8"), ("slow_rate", "f8"),
     ("pressure_floor", "f8"), ("valve_gain", "f8"), ("voltage_limit", "f8"), ("fill_pressure", "f8"),
     ("slip_hold", "f8")]
)  # fmt: skip
# torque: state of the estimator; voltage [V] and pressure_demand [Pa] of the last step; pressure_limited, voltage_limited: 1 at
# the upper limit, -1 at the lower, otherwise 0; held: capacity demanded in lock and while leaving it [Nm], otherwise 0
LAW = np.dtype(
    [("torque", TORQUE), ("voltage", "f8"), ("pressure_demand", "f8"), ("pressure_limited", "i8"), ("voltage_limited", "i8"),
     ("held", "f8"), ("torque_loop", PI), ("pressure_loop", PI)]
)  # fmt: skip


def make_law_settings(parameters: ParameterSet, law: str, adaptation: bool, alone: bool) -> dict[str, object]:
    """Return the fields of LAW_SETTINGS. Raises InputError for an unknown law.

    `law` is one of LAWS; `adaptation` switches the adaptive level on; `alone`: the motor drives this clutch alone.
    """
    if law not in LAWS:
        raise InputError(f"control law {law!r} is unknown; allowed are {', '.join(LAWS)}")
    torque, pressure = parameters.list_si("torque"), parameters.list_si("pressure")
    return {
        "torque": make_record(TORQUE_SETTINGS, make_torque_settings(parameters, adaptation, alone)),
        "lock": make_record(LOCK_SETTINGS, parameters.list_si("lock")),
        "feeds_forward": law != "feedback", "feeds_back": law != "feedforward",
        "torque_k_p": torque["proportional_gain"], "torque_k_i": torque["integral_gain"],
        "pressure_k_p": pressure["proportional_gain"], "pressure_k_i": pressure["integral_gain"],
        "pressure_limit": torque["pressure_limit"], "slow_above": pressure["slow_above"], "slow_rate": pressure["slow_rate"],
        "pressure_floor": pressure["floor"],
        "valve_gain": pressure["valve_gain"], "voltage_limit": pressure["voltage_limit"],
        "fill_pressure": parameters["phases.fill_pressure"].si, "slip_hold": parameters["slip.hold"].si,
    }  # fmt: skip


def make_law_at_rest() -> Any:
    """Return LAW before its first step."""
    return make_record(LAW, torque=make_torque_at_rest())


@njit
def control(law, settings, phase, demand, speed_demand, motor_limited, sample, step, target, terms):
    """Advance LAW by `step` [s], which is 0 without a new sample, for the torque `demand` [Nm], a magnitude.

    `phase` is a Phase. `speed_demand` [rad/s] of the motor; `motor_limited`: the motor is at its torque limit. `target` [Pa] is
    the pressure to follow instead of the torque; NaN if there is none. The record `terms` gets the values of TERMS.
    """
    closed = phase == Phase.SLIP_CONTROL or phase == Phase.LOCK
    closing = closed or phase == Phase.FILL
    may_touch = closing or phase == Phase.RELEASE  # until the piston has returned
    estimate(law.torque, settings.torque, may_touch, closed, speed_demand, motor_limited, sample, step)
    feedforward, frozen = _update_pressure_demand(law, settings, phase, demand, speed_demand, sample, step, target)
    _regulate_pressure(law, settings, closing, sample.pressure, step)
    _note_terms(terms, law, phase, demand if target != target else nan, sample, feedforward, frozen)


@njit
def _update_pressure_demand(law, settings, phase, demand, speed_demand, sample, step, target):
    """Torque loop (fig 6.16): update the pressure demand and the side on which it is limited; arguments of `control`.

    Returns the feedforward [Pa], and whether the torque integrator is held.
    """
    torque, follows_pressure = law.torque, target == target
    contact, moves, level, correction = torque.contact, torque.motion.moves, torque.level, torque.adaptation.viscous
    carried = abs(torque.estimate)
    # Slip of the observer: the speed from the encoder alone has steps of a count
    slip = abs(sample.slip) if moves else 0.0
    turning = torque.estimate * sample.speed < 0.0  # the friction still has the sign of the last direction
    # Plates that slide, or will after a lock, come to the speed of the motor: the feedforward is for the higher one
    slides = (moves or law.held > 0.0) and settings.torque.alone and speed_demand * torque.estimate >= 0.0
    coming_slip = max(slip, abs(speed_demand)) if slides else slip
    error = demand - carried
    limit = law.pressure_limited if law.pressure_limited else law.voltage_limited
    frozen = not contact or step == 0.0 or turning or slip < settings.slip_hold or limit * error > 0.0
    leaves_lock = phase == Phase.SLIP_CONTROL and law.held > 0.0
    if leaves_lock:  # without a step
        law.held = max(law.held - _LOCK_EXIT_RATE * settings.lock.rate * step, 0.0)
        frozen = True
    elif phase != Phase.LOCK:
        law.held = 0.0
    feedforward = unlimited = lowest = 0.0
    highest = settings.pressure_limit
    if phase == Phase.SLIP_CONTROL and follows_pressure:
        unlimited, lowest = target, settings.pressure_floor
        if step > 0.0 and settings.feeds_back:
            # So a later demand for the present torque begins with the present pressure
            is_known = contact and slip >= settings.slip_hold and not turning
            carried_pressure = _feedforward(settings, carried, slip, level, correction)
            follow(law.torque_loop, sample.pressure - carried_pressure if is_known else 0.0)
    elif phase == Phase.SLIP_CONTROL:
        feedforward = _feedforward(settings, demand, coming_slip, level, correction)  # eq. 6.8
        unlimited = feedforward
        if settings.feeds_back:
            loop_error = 0.0 if turning else error
            unlimited += proportional_integral(
                law.torque_loop, loop_error, step, settings.torque_k_p, settings.torque_k_i, frozen
            )  # fig 6.16: p_d = p_ff + PI(M_d - M_sim)
    elif phase == Phase.LOCK:
        frozen, highest, model = True, settings.lock.pressure_limit, settings.torque.model
        law.held = hold(law.held, settings.lock, model, level, level * torque.coulomb_torque, carried, moves, step)
        feedforward = unlimited = holding_pressure(model, law.held, level)
        law.torque_loop.proportional = 0.0
    else:
        follow(law.torque_loop, 0.0)
        unlimited = settings.fill_pressure if phase == Phase.FILL else 0.0
    if leaves_lock:
        holding = holding_pressure(settings.torque.model, law.held, level)
        law.held = law.held if max(holding, sample.pressure) > unlimited + settings.torque.contact_band else 0.0
        unlimited, highest = max(unlimited, holding), settings.lock.pressure_limit
    highest = min(highest, max(settings.slow_above, law.pressure_demand + settings.slow_rate * step))
    law.pressure_demand = min(max(unlimited, lowest), highest)
    law.pressure_limited = _find_limited_side(unlimited, law.pressure_demand)
    return feedforward, frozen


@njit
def _regulate_pressure(law, settings, closing, pressure, step):
    """Pressure loop (docs/rig.md): update the valve voltage and the side on which it is limited; `pressure` [Pa]."""
    if not closing:
        follow(law.pressure_loop, 0.0)
    error = law.pressure_demand - pressure if closing else 0.0
    frozen = not law.torque.contact or not closing or step == 0.0 or law.voltage_limited * error > 0.0
    proportional_integral(law.pressure_loop, error, step, settings.pressure_k_p, settings.pressure_k_i, frozen)
    unlimited = law.pressure_demand + law.pressure_loop.proportional + law.pressure_loop.integral if closing else 0.0
    unlimited /= settings.valve_gain  # docs/rig.md: V = u/k_v
    law.voltage = min(max(unlimited, 0.0), settings.voltage_limit)
    law.voltage_limited = _find_limited_side(unlimited, law.voltage)


@njit
def _note_terms(terms, law, phase, demand, sample, feedforward, frozen):
    """Fill the record `terms` with TERMS; `demand` [Nm], `feedforward` [Pa], `frozen`: the torque integrator is held."""
    torque = law.torque
    contact, moves = torque.contact, torque.motion.moves
    capacity = torque.level * torque.coulomb_torque
    if contact and not moves:
        capacity = max(capacity, abs(torque.estimate))
    terms.torque_demand_nm = demand
    terms.torque_estimate_nm = torque.estimate
    terms.coulomb_part_nm = torque.coulomb
    terms.viscous_part_nm = torque.viscous
    terms.friction_state = torque.m
    terms.feedforward_bar = feedforward / BAR
    terms.proportional_bar = law.torque_loop.proportional / BAR
    terms.integral_bar = law.torque_loop.integral / BAR
    terms.pressure_demand_bar = law.pressure_demand / BAR
    terms.pressure_bar = sample.pressure / BAR
    terms.pressure_proportional_bar = law.pressure_loop.proportional / BAR
    terms.pressure_integral_bar = law.pressure_loop.integral / BAR
    terms.voltage_v = law.voltage
    terms.slip_rad_s = sample.speed
    terms.slip_acceleration_rad_s2 = sample.acceleration
    terms.temperature_degc = sample.temperature - ZERO_CELSIUS
    terms.observed_torque_nm = torque.observed
    terms.friction_level = torque.adaptation.level
    terms.viscous_correction = torque.adaptation.viscous
    terms.adaptation_active = torque.adaptation.active
    terms.in_contact = contact
    terms.frozen = frozen
    terms.saturated = law.pressure_limited != 0 or law.voltage_limited != 0
    terms.clutch_state = find_clutch_state(contact, moves, phase == Phase.LOCK)
    terms.capacity_nm = capacity
    terms.trimmed_level = torque.level


@njit
def _find_limited_side(unlimited, limited):
    """Return which limit has changed `unlimited` to `limited`: 1 the upper, -1 the lower, 0 none."""
    return int(unlimited > limited) - int(unlimited < limited)


@njit
def _feedforward(settings, demand, slip, level, correction):
    """Return the pressure [Pa] of eq. 6.8; with feedback alone, the contact pressure, which keeps the clutch filled."""
    return inverse_model(settings.torque.model, demand if settings.feeds_forward else 0.0, slip, level, correction)
