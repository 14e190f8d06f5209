"""Estimate of the transmitted torque: model, adapted level, trim, torque balance of the motor.

Equation        contact, p >= p_contact: M = level (M_C m + f) + viscous f  (estimator.py), with the adapted and trimmed level;
                m follows the slip while the plates slide, and the applied torque while they stand
                balance  y = M_m - J alpha behind the observer's lag; it is compared with the model behind the same lag
Assumptions     the model is fast, the balance is correct: so the balance trims the model, if it is that of this clutch alone
                and adaptation is on
Not modelled    two clutches that both transmit: there plates that stand keep their last torque
References      docs/rig.md, 8; Janssens 2010, eq. 6.9
"""

from math import copysign, exp
from typing import Any

import numpy as np
from numba import njit

from protocols.files.parameters import ParameterSet
from rt_controller.law.adaptation import ADAPTATION, ADAPTATION_SETTINGS, INITIAL_ADAPTATION, adapt
from rt_controller.law.estimator import (
    MODEL,
    coulomb_torque,
    friction_state,
    plate_pressure,
    reachable_states,
    sliding_level,
    viscous_torque,
)
from rt_controller.law.lag import LAG, low_pass
from rt_controller.law.motion import MOTION, MOTION_SETTINGS, advance_motion
from rt_controller.law.presliding import PRESLIDING, PRESLIDING_SETTINGS, bend, straighten
from rt_controller.law.record import make_record
from rt_controller.law.trim import TRIM, TRIM_SETTINGS, compute_level, forget, lower, raise_to, trim

_REST_TORQUE_ERROR = 0.02  # of the torque at rest, chosen: gain error and noise of the motor torque sensor
_HALF_COUNTS_UNSURE = 3.0  # half counts in a sample, i.e. at most one count: the speed is then uncertain
_STEADY_FRICTION_STATE = 0.95  # |m| above which plates slide steadily, chosen; below it they have just turned
_LATEST_STOP = 0.8  # of a step, chosen: plates that reach speed 0 earlier have stopped in it; later it is uncertain
_LIFT_OFF_SHARE = 0.5  # of `touch_torque`, chosen: below this motor torque the plates have no contact any more
# Parameters in SI. adapts: level, viscous correction and trim are learnt; alone: the motor drives this clutch alone
TORQUE_SETTINGS = np.dtype(
    [("model", MODEL), ("adaptation", ADAPTATION_SETTINGS), ("motion", MOTION_SETTINGS),
     ("presliding", PRESLIDING_SETTINGS),
     ("trim", TRIM_SETTINGS),
     ("adapts", "?"), ("alone", "?"), ("contact_band", "f8"), ("touch_band", "f8"), ("touch_torque", "f8"),
     ("touch_time", "f8"), ("bandwidth", "f8")]
)  # fmt: skip
# estimate [Nm], signed as the slip; level [-]: adapted and trimmed; coulomb, viscous [Nm]: parts of the estimate at level 1; m
# [-] and coulomb_torque M_C [Nm]. cylinder, pressure [Pa]: in the cylinder and on the plates. borne [-]: torque that plates
# at rest carried, a share of M_C. contact: pressure above contact; pressed: the plates also rub; stands: they carry the applied
# torque. spin [rad/s], turn [rad]: motion that the motor would have if the capacity were that of the level. touched: time in
# contact [s]. observed [Nm]: torque balance behind the observer's lag. motor_before [Nm]: next input of motor_lag.
# demand_acting, demand_before [rad/s]: speed demands that the motor has begun to follow with this sample and with the one
# before. begun: there has been a sample
TORQUE = np.dtype(
    [("estimate", "f8"), ("level", "f8"), ("coulomb", "f8"), ("viscous", "f8"), ("m", "f8"), ("coulomb_torque", "f8"),
     ("cylinder", "f8"), ("pressure", "f8"), ("borne", "f8"),
     ("contact", "?"), ("pressed", "?"), ("stands", "?"), ("spin", "f8"), ("turn", "f8"), ("touched", "f8"),
     ("observed", "f8"), ("coulomb_lag", LAG), ("viscous_lag", LAG),
     ("motor_lag", LAG), ("motor_before", "f8"), ("demand_acting", "f8"), ("demand_before", "f8"), ("begun", "?"),
     ("adaptation", ADAPTATION), ("trim", TRIM), ("motion", MOTION), ("presliding", PRESLIDING)]
)  # fmt: skip


def make_torque_settings(parameters: ParameterSet, adapts: bool, alone: bool) -> dict[str, object]:
    """Return the fields of TORQUE_SETTINGS; `adapts` and `alone` as there."""
    phases, slip = parameters.list_si("phases"), parameters.list_si("slip")
    return {
        "model": make_record(MODEL, parameters.list_si("model")),
        "adaptation": make_record(ADAPTATION_SETTINGS, parameters.list_si("adaptation")),
        "motion": make_record(MOTION_SETTINGS, {name: slip[name] for name in MOTION_SETTINGS.names or ()}),
        "presliding": make_record(PRESLIDING_SETTINGS, parameters.list_si("bending")),
        "trim": make_record(TRIM_SETTINGS, parameters.list_si("trim")),
        "adapts": adapts, "alone": alone, "bandwidth": slip["bandwidth"],
        **{name: phases[name] for name in ("contact_band", "touch_band", "touch_torque", "touch_time")},
    }  # fmt: skip


def make_torque_at_rest() -> Any:
    """Return TORQUE before its first step."""
    return make_record(TORQUE, level=1.0, adaptation=make_record(ADAPTATION, INITIAL_ADAPTATION))


@njit
def mismatch(torque, settings):
    """Return the observed torque minus that of the model without trim, both behind the lag of the slip observer [Nm].

    It is 0 if a friction level within the bounds of the adaptation explains the difference. Plates that stand carry the applied
    torque, so for them it is the applied torque beyond their capacity.
    """
    coulomb, viscous = torque.coulomb_lag.out, torque.viscous_lag.out
    whole, rest = coulomb + viscous, torque.observed - torque.adaptation.viscous * viscous
    one, other = settings.adaptation.level_low * whole, settings.adaptation.level_high * whole
    if min(one, other) - settings.touch_torque <= rest <= max(one, other) + settings.touch_torque:
        return 0.0
    return rest - torque.adaptation.level * whole


@njit
def estimate(torque, settings, closing, closed, speed_demand, motor_limited, sample, step):
    """Advance TORQUE by `step` [s], which is 0 without a new sample, with the values of the SAMPLE `sample`.

    `closing`: the plates may touch; `closed`: the fill is over. `speed_demand` [rad/s] of the motor; `motor_limited`: the motor
    is at its torque limit.
    """
    model, speed = settings.model, sample.speed
    pressure = plate_pressure(model, torque.pressure, torque.cylinder, sample.pressure, step)
    torque.pressure, torque.cylinder = pressure, sample.pressure
    floor = model.contact_pressure - (settings.contact_band if torque.contact else 0.0)
    torque.contact = closing and pressure >= floor
    rested = torque.motion.quiet >= settings.motion.stick_time
    advance_motion(torque.motion, settings.motion, speed, sample.acceleration, step)
    correction = torque.adaptation.viscous
    torque.level = _level(torque, settings)
    before_coulomb, before_viscous = torque.coulomb, torque.viscous
    torque.coulomb = torque.viscous = 0.0
    if _update_pressed(torque, settings, pressure, step):
        torque.coulomb_torque = coulomb_torque(model, pressure)
        _update_rubbing(torque, settings, sample, pressure, rested, step)
        torque.coulomb = torque.coulomb_torque * torque.m  # eq. 6.9
    else:
        torque.m = torque.coulomb_torque = torque.borne = 0.0  # without contact there is no torque
        torque.stands = False
        straighten(torque.presliding)
    torque.estimate = torque.level * (torque.coulomb + torque.viscous) + correction * torque.viscous
    _update_balance(torque, settings, before_coulomb, before_viscous, speed_demand, motor_limited, sample, step)
    coulomb, viscous = torque.coulomb_lag.out, torque.viscous_lag.out
    stuck = sample.motor_stuck > settings.adaptation.stuck_time
    adapt(
        torque.adaptation, settings.adaptation, coulomb, viscous, torque.observed, sample.slip, sample.acceleration,
        sample.temperature, step, settings.adapts and closed and torque.contact and not stuck,
    )  # fmt: skip
    explained = mismatch(torque, settings) == 0.0  # otherwise the friction level is not the cause
    if not torque.pressed or stuck:
        forget(torque.trim)
    elif settings.adapts and settings.alone and not torque.stands and explained:
        trim(torque.trim, settings.trim, coulomb + viscous, torque.observed - correction * viscous, step)


@njit
def _update_rubbing(torque, settings, sample, pressure, rested, step):
    """Update m and viscous torque of plates that rub, after `step` [s]; `rested`: they stood for `stick_time` before."""
    model, plates = settings.model, torque.motion
    known = sample.known and torque.coulomb_torque > 0.0  # the torque applied to these plates
    applied = sample.applied / torque.coulomb_torque if known else 0.0
    if settings.presliding.angle > 0.0:
        _update_bending(torque, settings, sample, pressure, known, step)
        return
    if rested and known:
        torque.borne = applied
    torque.stands = known and plates.rests
    if torque.stands:
        plates.end = 0.0
        _update_resting(torque, settings, sample, pressure, applied, step)
        return
    turns, begin_share = False, 0.0
    if plates.turns:
        least, most = reachable_states(model, torque.m, step)
        share = applied / torque.level
        turns = (share < least if plates.begin > 0.0 else share > most) if known else True
        begin_share = plates.begin / (plates.begin - plates.end)  # of the step, before it turned
        if known and least <= share <= most and (sample.speed == 0.0 or begin_share < _LATEST_STOP):
            torque.stands, torque.m, plates.end = True, share, 0.0
            return
    stops = not turns and (plates.turns or plates.end * sample.speed < 0.0)
    if stops:
        plates.end = 0.0
    if turns:
        torque.m = friction_state(model, torque.m, pressure, plates.begin, begin_share * step)  # eq. 6.9
        torque.m = friction_state(model, torque.m, pressure, plates.end, (1.0 - begin_share) * step)
    else:
        _slide_one_way(torque, settings, sample, pressure, applied, known, step)
    slow = abs(sample.speed) <= settings.motion.coarse_speed
    slip = plates.end if turns or not (slow or stops) else plates.slow
    torque.viscous = viscous_torque(model, pressure, slip, sample.temperature)
    if known and settings.alone and (slow or stops):
        _limit_viscous_torque(torque, settings, sample, slip, stops)


@njit
def _slide_one_way(torque, settings, sample, pressure, applied, known, step):
    """Update m of plates that do not turn within `step` [s]; `applied` is the share of M_C applied to them, if `known`."""
    model, plates = settings.model, torque.motion
    if known and plates.moves:
        if torque.borne * sample.speed > 0.0:  # they have broken away: they carried their capacity
            torque.m = copysign(1.0, torque.borne)
            share = max(abs(torque.borne), settings.adaptation.level_low)
            lower(torque.trim, settings.trim, torque.adaptation.level, share)
            torque.level = _level(torque, settings)
        torque.borne = 0.0
    unsure = abs(sample.speed) * step <= _HALF_COUNTS_UNSURE * settings.motion.standing_angle
    if known and unsure and abs(torque.m) < _STEADY_FRICTION_STATE:
        least, most = reachable_states(model, torque.m, step)  # in both directions of creep
        torque.m = min(max(applied / torque.level, least), most)
    else:
        mean = sample.speed if sample.speed != 0.0 else 0.5 * (plates.begin + plates.end)
        torque.m = friction_state(model, torque.m, pressure, mean, step)  # eq. 6.9


@njit
def _limit_viscous_torque(torque, settings, sample, slip, stops):
    """Limit the viscous torque of slow plates to what the torque balance leaves; `slip` [rad/s], from few encoder counts.

    The speed from the encoder is coarse here, but the balance gives the torque. `stops`: the plates come to rest in this step.
    """
    model = settings.model
    least = 0.0 if stops else torque.viscous * min(abs(slip) / settings.motion.coarse_speed, 1.0)
    balance = (sample.motor_torque - model.motor_inertia * sample.acceleration) / torque.level  # docs/rig.md, 8
    rest = balance - torque.coulomb_torque * torque.m
    torque.viscous = min(max(rest, min(torque.viscous, least)), max(torque.viscous, least))


@njit
def _update_bending(torque, settings, sample, pressure, known, step):
    """Update m and viscous torque of plates that bend before they slide, after `step` [s].

    Until all elements slip, the plates carry the applied torque up to their capacity.
    """
    model, plates = settings.model, torque.motion
    turned = sample.speed * step
    level = sliding_level(model, pressure, sample.speed)
    torque.m, slides = bend(
        torque.presliding, settings.presliding, turned, level, model.attraction, torque.coulomb_torque, step
    )
    plates.moves = torque.presliding.still < settings.motion.stick_time
    torque.stands = known and not slides
    if slides:
        torque.viscous = viscous_torque(model, pressure, plates.end, sample.temperature)
    elif known:
        balance = (sample.applied - model.motor_inertia * sample.acceleration) / torque.coulomb_torque  # docs/rig.md, 8
        torque.m = min(max(balance / torque.level, -1.0), 1.0)


@njit
def _update_resting(torque, settings, sample, pressure, applied, step):
    """Update m of plates at rest: they carry the `applied` share of M_C, up to their capacity.

    The capacity includes the viscous torque of a creep too slow for the encoder.
    """
    creep = 2.0 * settings.motion.standing_angle / torque.motion.quiet
    viscous = viscous_torque(settings.model, pressure, creep, sample.temperature)
    most = 1.0 + _REST_TORQUE_ERROR + viscous / torque.coulomb_torque
    if _exceeds_capacity(torque, settings, abs(applied), most, step):
        share = min(abs(applied) / most, settings.adaptation.level_high)
        raise_to(torque.trim, settings.trim, torque.adaptation.level, share)
        torque.level = _level(torque, settings)
    torque.m = min(max(applied / torque.level, -most), most)


@njit
def _level(torque, settings):
    """Return the present friction level [-]: adapted and trimmed."""
    s = settings.adaptation
    learnt = torque.adaptation.level
    if not (settings.adapts and settings.alone):
        return learnt
    return compute_level(torque.trim, settings.trim, learnt, s.level_low, s.level_high)


@njit
def _exceeds_capacity(torque, settings, applied, capacity, step):
    """Return whether plates at rest carry more than their level allows.

    `applied` and `capacity` are shares of M_C. With their difference the motor would have turned by `coarse_angle` by now, but
    the encoder has not moved by a count.
    """
    # rad/s^2, docs/rig.md, 8
    gain = (applied - torque.level * capacity) * torque.coulomb_torque / settings.model.motor_inertia
    torque.spin = max(torque.spin + gain * step, 0.0) if torque.motion.rests else 0.0
    torque.turn = torque.turn + torque.spin * step if torque.spin > 0.0 else 0.0
    exceeded = torque.turn >= settings.motion.coarse_angle
    if exceeded:
        torque.spin = torque.turn = 0.0
    return exceeded


@njit
def _update_pressed(torque, settings, pressure, step):
    """Update whether the plates rub, and return it.

    At the end of the fill the pressure reaches contact before the piston does, as the piston still moves and its damping takes
    a part of the pressure. The piston has arrived when the pressure is clearly above contact, or the motor measures a torque,
    or `touch_time` has passed. It has left when the pressure is close to contact and the motor measures no torque of moving
    plates.
    """
    above = pressure - settings.model.contact_pressure
    felt = abs(torque.observed)
    lifted = (
        settings.alone
        and torque.motion.moves
        and above < settings.contact_band
        and felt < _LIFT_OFF_SHARE * settings.touch_torque
    )
    torque.touched = torque.touched + step if torque.contact and not lifted else 0.0
    arrived = above >= settings.touch_band or felt >= settings.touch_torque or torque.touched >= settings.touch_time
    torque.pressed = torque.contact and not lifted and (torque.pressed or arrived)
    return torque.pressed


@njit
def _update_balance(torque, settings, coulomb, viscous, speed_demand, motor_limited, sample, step):
    """Update both sides of the torque balance behind the same lag; `coulomb`, `viscous` [Nm] are of the sample before."""
    if step > 0.0:
        if not torque.begun:  # the motor already has its speed when a run begins (sample.py): its torque does not jump
            torque.begun, torque.demand_acting, torque.demand_before = True, speed_demand, speed_demand
        # The observer's second difference is centred on the sample before (lag.py).
        q = exp(-settings.bandwidth * step)
        low_pass(torque.coulomb_lag, coulomb, q)
        low_pass(torque.viscous_lag, viscous, q)
        motor = low_pass(torque.motor_lag, torque.motor_before, q)
        # The sample was taken just before the last demand began to act: the mean torque contains half of the jump.
        jump = 0.0 if motor_limited else settings.model.motor_gain * (torque.demand_acting - torque.demand_before)
        torque.motor_before = sample.motor_torque + 0.5 * jump
        torque.demand_before, torque.demand_acting = torque.demand_acting, speed_demand
        torque.observed = motor - settings.model.motor_inertia * sample.acceleration  # docs/rig.md, 8
