"""The control law of section 6.5: estimate, feedforward, torque feedback, pressure regulator, each term published.

Where a pressure is asked for, it is the demand of the pressure regulator; the estimate goes on. In the phase `lock` the pressure
is what holds more than the torque carried (`lock.py`). The torque demand is a magnitude; torque and slip carry a sign.

Anti-windup     conditional integration: an integrator stands still only while its error would drive it further into the limit
                that is active. So each loop leaves its limit at once, needs no further gain, and does not stop the other: the
                pressure still settles while the torque loop is at its limit. The torque loop also waits for a valve at its limit.
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
from rt_controller.clutch_state import MOTION, MOTION_SETTINGS, ClutchState, motion
from rt_controller.estimator import MODEL, coulomb_torque, friction_state, held_state, viscous_torque
from rt_controller.feedforward import holding_pressure, inverse_model
from rt_controller.lag import LAG, lagged
from rt_controller.lock import LOCK_SETTINGS, hold
from rt_controller.phases import Phase
from rt_controller.record import record
from rt_controller.regulator import PI, follow, proportional_integral
from rt_controller.trim import TRIM, TRIM_SETTINGS, forget, trim

LAWS = ("both", "feedforward", "feedback")  # the three rows of Table 6.6

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
        ("voltage_v", "V", "asked of the valve, before the guard"),
        ("slip_rad_s", "rad/s", "the encoder's own slip speed, mean since the sample before: what drives eq. 6.9"),
        ("slip_acceleration_rad_s2", "rad/s^2", "observed slip acceleration"),
        ("temperature_degc", "degC", "measured oil temperature"),
        ("observed_torque_nm", "Nm", "M_m - J alpha behind the slip observer's lag: what the adaptation learns from"),
        ("friction_level", "1", "adapted level"),
        ("viscous_correction", "1", "adapted correction of the viscous part"),
        ("adaptation_active", "1", "1 while the adaptation learns"),
        ("in_contact", "1", "1 while the plates are believed to touch"),
        ("frozen", "1", "1 while the torque integrator is held"),
        ("saturated", "1", "1 while pressure demand or voltage is at its limit"),
        ("clutch_state", "1", f"what the plates do: {', '.join(f'{s.value} {s.name.lower()}' for s in ClutchState)}"),
        (
            "capacity_nm",
            "Nm",
            "what the plates carry before they slide: level M_C, or what they carry, where that is more",
        ),
        (
            "trim",
            "1",
            "share by which the estimate is above level and model: what the motor has shown for a tenth of a second",
        ),
    )
)

# Parameters, SI. feeds_forward, feeds_back: the row of Table 6.6; adapts: whether level and correction are learnt; alone: whether
# the motor's torque is that of this clutch
LAW_SETTINGS = np.dtype(
    [("model", MODEL), ("adaptation", ADAPTATION_SETTINGS), ("motion", MOTION_SETTINGS), ("lock", LOCK_SETTINGS), ("trim", TRIM_SETTINGS),
     ("feeds_forward", "?"), ("feeds_back", "?"), ("adapts", "?"), ("alone", "?"),
     ("torque_k_p", "f8"), ("torque_k_i", "f8"), ("pressure_k_p", "f8"), ("pressure_k_i", "f8"), ("pressure_limit", "f8"),
     ("pressure_floor", "f8"), ("valve_gain", "f8"), ("voltage_limit", "f8"), ("fill_pressure", "f8"),
     ("contact_band", "f8"), ("touch_band", "f8"), ("touch_torque", "f8"), ("touch_time", "f8"), ("bandwidth", "f8"), ("slip_hold", "f8")]
)  # fmt: skip
# estimate [Nm] and voltage [V] of the last step; friction state m, and the Coulomb torque it stands on [Nm]; contact: by the
# pressure; pressed: the plates rub, too; touched: time in contact [s]; pressure_limited,
# voltage_limited: 1 at the upper limit, -1 at the lower, else 0; held: capacity asked for in lock [Nm], 0 outside; pressure_demand [Pa]; level: adapted
# and trimmed; the torque balance behind the observer's lag, and its parts of the sample before; terms in the order of TERMS
LAW = np.dtype(
    [("estimate", "f8"), ("voltage", "f8"), ("m", "f8"), ("coulomb_torque", "f8"), ("contact", "?"), ("pressed", "?"), ("touched", "f8"),
     ("pressure_limited", "i8"), ("voltage_limited", "i8"), ("held", "f8"), ("pressure_demand", "f8"), ("observed", "f8"), ("level", "f8"), ("trim", TRIM),
     ("coulomb", LAG), ("viscous", LAG), ("motor", LAG), ("coulomb_before", "f8"), ("viscous_before", "f8"),
     ("motor_before", "f8"), ("torque", PI), ("pressure", PI), ("adaptation", ADAPTATION), ("motion", MOTION),
     ("terms", "f8", len(TERMS))]
)  # fmt: skip


def law_settings(parameters: ParameterSet, law: str, adaptation: bool, alone: bool) -> dict[str, object]:
    """Fields of LAW_SETTINGS; `law` is one of LAWS, `adaptation` switches the adaptive level on. Raises InputError.

    `alone`: the motor's torque is that of this clutch.
    """
    if law not in LAWS:
        raise InputError(f"control law {law!r} is unknown; allowed are {', '.join(LAWS)}")
    torque, pressure, phases, slip = (parameters.si(group) for group in ("torque", "pressure", "phases", "slip"))
    return {
        "model": record(MODEL, parameters.si("model")),
        "adaptation": record(ADAPTATION_SETTINGS, parameters.si("adaptation")),
        "motion": record(MOTION_SETTINGS, {name: slip[name] for name in MOTION_SETTINGS.names or ()}),
        "trim": record(TRIM_SETTINGS, parameters.si("trim")),
        "lock": record(LOCK_SETTINGS, parameters.si("lock")),
        "feeds_forward": law != "feedback", "feeds_back": law != "feedforward", "adapts": adaptation, "alone": alone,
        "torque_k_p": torque["proportional_gain"], "torque_k_i": torque["integral_gain"],
        "pressure_k_p": pressure["proportional_gain"], "pressure_k_i": pressure["integral_gain"],
        "pressure_limit": torque["pressure_limit"], "pressure_floor": pressure["floor"],
        "valve_gain": pressure["valve_gain"], "voltage_limit": pressure["voltage_limit"],
        "fill_pressure": phases["fill_pressure"], "contact_band": phases["contact_band"],
        "touch_band": phases["touch_band"], "touch_torque": phases["touch_torque"], "touch_time": phases["touch_time"],
        "bandwidth": slip["bandwidth"], "slip_hold": slip["hold"],
    }  # fmt: skip


def law_at_rest() -> Any:
    """LAW before its first step."""
    return record(LAW, adaptation=record(ADAPTATION, UNTAUGHT))


@njit
def mismatch(law):
    """Torque observed at the motor minus that of the model, both behind the lag of the slip observer [Nm].

    Plates that stand carry what is applied (`held_state`), so there it is what is applied beyond their capacity.
    """
    level, correction = law.adaptation.level, law.adaptation.viscous
    return law.observed - level * (law.coulomb.out + law.viscous.out) - correction * law.viscous.out


@njit
def control(law, settings, phase, demand, speed_demand, sample, step, followed):
    """Move LAW on by `step` [s], 0 without a fresh sample, towards the torque `demand` [Nm], a magnitude.

    `speed_demand` [rad/s] is what the motor is asked for.
    `followed` [Pa] is the pressure to be followed instead of the torque; not a number where there is none.
    """
    model, pressure, follows = settings.model, sample.pressure, followed == followed
    closing = phase == Phase.FILL or phase == Phase.SLIP_CONTROL or phase == Phase.LOCK
    floor = model.contact_pressure - (settings.contact_band if law.contact else 0.0)
    contact = closing and pressure >= floor
    law.contact = contact
    moving = motion(law.motion, settings.motion, sample.speed, step)
    state = ClutchState.OPEN.value
    if contact:
        state = ClutchState.SLIDING.value if moving else ClutchState.STICKING.value
    coulomb, viscous = _estimate(law, settings, phase, speed_demand, sample, step)
    level, viscous_level = law.level, law.adaptation.viscous
    capacity = level * law.coulomb_torque if contact else 0.0
    if state == ClutchState.STICKING.value:
        capacity = max(capacity, abs(law.estimate))
        if phase == Phase.LOCK:
            state = ClutchState.LOCKED.value

    # torque loop: fig 6.16
    slip = abs(sample.slip) if moving else 0.0  # of the observer: the encoder's own steps with every count
    feedforward = wanted = least = 0.0
    most = settings.pressure_limit
    error = demand - abs(law.estimate)
    turning = law.estimate * sample.speed < 0.0  # the friction of the direction before is still there
    limit = law.pressure_limited if law.pressure_limited else law.voltage_limited
    waits = not contact or step == 0.0 or turning or slip < settings.slip_hold or limit * error > 0.0
    if phase != Phase.LOCK:
        law.held = 0.0
    if phase == Phase.SLIP_CONTROL and follows:
        wanted, least = followed, settings.pressure_floor
        if step > 0.0 and settings.feeds_back:
            # so that a request for the torque there is now asks for the pressure there is now
            known = contact and slip >= settings.slip_hold and not turning
            there = _feedforward(settings, abs(law.estimate), slip, level, viscous_level)
            follow(law.torque, pressure - there if known else 0.0)
    elif phase == Phase.SLIP_CONTROL:
        feedforward = _feedforward(settings, demand, slip, level, viscous_level)
        wanted = feedforward
        if settings.feeds_back:
            shown = 0.0 if turning else error
            wanted += proportional_integral(law.torque, shown, step, settings.torque_k_p, settings.torque_k_i, waits)
    elif phase == Phase.LOCK:
        waits, most = True, settings.lock.pressure_limit
        there = level * law.coulomb_torque
        law.held = hold(law.held, settings.lock, model, level, there, abs(law.estimate), moving, step)
        feedforward = wanted = holding_pressure(model, law.held, level)
        law.torque.proportional = 0.0
    else:
        follow(law.torque, 0.0)
        wanted = settings.fill_pressure if phase == Phase.FILL else 0.0
    pressure_demand = min(max(wanted, least), most)
    law.pressure_demand, law.pressure_limited = pressure_demand, _side(wanted, pressure_demand)

    # pressure loop: rig.md
    if not closing:
        follow(law.pressure, 0.0)
    error = pressure_demand - pressure if closing else 0.0
    frozen = not contact or step == 0.0 or law.voltage_limited * error > 0.0
    proportional_integral(law.pressure, error, step, settings.pressure_k_p, settings.pressure_k_i, frozen)
    wanted = (
        (pressure_demand + law.pressure.proportional + law.pressure.integral) / settings.valve_gain if closing else 0.0
    )
    law.voltage = min(max(wanted, 0.0), settings.voltage_limit)
    law.voltage_limited = _side(wanted, law.voltage)

    t = law.terms
    t[0], t[1], t[2], t[3], t[4] = nan if follows else demand, law.estimate, coulomb, viscous, law.m
    t[5], t[6], t[7] = feedforward / BAR, law.torque.proportional / BAR, law.torque.integral / BAR
    t[8], t[9], t[10] = pressure_demand / BAR, pressure / BAR, law.pressure.proportional / BAR
    t[11], t[12], t[13], t[14] = law.pressure.integral / BAR, law.voltage, sample.speed, sample.acceleration
    t[15], t[16] = sample.temperature - ZERO_CELSIUS, law.observed
    t[17], t[18] = law.adaptation.level, viscous_level
    t[19], t[20], t[21] = law.adaptation.active, contact, waits
    t[22] = law.pressure_limited != 0 or law.voltage_limited != 0
    t[23], t[24], t[25] = state, capacity, law.trim.share


@njit
def _side(wanted, limited):
    """Which limit has cut `wanted`: 1 the upper, -1 the lower, 0 none."""
    return int(wanted > limited) - int(wanted < limited)


@njit
def _feedforward(settings, demand, slip, level, correction):
    """Of eq. 6.8; with feedback alone the clutch is held filled at the contact pressure."""
    return inverse_model(settings.model, demand if settings.feeds_forward else 0.0, slip, level, correction)


@njit
def _estimate(law, settings, phase, speed_demand, sample, step):
    """Set the torque transmitted, and `law.level` with which it is made; return Coulomb and viscous part before it [Nm].

    The model is fast, the torque balance at the motor is right: where the balance is this clutch's own, and is learnt from, the
    model is trimmed by what the balance shows. Plates that stand carry what is applied, up to their capacity.
    """
    model, pressure, speed = settings.model, sample.pressure, sample.speed
    learns = settings.adapts and settings.alone
    if learns:
        law.level = law.adaptation.level * (1.0 + law.trim.share)
    else:
        law.level = law.adaptation.level
    viscous_level = law.adaptation.viscous
    coulomb = viscous = 0.0
    stands = False
    if _pressed(law, settings, pressure, step):
        before, law.coulomb_torque = law.coulomb_torque, coulomb_torque(model, pressure)
        viscous = viscous_torque(model, pressure, speed, sample.temperature)
        if settings.alone and (law.motion.crosses or abs(speed) <= settings.motion.standing_speed):
            applied = (sample.motor_torque - (law.level + viscous_level) * viscous) / law.level
            law.m = held_state(model, law.m, before, law.coulomb_torque, applied, step)
            stands = abs(law.m) < 1.0
        else:
            law.m = friction_state(model, law.m, pressure, speed, step)
        coulomb = law.coulomb_torque * law.m  # eq. 6.9
    else:
        law.m = law.coulomb_torque = 0.0  # out of contact there is no torque
    law.estimate = law.level * (coulomb + viscous) + viscous_level * viscous
    stuck = sample.motor_stuck > settings.adaptation.stuck_time
    _learn(law, settings, phase, coulomb, viscous, sample, step, stuck)
    if not law.pressed or stuck:
        forget(law.trim)
    off, level = mismatch(law), law.adaptation.level
    low, high = settings.adaptation.level_low / level - 1.0, settings.adaptation.level_high / level - 1.0
    sees = learns and law.pressed and not stands and not stuck
    trim(law.trim, settings.trim, law.observed - off, off, speed_demand, sees, low, high, step)
    return coulomb, viscous


@njit
def _pressed(law, settings, pressure, step):
    """Whether the plates rub. At the end of the fill the pressure tells of contact before the piston has arrived: it moves, and
    its damping takes a part. It has arrived when the pressure is clearly above contact or the motor feels a torque."""
    law.touched = law.touched + step if law.contact else 0.0
    arrived = (
        pressure >= settings.model.contact_pressure + settings.touch_band
        or abs(law.observed) >= settings.touch_torque
        or law.touched >= settings.touch_time
    )
    law.pressed = law.contact and (law.pressed or arrived)
    return law.pressed


@njit
def _learn(law, settings, phase, coulomb, viscous, sample, step, stuck):
    """Compare both sides of the torque balance behind the same lag, and let the adaptation learn from it."""
    if step > 0.0:
        # The observer's second difference is centred on the sample before (lag.py).
        q = exp(-settings.bandwidth * step)
        lagged(law.coulomb, law.coulomb_before, q)
        lagged(law.viscous, law.viscous_before, q)
        motor = lagged(law.motor, law.motor_before, q)
        law.coulomb_before, law.viscous_before, law.motor_before = coulomb, viscous, sample.motor_torque
        law.observed = motor - settings.model.motor_inertia * sample.acceleration  # torque balance, rig.md 8
    closed = phase == Phase.SLIP_CONTROL or phase == Phase.LOCK
    sliding = settings.adapts and closed and law.contact and not stuck
    adapt(
        law.adaptation, settings.adaptation, law.coulomb.out, law.viscous.out, law.observed, sample.slip,
        sample.acceleration, sample.temperature, step, sliding,
    )  # fmt: skip
