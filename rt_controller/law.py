"""The control law of section 6.5: estimate, feedforward, torque feedback, pressure regulator, each term published.

Where a pressure is asked for, it is the demand of the pressure regulator; the estimate goes on.
"""

from math import exp, nan
from typing import Any

import numpy as np
from numba import njit

from protocols.errors import InputError
from protocols.node import Column
from protocols.parameters import ParameterSet
from protocols.units import BAR, ZERO_CELSIUS
from rt_controller.adaptation import ADAPTATION, ADAPTATION_SETTINGS, UNTAUGHT, adapt
from rt_controller.estimator import MODEL, friction_state, torque_parts
from rt_controller.feedforward import inverse_model
from rt_controller.lag import LAG, lagged
from rt_controller.phases import Phase
from rt_controller.record import record
from rt_controller.regulator import PI, follow, proportional_integral

LAWS = ("both", "feedforward", "feedback")  # the three rows of Table 6.6

TERMS = tuple(
    Column(*column)
    for column in (
        ("torque_demand_nm", "Nm", "M_d; not a number while a pressure is followed"),
        ("torque_estimate_nm", "Nm", "M_sim of eq. 6.9"),
        ("coulomb_part_nm", "Nm", "M_C m before the level"),
        ("viscous_part_nm", "Nm", "viscous part before level and correction"),
        ("friction_state", "1", "m of eq. 6.9"),
        ("feedforward_bar", "bar", "p_ff of eq. 6.8"),
        ("proportional_bar", "bar", "P of the torque feedback"),
        ("integral_bar", "bar", "I of the torque feedback"),
        ("pressure_demand_bar", "bar", "p_d"),
        ("pressure_bar", "bar", "measured cylinder pressure"),
        ("pressure_proportional_bar", "bar", "P of the pressure regulator"),
        ("pressure_integral_bar", "bar", "I of the pressure regulator"),
        ("voltage_v", "V", "asked of the valve, before the guard"),
        ("slip_rad_s", "rad/s", "observed slip speed"),
        ("slip_acceleration_rad_s2", "rad/s^2", "observed slip acceleration"),
        ("temperature_degc", "degC", "measured oil temperature"),
        ("observed_torque_nm", "Nm", "M_m - J alpha behind the slip observer's lag: what the adaptation learns from"),
        ("friction_level", "1", "adapted level"),
        ("viscous_correction", "1", "adapted correction of the viscous part"),
        ("adaptation_active", "1", "1 while the adaptation learns"),
        ("in_contact", "1", "1 while the plates are believed to touch"),
        ("frozen", "1", "1 while the torque integrator is held"),
        ("saturated", "1", "1 while pressure demand or voltage is at its limit"),
    )
)

# Parameters, SI. feeds_forward, feeds_back: the row of Table 6.6; adapts: whether the level is learnt
LAW_SETTINGS = np.dtype(
    [("model", MODEL), ("adaptation", ADAPTATION_SETTINGS), ("feeds_forward", "?"), ("feeds_back", "?"), ("adapts", "?"),
     ("torque_k_p", "f8"), ("torque_k_i", "f8"), ("pressure_k_p", "f8"), ("pressure_k_i", "f8"), ("pressure_limit", "f8"),
     ("pressure_floor", "f8"), ("valve_gain", "f8"), ("voltage_limit", "f8"), ("fill_pressure", "f8"),
     ("contact_band", "f8"), ("bandwidth", "f8"), ("slip_hold", "f8")]
)  # fmt: skip
# estimate [Nm] and voltage [V] of the last step; friction state m; the torque balance behind the observer's lag, and its
# parts of the sample before; terms in the order of TERMS
LAW = np.dtype(
    [("estimate", "f8"), ("voltage", "f8"), ("m", "f8"), ("contact", "?"), ("saturated", "?"), ("observed", "f8"),
     ("coulomb", LAG), ("viscous", LAG), ("motor", LAG), ("coulomb_before", "f8"), ("viscous_before", "f8"),
     ("motor_before", "f8"), ("torque", PI), ("pressure", PI), ("adaptation", ADAPTATION), ("terms", "f8", len(TERMS))]
)  # fmt: skip


def law_settings(parameters: ParameterSet, law: str, adaptation: bool) -> dict[str, object]:
    """Fields of LAW_SETTINGS; `law` is one of LAWS, `adaptation` switches the adaptive level on. Raises InputError."""
    if law not in LAWS:
        raise InputError(f"control law {law!r} is unknown; allowed are {', '.join(LAWS)}")
    torque, pressure, phases = (parameters.si(group) for group in ("torque", "pressure", "phases"))
    return {
        "model": record(MODEL, parameters.si("model")),
        "adaptation": record(ADAPTATION_SETTINGS, parameters.si("adaptation")),
        "feeds_forward": law != "feedback", "feeds_back": law != "feedforward", "adapts": adaptation,
        "torque_k_p": torque["proportional_gain"], "torque_k_i": torque["integral_gain"],
        "pressure_k_p": pressure["proportional_gain"], "pressure_k_i": pressure["integral_gain"],
        "pressure_limit": torque["pressure_limit"], "pressure_floor": pressure["floor"],
        "valve_gain": pressure["valve_gain"], "voltage_limit": pressure["voltage_limit"],
        "fill_pressure": phases["fill_pressure"], "contact_band": phases["contact_band"],
        "bandwidth": parameters["slip.bandwidth"].si, "slip_hold": parameters["slip.hold"].si,
    }  # fmt: skip


def law_at_rest() -> Any:
    """LAW before its first step."""
    return record(LAW, adaptation=record(ADAPTATION, UNTAUGHT))


@njit
def mismatch(law):
    """Torque observed at the motor minus estimate, both behind the lag of the slip observer [Nm]."""
    level, correction = law.adaptation.level, law.adaptation.viscous
    return law.observed - level * (law.coulomb.out + law.viscous.out) - correction * law.viscous.out


@njit
def control(law, settings, phase, demand, sample, step, followed):
    """Move LAW on by `step` [s], 0 without a fresh sample, towards the torque `demand` [Nm].

    The demand is a magnitude; so are the estimate and the observed torque, whichever way the clutch slips.
    `followed` [Pa] is the pressure to be followed instead of the torque; not a number where there is none.
    """
    model, pressure, slip, follows = settings.model, sample.pressure, abs(sample.slip), followed == followed
    closing = phase == Phase.FILL or phase == Phase.SLIP_CONTROL
    floor = model.contact_pressure - (settings.contact_band if law.contact else 0.0)
    contact = closing and pressure >= floor
    law.contact = contact

    # estimate, eq. 6.9; out of contact there is no torque and m is 0
    coulomb = viscous = 0.0
    law.m = friction_state(model, law.m, pressure, slip, step) if contact else 0.0
    if contact:
        coulomb, viscous = torque_parts(model, law.m, pressure, slip, sample.temperature)
    _learn(law, settings, phase, coulomb, viscous, sample, step)
    level, correction = law.adaptation.level, law.adaptation.viscous
    law.estimate = level * (coulomb + viscous) + correction * viscous

    # torque loop: fig 6.16
    feedforward = wanted = least = 0.0
    frozen = not contact or law.saturated or step == 0.0
    held = frozen or slip < settings.slip_hold
    if phase == Phase.SLIP_CONTROL and follows:
        wanted, least = followed, settings.pressure_floor
        if step > 0.0 and settings.feeds_back:
            # so that a request for the torque there is now asks for the pressure there is now
            known = contact and slip >= settings.slip_hold
            there = _feedforward(settings, law.estimate, slip, level, correction)
            follow(law.torque, pressure - there if known else 0.0)
    elif phase == Phase.SLIP_CONTROL:
        feedforward = _feedforward(settings, demand, slip, level, correction)
        wanted = feedforward
        if settings.feeds_back:
            error = demand - law.estimate
            wanted += proportional_integral(law.torque, error, step, settings.torque_k_p, settings.torque_k_i, held)
    else:
        follow(law.torque, 0.0)
        wanted = settings.fill_pressure if phase == Phase.FILL else 0.0
    pressure_demand = min(max(wanted, least), settings.pressure_limit)
    saturated = pressure_demand != wanted

    # pressure loop: rig.md
    if not closing:
        follow(law.pressure, 0.0)
    error = pressure_demand - pressure if closing else 0.0
    proportional_integral(law.pressure, error, step, settings.pressure_k_p, settings.pressure_k_i, frozen)
    wanted = (
        (pressure_demand + law.pressure.proportional + law.pressure.integral) / settings.valve_gain if closing else 0.0
    )
    law.voltage = min(max(wanted, 0.0), settings.voltage_limit)
    law.saturated = saturated or law.voltage != wanted

    t = law.terms
    t[0], t[1], t[2], t[3], t[4] = nan if follows else demand, law.estimate, coulomb, viscous, law.m
    t[5], t[6], t[7] = feedforward / BAR, law.torque.proportional / BAR, law.torque.integral / BAR
    t[8], t[9], t[10] = pressure_demand / BAR, pressure / BAR, law.pressure.proportional / BAR
    t[11], t[12], t[13], t[14] = law.pressure.integral / BAR, law.voltage, sample.slip, sample.acceleration
    t[15], t[16], t[17], t[18] = sample.temperature - ZERO_CELSIUS, law.observed, level, correction
    t[19], t[20], t[21], t[22] = law.adaptation.active, contact, held, law.saturated


@njit
def _feedforward(settings, demand, slip, level, correction):
    """Of eq. 6.8; with feedback alone the clutch is held filled at the contact pressure."""
    return inverse_model(settings.model, demand if settings.feeds_forward else 0.0, slip, level, correction)


@njit
def _learn(law, settings, phase, coulomb, viscous, sample, step):
    """Compare both sides of the torque balance behind the same lag, and let the adaptation learn from it."""
    if step > 0.0:
        # The observer's second difference is centred on the sample before (lag.py).
        q = exp(-settings.bandwidth * step)
        lagged(law.coulomb, law.coulomb_before, q)
        lagged(law.viscous, law.viscous_before, q)
        motor = lagged(law.motor, law.motor_before, q)
        law.coulomb_before, law.viscous_before, law.motor_before = coulomb, viscous, sample.motor_torque
        observed = motor - settings.model.motor_inertia * sample.acceleration  # torque balance, rig.md 8
        law.observed = observed if sample.slip >= 0.0 else -observed
    stuck = sample.motor_stuck > settings.adaptation.stuck_time
    sliding = settings.adapts and phase == Phase.SLIP_CONTROL and law.contact and not stuck
    adapt(
        law.adaptation, settings.adaptation, law.coulomb.out, law.viscous.out, law.observed, sample.slip,
        sample.acceleration, sample.temperature, step, sliding,
    )  # fmt: skip
