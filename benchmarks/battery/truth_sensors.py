"""What may be wrong with sensors and data acquisition: laws of the truth, called once a step, static ones once a
sample.

Names as in `truth_valve`. Quantities in SI but torque shown in Nm and voltages in V.
"""

from math import copysign, exp, floor

from numba import njit

from benchmarks.battery.truth_valve import lags, pade

BAR = 1e5  # Pa
STAGES = 4  # of the channels' filters


@njit(error_model="numpy")
def pressure_behind(p, h, e, v, w):
    """Late pressure. First law: four equal lags, a filter of that group delay; second: all-pass (Pade). Catalogue: pure
    delay.

    Strength: delay [s].
    """
    if e.pressure_time_offset == 0.0:
        return p
    if v.pressure_time_offset == 0.0:
        return lags(p, e.pressure_time_offset, STAGES, h, w.pressure_past)
    return pade(p, e.pressure_time_offset, h, w.pressure_past)


@njit(error_model="numpy")
def torque_behind(torque, h, e, v, w):
    """Late torque; laws as of the late pressure."""
    if e.torque_time_offset == 0.0:
        return torque
    if v.torque_time_offset == 0.0:
        return lags(torque, e.torque_time_offset, STAGES, h, w.torque_past)
    return pade(torque, e.torque_time_offset, h, w.torque_past)


@njit(error_model="numpy")
def torque_left(torque, h, e, v, w):
    """Leaking torque sensor. First law: two relaxations, 70 % at the rate and 30 % at a fifth of it (dielectric
    absorption, Curie-von Schweidler); second: two equal leaks in series, sensor and amplifier.

    The catalogue has one pole and a load by warming. Strength: rate [1/s].
    """
    rate = e.torque_sensor_leakage
    if rate == 0.0:
        return torque
    if v.torque_sensor_leakage == 0.0:
        w.leak_fast += (1.0 - exp(-h * rate)) * (torque - w.leak_fast)
        w.leak_slow += (1.0 - exp(-h * rate / 5.0)) * (torque - w.leak_slow)
        return torque - 0.7 * w.leak_fast - 0.3 * w.leak_slow
    w.leak_fast += (1.0 - exp(-0.6 * h * rate)) * (torque - w.leak_fast)
    first = torque - w.leak_fast
    w.leak_slow += (1.0 - exp(-0.6 * h * rate)) * (first - w.leak_slow)
    return first - w.leak_slow


@njit(error_model="numpy")
def probe(kelvin, slip, h, e, v, w):
    """Temperature sensor. First law: sheath and element, two lags of 0.75 and 0.25 of the time (IEC 60751 step
    response); second: one lag, twice as long at rest as at 20 rad/s of slip (King 1914: heat transfer and flow).

    The catalogue has one lag. Strength: time [s].
    """
    time = e.temperature_sensor_lag
    if time == 0.0:
        return kelvin
    if v.temperature_sensor_lag == 0.0:
        w.sheath += (1.0 - exp(-h / (0.75 * time))) * (kelvin - w.sheath)
        w.element += (1.0 - exp(-h / (0.25 * time))) * (w.sheath - w.element)
    else:
        w.element += (1.0 - exp(-h * (0.5 + 0.5 * min(abs(slip) / 20.0, 1.5)) / time)) * (kelvin - w.element)
    return w.element


@njit(error_model="numpy")
def pressure_shown(p, kelvin, time, e, v):
    """Gain and zero error of the pressure sensor. Gain, first law: 10 % of it curvature; second: a tenth more each 10
    K. Zero, first law: 10 % of it drift over 24 s; second: a tenth more each 10 K. The catalogue: constants. Strengths:
    relative gain error; Pa.
    """
    warm = 0.01 * (kelvin - 343.15)
    gain = e.pressure_sensor_gain
    gain *= 1.0 + 0.1 * (p / (3.4 * BAR) - 1.0) if v.pressure_sensor_gain == 0.0 else 1.0 + warm
    zero = e.pressure_sensor_offset
    zero *= 0.95 + 0.1 * time / 24.0 if v.pressure_sensor_offset == 0.0 else 1.0 + warm
    return p * (1.0 + gain) + zero


@njit(error_model="numpy")
def torque_shown(torque, kelvin, time, e, v):
    """Gain and zero error of the torque sensor; laws as of the pressure sensor, about 15 Nm."""
    warm = 0.01 * (kelvin - 343.15)
    gain = e.torque_sensor_gain
    gain *= 1.0 + 0.1 * (abs(torque) / 15.0 - 1.0) if v.torque_sensor_gain == 0.0 else 1.0 + warm
    zero = e.torque_sensor_offset
    zero *= 0.95 + 0.1 * time / 24.0 if v.torque_sensor_offset == 0.0 else 1.0 + warm
    return torque * (1.0 + gain) + zero


@njit(error_model="numpy")
def bent(voltage, limit_inverse):
    """A voltage that saturates softly: V (1 + |V/L|^12)^(-1/12), 6 % below L at L. `limit_inverse` is 1/L [1/V], 0 is
    off.
    """
    if limit_inverse == 0.0:
        return voltage
    over = abs(voltage) * limit_inverse
    if over > 4.0:
        return copysign(1.0 / limit_inverse, voltage)
    return voltage * (1.0 + over**12) ** (-1.0 / 12.0)


@njit(error_model="numpy")
def coarse(voltage, step, second):
    """A voltage on levels `step` [V] apart, 0 is off. First law: mid-rise, no level at zero; second: mid-tread with
    every second level 0.2 steps high (differential non-linearity). The catalogue: ideal mid-tread.
    """
    if step == 0.0:
        return voltage
    if second == 0.0:
        return step * (floor(voltage / step) + 0.5)
    code = floor(voltage / step + 0.5)
    return step * (code + 0.2 * (code % 2.0))


@njit(error_model="numpy")
def converted(voltage, bits, full):
    """What the converter of `bits` and +-`full` [V] makes of a voltage: rig.md 9."""
    step = 2.0 * full / 2.0**bits
    return min(max(step * floor(voltage / step + 0.5), -full), full - step)
