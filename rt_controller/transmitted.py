"""Torque transmitted, as the controller believes it: model, adapted level, trim, torque balance of the motor.

Equation        contact, p >= p_contact: M = level (M_C m + f) + viscous f  (estimator.py), level the adapted one, trimmed; m
                follows the slip where the plates slide, and the torque applied where they stand
                balance  y = M_m - J alpha behind the observer's lag; compared with the model behind the same lag
Assumptions     the model is fast, the balance is right: where the balance is this clutch's own, and is learnt from, the
                model is trimmed by what the balance shows
Not modelled    a motor torque of two clutches: there the plates that stand keep the torque they had
References      rig.md 8; Janssens 2010, eq. 6.9
"""

from math import exp
from typing import Any

import numpy as np
from numba import njit

from protocols.parameters import ParameterSet
from rt_controller.adaptation import ADAPTATION, ADAPTATION_SETTINGS, UNTAUGHT, adapt
from rt_controller.clutch_state import MOTION, MOTION_SETTINGS, motion
from rt_controller.estimator import MODEL, coulomb_torque, friction_state, reachable_states, viscous_torque
from rt_controller.lag import LAG, lagged
from rt_controller.record import record
from rt_controller.trim import TRIM, TRIM_SETTINGS, forget, hold, trim, trimmed

# Plates that carry more than the level says, by a tenth, for so long [s], have a higher one: breaking away, 1 Nm more than they
# carry would have moved 0.05 kg m^2 by six counts of the encoder
_CLEARLY, _SURELY = 1.1, 5e-3
# Parameters, SI. adapts: whether level, viscous correction and trim are learnt; alone: whether the motor's torque is that of
# this clutch
TORQUE_SETTINGS = np.dtype(
    [("model", MODEL), ("adaptation", ADAPTATION_SETTINGS), ("motion", MOTION_SETTINGS), ("trim", TRIM_SETTINGS),
     ("adapts", "?"), ("alone", "?"), ("contact_band", "f8"), ("touch_band", "f8"), ("touch_torque", "f8"),
     ("touch_time", "f8"), ("bandwidth", "f8")]
)  # fmt: skip
# estimate [Nm], signed as the slip; level [-] with which it is made, adapted and trimmed; coulomb and viscous part [Nm] before
# it; m, and the Coulomb torque it stands on [Nm]; contact: by the pressure; pressed: the plates rub, too; stands: and hold
# what is applied; exceeded: for so long more than the level says [s]; touched: time in contact [s]; observed [Nm]: the torque
# balance behind the observer's lag; lags and what they are given next; demand_acting, demand_before [rad/s]: speed demands that
# the motor has begun to follow with this sample and the one before
TORQUE = np.dtype(
    [("estimate", "f8"), ("level", "f8"), ("coulomb", "f8"), ("viscous", "f8"), ("m", "f8"), ("coulomb_torque", "f8"),
     ("contact", "?"), ("pressed", "?"), ("stands", "?"), ("exceeded", "f8"), ("touched", "f8"),
     ("observed", "f8"), ("coulomb_lag", LAG), ("viscous_lag", LAG),
     ("motor_lag", LAG), ("motor_before", "f8"), ("demand_acting", "f8"), ("demand_before", "f8"),
     ("adaptation", ADAPTATION), ("trim", TRIM), ("motion", MOTION)]
)  # fmt: skip


def torque_settings(parameters: ParameterSet, adapts: bool, alone: bool) -> dict[str, object]:
    """Fields of TORQUE_SETTINGS."""
    phases, slip = parameters.si("phases"), parameters.si("slip")
    return {
        "model": record(MODEL, parameters.si("model")),
        "adaptation": record(ADAPTATION_SETTINGS, parameters.si("adaptation")),
        "motion": record(MOTION_SETTINGS, {name: slip[name] for name in MOTION_SETTINGS.names or ()}),
        "trim": record(TRIM_SETTINGS, parameters.si("trim")),
        "adapts": adapts, "alone": alone, "bandwidth": slip["bandwidth"],
        **{name: phases[name] for name in ("contact_band", "touch_band", "touch_torque", "touch_time")},
    }  # fmt: skip


def torque_at_rest() -> Any:
    """TORQUE before its first step."""
    return record(TORQUE, level=1.0, adaptation=record(ADAPTATION, UNTAUGHT))


@njit
def mismatch(torque, settings):
    """Torque observed at the motor minus that of the model, untrimmed, behind the lag of the slip observer [Nm]; 0 where a
    friction level within the bounds of the adaptation explains it.

    Plates that stand carry what is applied, so there it is what is applied beyond their capacity.
    """
    coulomb, viscous = torque.coulomb_lag.out, torque.viscous_lag.out
    whole, rest = coulomb + viscous, torque.observed - torque.adaptation.viscous * viscous
    one, other = settings.adaptation.level_low * whole, settings.adaptation.level_high * whole
    if min(one, other) - settings.touch_torque <= rest <= max(one, other) + settings.touch_torque:
        return 0.0
    return rest - torque.adaptation.level * whole


@njit
def estimate(torque, settings, closing, closed, speed_demand, sample, step):
    """Move TORQUE on by `step` [s], 0 without a fresh sample, to what `sample` says.

    `closing`: the valve is open; `closed`: it is, and the fill is over. `speed_demand` [rad/s] of the motor.
    """
    model, pressure, speed = settings.model, sample.pressure, sample.speed
    floor = model.contact_pressure - (settings.contact_band if torque.contact else 0.0)
    torque.contact = closing and pressure >= floor
    motion(torque.motion, settings.motion, speed, sample.slip, step)
    learnt, correction = torque.adaptation.level, torque.adaptation.viscous
    low, high = settings.adaptation.level_low, settings.adaptation.level_high
    learns = settings.adapts and settings.alone
    torque.level = trimmed(torque.trim, settings.trim, learnt, low, high) if learns else learnt
    before_coulomb, before_viscous = torque.coulomb, torque.viscous
    torque.coulomb = torque.viscous = 0.0
    if _pressed(torque, settings, pressure, step):
        torque.coulomb_torque = coulomb_torque(model, pressure)
        if settings.alone and torque.motion.stands and torque.coulomb_torque > 0.0:
            applied = sample.motor_torque / torque.coulomb_torque
            exceeds = learns and torque.motion.rests and abs(applied) > _CLEARLY * torque.level
            torque.exceeded = torque.exceeded + step if exceeds else 0.0
            if torque.exceeded >= _SURELY:
                hold(torque.trim, settings.trim, learnt, min(abs(applied), high))
                torque.level = trimmed(torque.trim, settings.trim, learnt, low, high)
            least, most = (
                (-1.0, 1.0) if torque.stands or torque.motion.rests else reachable_states(model, torque.m, step)
            )
            share = applied / torque.level
            torque.stands = least <= share <= most
            torque.m = min(max(share, least), most)
        else:
            torque.stands = False
            torque.m = friction_state(model, torque.m, pressure, speed, step)
        if not torque.stands:
            torque.viscous = viscous_torque(model, pressure, torque.motion.smooth, sample.temperature)
        torque.coulomb = torque.coulomb_torque * torque.m  # eq. 6.9
    else:
        torque.m = torque.coulomb_torque = 0.0  # out of contact there is no torque
        torque.stands = False
    torque.estimate = torque.level * (torque.coulomb + torque.viscous) + correction * torque.viscous
    _balance(torque, settings, before_coulomb, before_viscous, speed_demand, sample, step)
    coulomb, viscous = torque.coulomb_lag.out, torque.viscous_lag.out
    stuck = sample.motor_stuck > settings.adaptation.stuck_time
    adapt(
        torque.adaptation, settings.adaptation, coulomb, viscous, torque.observed, sample.slip, sample.acceleration,
        sample.temperature, step, settings.adapts and closed and torque.contact and not stuck,
    )  # fmt: skip
    if not torque.pressed or stuck:
        forget(torque.trim)
    elif learns and not torque.stands and mismatch(torque, settings) == 0.0:  # else it is no friction level
        trim(torque.trim, settings.trim, coulomb + viscous, torque.observed - correction * viscous, step)


@njit
def _pressed(torque, settings, pressure, step):
    """Whether the plates rub. At the end of the fill the pressure tells of contact before the piston has arrived: it moves, and
    its damping takes a part. It has arrived when the pressure is clearly above contact or the motor feels a torque."""
    torque.touched = torque.touched + step if torque.contact else 0.0
    arrived = (
        pressure >= settings.model.contact_pressure + settings.touch_band
        or abs(torque.observed) >= settings.touch_torque
        or torque.touched >= settings.touch_time
    )
    torque.pressed = torque.contact and (torque.pressed or arrived)
    return torque.pressed


@njit
def _balance(torque, settings, coulomb, viscous, speed_demand, sample, step):
    """Both sides of the torque balance behind the same lag; `coulomb`, `viscous` [Nm] are those of the sample before."""
    if step > 0.0:
        # The observer's second difference is centred on the sample before (lag.py).
        q = exp(-settings.bandwidth * step)
        lagged(torque.coulomb_lag, coulomb, q)
        lagged(torque.viscous_lag, viscous, q)
        motor = lagged(torque.motor_lag, torque.motor_before, q)
        # The sample was taken just before the demand sent last began to act: half of what it changed is the mean's.
        jump = settings.model.motor_gain * (torque.demand_acting - torque.demand_before)
        torque.motor_before = sample.motor_torque + 0.5 * jump
        torque.demand_before, torque.demand_acting = torque.demand_acting, speed_demand
        torque.observed = motor - settings.model.motor_inertia * sample.acceleration  # rig.md, 8
