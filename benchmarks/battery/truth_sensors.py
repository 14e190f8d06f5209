"""Effects in sensors and data acquisition: laws of the truth.

Laws with a memory are called once an integration step, the others once a sample. `e`, `v`: strength (0 is off) and law (0 or 1)
of each effect, by its name; `w`: memory; `h`: step [s]. Quantities are in SI units, voltages in V.
"""

from math import copysign, exp, floor

from numba import njit

from benchmarks.battery.truth_valve import lag_chain, pade_delay

BAR = 1e5  # Pa
# lags in series that stand for the filter of a channel; chosen: a filter of order 4
FILTER_STAGES = 4


@njit(error_model="numpy")
def delay_pressure(p, h, e, v, w):
    """Return the pressure [Pa] behind a delay.

    First law: four equal lags, a filter of that group delay. Second law: all-pass (Pade). The catalogue: pure delay. Strength:
    delay [s].
    """
    if e.pressure_time_offset == 0.0:
        return p
    if v.pressure_time_offset == 0.0:
        return lag_chain(p, e.pressure_time_offset, FILTER_STAGES, h, w.pressure_past)
    return pade_delay(p, e.pressure_time_offset, h, w.pressure_past)


@njit(error_model="numpy")
def delay_torque(torque, h, e, v, w):
    """Return the torque [Nm] behind a delay; laws and strength as in `delay_pressure`."""
    if e.torque_time_offset == 0.0:
        return torque
    if v.torque_time_offset == 0.0:
        return lag_chain(torque, e.torque_time_offset, FILTER_STAGES, h, w.torque_past)
    return pade_delay(torque, e.torque_time_offset, h, w.torque_past)


@njit(error_model="numpy")
def leak_torque(torque, h, e, v, w):
    """Return the torque [Nm] measured by a piezoelectric sensor with leakage.

    First law: two relaxations, 70 % at the rate and 30 % at a fifth of it (dielectric absorption, Curie-von Schweidler). Second
    law: two equal leaks in series, sensor and amplifier. The catalogue has one pole and a load by warming. Strength: rate
    [1/s].
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
def lag_temperature(kelvin, slip, h, e, v, w):
    """Return the oil temperature [K] behind the lag of its sensor.

    First law: sheath and element, two lags of 0.75 and 0.25 of the time (step response of IEC 60751). Second law: one
    lag, twice as long at rest as at 20 rad/s of slip (King 1914: heat transfer and flow). The catalogue has one lag.
    Strength: time [s].
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
def distort_pressure(p, kelvin, time, e, v):
    """Return the pressure [Pa] with gain and zero error of its sensor.

    Gain, first law: a tenth of the error is curvature. Second law: the error grows by a tenth each 10 K. Zero, first
    law: a tenth of the error drifts over 24 s. Second law: the error grows by a tenth each 10 K. The catalogue has
    constants. Strengths: relative gain error [-], zero error [Pa].
    """
    warm = 0.01 * (kelvin - 343.15)
    gain = e.pressure_sensor_gain
    gain *= 1.0 + 0.1 * (p / (3.4 * BAR) - 1.0) if v.pressure_sensor_gain == 0.0 else 1.0 + warm
    zero = e.pressure_sensor_offset
    zero *= 0.95 + 0.1 * time / 24.0 if v.pressure_sensor_offset == 0.0 else 1.0 + warm
    return p * (1.0 + gain) + zero


@njit(error_model="numpy")
def distort_torque(torque, kelvin, time, e, v):
    """Return the torque [Nm] with gain and zero error of its sensor; laws as in `distort_pressure`, curvature about 15 Nm."""
    warm = 0.01 * (kelvin - 343.15)
    gain = e.torque_sensor_gain
    gain *= 1.0 + 0.1 * (abs(torque) / 15.0 - 1.0) if v.torque_sensor_gain == 0.0 else 1.0 + warm
    zero = e.torque_sensor_offset
    zero *= 0.95 + 0.1 * time / 24.0 if v.torque_sensor_offset == 0.0 else 1.0 + warm
    return torque * (1.0 + gain) + zero


@njit(error_model="numpy")
def saturate(voltage, limit_inverse):
    """Return the voltage [V] that saturates softly: V (1 + |V/L|^12)^(-1/12), which is 6 % below L at V = L.

    The catalogue has an exponential bend.

    limit_inverse: 1/L [1/V]; 0 is off.
    """
    if limit_inverse == 0.0:
        return voltage
    over = abs(voltage) * limit_inverse
    if over > 4.0:
        return copysign(1.0 / limit_inverse, voltage)
    return voltage * (1.0 + over**12) ** (-1.0 / 12.0)


@njit(error_model="numpy")
def quantise_coarsely(voltage, step, second):
    """Return the voltage [V] on levels `step` [V] apart; 0 is off.

    First law (`second` is 0): mid-rise, no level at zero. Second law: mid-tread, every second level 0.2 steps too high
    (differential non-linearity). The catalogue: ideal mid-tread.
    """
    if step == 0.0:
        return voltage
    if second == 0.0:
        return step * (floor(voltage / step) + 0.5)
    code = floor(voltage / step + 0.5)
    return step * (code + 0.2 * (code % 2.0))


@njit(error_model="numpy")
def convert_to_levels(voltage, bits, full):
    """Return the voltage [V] on the levels of a converter of `bits` with a range of +-`full` [V]: docs/rig.md, eq. 9."""
    step = 2.0 * full / 2.0**bits
    return min(max(step * floor(voltage / step + 0.5), -full), full - step)
