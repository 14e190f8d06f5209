"""Stepwise identification of the wet clutch: starting values of the joint fit, in the order of the thesis (sec. 6.3, 6.4).

Equation        1 valve gain        k_v = median p_cyl/V at rest                                          docs/rig.md, 1
                2 contact           M = a p + b at high slip: p_contact = -b/a                            Table 6.3
                3 friction curve    M = M_C s_n + C_v r_T omega^gamma, all runs at once                   eq. 6.2, 6.6
                4 oil               T(t) - T(0) = (1/C_th) int |M omega| - (h/C_th) int (T - T_sump)      docs/rig.md, 7
                5 motor             J d omega = (M_m - M) dt; d M_m = k_p de + k_i e dt                   docs/rig.md, 8
                6 hydraulics        fit of the pressure from the voltage, from several starts             docs/rig.md, 1 to 3
                7 attraction        fit of the torque from measured pressure and slip                     eq. 6.7, fig 6.14
Assumptions     1 to 5 use means over 20 ms at which pressure and slip change slowly, so that eq. 6.9 is at rest
Not modelled    noise in the measured pressure and slip; the joint fit does not need this
References      T. Janssens, PhD thesis, KU Leuven, 2010, sec. 6.3, 6.4
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from clutch_hil.fitting.model import Columns
from clutch_hil.fitting.noise import estimate_noise
from protocols.files.parameters import ParameterSet

MEAN = 0.02  # s: a friction lag of eq. 6.9 is 12 ms (docs/rig.md), one pressure loop period 100 ms
_CALM_PRESSURE = 1.5  # bar/s: the lag of 12 ms is then 0.02 bar, a thirtieth of the usual steps
_CALM_SLIP = 40.0  # rad/s^2
# Least torque of plates in contact: in standard deviations of the noise, which is 1 Nm on the shipped rig (docs/rig.md, 9); and
# as a share of the largest torque, for a recording without noise
_DEVIATIONS, _LEAST_SHARE = 20.0, 0.02
LEAST_SLIP = 0.5  # rad/s: below it plates may stick, and the torque is not a function of the slip
_LEAST_VOLTAGE = 0.2  # V: at a lower voltage the pressure is mostly noise
_NEAR_LIMIT = 0.95  # share of the motor's torque limit: above it the regulator may be limited
_SPEEDS = (5.0, 11.0, 22.0)  # rad/s: starting values of V_S, about half, once and twice that of the thesis
_EXPONENTS = (0.25, 0.5)  # starting values of gamma
_SHAPES = [5, 4, 6, 7, 8]  # indices in the fit: beta_onset, beta_inf, beta_scale, V_S, gamma
# Usual deviation from the declared shapes, as a share: it costs as much as a residual of 1 Nm in one sample
_USUAL = 0.3
_SPAN = 1.0  # s, span of the temperature differences: the noise is 0.1 K


@dataclass(frozen=True)
class Samples:
    """Means over about MEAN of all runs together, (n,) each.

    voltage [V], pressure [bar], slip [rad/s], torque, motor [Nm], temperature [degC], error of the speed [rad/s], rates of
    pressure [bar/s] and slip [rad/s^2]. last: mask of the last mean of each run. seconds [s]: length of each mean, a whole
    number of rows. contact_torque [Nm]: see `estimate_contact_torque`.
    """

    contact_torque: float
    voltage: np.ndarray
    pressure: np.ndarray
    slip: np.ndarray
    torque: np.ndarray
    motor: np.ndarray
    temperature: np.ndarray
    error: np.ndarray
    pressure_rate: np.ndarray
    slip_rate: np.ndarray
    last: np.ndarray
    seconds: np.ndarray

    @property
    def calm(self) -> np.ndarray:
        """Mask (n,) of samples at which pressure and slip change slowly."""
        return (np.abs(self.pressure_rate) < _CALM_PRESSURE) & (np.abs(self.slip_rate) < _CALM_SLIP)

    @property
    def loaded(self) -> np.ndarray:
        """Mask (n,) of samples at which the plates transmit torque."""
        return np.abs(self.torque) > self.contact_torque

    @property
    def slipping(self) -> np.ndarray:
        """Mask (n,) of loaded samples with sliding plates."""
        return self.loaded & (np.abs(self.slip) > LEAST_SLIP)

    @property
    def sliding(self) -> np.ndarray:
        """Mask (n,) of calm samples with sliding plates, whose torque has the sign of the slip."""
        return self.calm & self.slipping & (self.torque * self.slip > 0.0)

    @property
    def faster(self) -> np.ndarray:
        """Mask (n,) of the half of `sliding` with the higher slips."""
        at = self.sliding
        return at & (np.abs(self.slip) >= np.median(np.abs(self.slip[at]))) if at.any() else at


def take_samples(runs: Sequence[Columns]) -> Samples:
    """Return means over MEAN of all runs."""
    columns: list[list[np.ndarray]] = [[] for _ in range(11)]
    for run in runs:
        period = float(run["time_s"][1] - run["time_s"][0])
        block = max(1, round(MEAN / period))
        count = len(run["time_s"]) // block

        def average(values: np.ndarray, count: int = count, block: int = block) -> np.ndarray:
            return values[: count * block].reshape(count, block).mean(axis=1)

        error = run["motor_speed_demand_rad_s"] - run["slip_speed_rad_s"]
        names = (
            "valve_voltage_v", "cylinder_pressure_bar", "slip_speed_rad_s", "clutch_torque_nm", "motor_torque_nm",
            "oil_temperature_degc",
        )  # fmt: skip
        means = [*(average(run[name]) for name in names), average(error)]
        rates = [np.gradient(means[k], block * period) if count > 1 else np.zeros(count) for k in (1, 2)]
        last = np.arange(count) == count - 1
        for values, more in zip(columns, [*means, *rates, last, np.full(count, block * period)], strict=True):
            values.append(more)
    return Samples(estimate_contact_torque(runs), *map(np.concatenate, columns))


def estimate_contact_torque(runs: Sequence[Columns]) -> float:
    """Estimate the torque [Nm] above which the plates transmit torque, from the noise and the largest values of the channel."""
    torques = [run["clutch_torque_nm"] for run in runs]
    noise = float(np.median([estimate_noise(torque) for torque in torques]))
    return max(_DEVIATIONS * noise, _LEAST_SHARE * max(float(np.quantile(np.abs(t), 0.999)) for t in torques))


def estimate_valve_gain(s: Samples) -> float | None:
    """Estimate k_v [bar/V], the ratio of pressure to voltage where both are at rest; None where they never are."""
    rests = s.calm & (s.voltage > _LEAST_VOLTAGE) & np.append(np.abs(np.diff(s.voltage)) < 0.02 * s.voltage[1:], False)
    return float(np.median(s.pressure[rests] / s.voltage[rests])) if np.count_nonzero(rests) > 5 else None


def estimate_contact(s: Samples) -> tuple[float, float] | None:
    """Fit M = a_M (p - p_contact) to the faster half of the slips (Table 6.3). Return a_M [Nm/bar] and p_contact [bar].

    Returns None where there are too few sliding samples, or the line does not cross 0 at a positive pressure.
    """
    at = s.faster
    if np.count_nonzero(s.sliding) < 10 or np.ptp(s.pressure[at]) < 0.1:
        return None
    pressure, torque = s.pressure[at], np.abs(s.torque[at])
    slope, offset = np.polyfit(pressure, torque, 1)
    for _ in range(5):  # iteratively re-weighted (Huber): samples far from the line count less
        off = np.abs(torque - slope * pressure - offset)
        weight = 1.0 / np.maximum(1.0, off / (1.5 * max(float(np.median(off)), 1e-6)))
        slope, offset = np.polyfit(pressure, torque, 1, w=np.sqrt(weight))
    return (float(slope), float(-offset / slope)) if slope > 0.0 > offset else None


def estimate_friction(s: Samples, line: tuple[float, float], p: ParameterSet) -> dict[str, float]:
    """Fit the stationary friction curve (eq. 6.2, 6.6) to the sliding samples above 1 rad/s. Return parameters by dotted name.

    line: a_M [Nm/bar] and p_contact [bar], see `estimate_contact`.
    """
    at = s.sliding & (np.abs(s.slip) > 2.0 * LEAST_SLIP)
    pressure, slip, torque = s.pressure[at], np.abs(s.slip[at]), np.abs(s.torque[at])
    above = s.temperature[at] - p["oil.origin"].value
    reference = p["oil.reference"].value - p["oil.origin"].value
    mu = (p["oil.slope"].value * np.log10(np.maximum(np.stack([above, np.full_like(above, reference)]), 1.0))
          + p["oil.offset"].value)  # eq. 6.3  # fmt: skip
    warmth = mu[0] / mu[1] - 1.0
    slope, contact = line
    nominal = {name.partition(".")[2]: q.value for name, q in p.items() if name.startswith("clutch.")}
    onset, share = nominal["beta_onset"] - p["piston.contact_pressure"].value, nominal["coulomb_slope"]
    share /= share + nominal["viscous_slope"] * 20.94 ** nominal["viscous_exponent"]

    def compute_torque(x: np.ndarray) -> np.ndarray:
        a_c, p_c, a_v, p_v, inf, start, scale, speed, exponent, gain = x
        beta = np.minimum(1.0, inf + (1.0 - inf) * np.exp(np.minimum(-(pressure - start) / scale, 50.0)))  # eq. 6.6
        stribeck = a_c * np.maximum(pressure - p_c, 0.0) * (1.0 + (beta - 1.0) * np.exp(-speed / slip))
        viscous = a_v * np.maximum(pressure - p_v, 0.0) * (1.0 + gain * warmth) * slip**exponent  # eq. 6.2
        return np.asarray(stribeck + viscous)

    bounds = [p[f"clutch.{n}"].bounds for n in ("beta_inf", "beta_scale", "stribeck_speed", "viscous_exponent")]
    low = np.array(
        [0.1 * slope, 0.7 * contact, 0.0, 0.7 * contact, bounds[0][0], contact, 0.02, 2.0, bounds[3][0], 0.0]
    )
    high = np.array(
        [3.0 * slope, 1.15 * contact, slope, 1.2 * contact, 1.0, contact + 3.0 * onset, 1.0, 40.0, bounds[3][1], 10.0]
    )
    # prior: without it the best curve may have beta or V_S at a bound, where the other shape parameters have no effect
    shapes = [nominal[name] for name in ("beta_inf", "beta_scale", "stribeck_speed", "viscous_exponent")]
    usual, away = np.array([contact + onset, *shapes]), _USUAL * np.array([onset, *shapes])
    tried = []
    for speed in _SPEEDS:
        for exponent in _EXPONENTS:
            begin = np.array([
                share * slope, contact, (1.0 - share) * slope / 20.94**exponent, contact, nominal["beta_inf"],
                contact + onset, nominal["beta_scale"], speed, exponent, p["oil.viscous_gain"].value,
            ])  # fmt: skip
            begin = np.clip(begin, low + 1e-3 * (high - low), high - 1e-3 * (high - low))
            tried.append(least_squares(
                lambda x: np.append(compute_torque(x) - torque, (x[_SHAPES] - usual) / away), begin,
                bounds=(low, high), loss="soft_l1", f_scale=0.1, x_scale=np.maximum(np.abs(begin), 0.1), max_nfev=60,
            ))  # fmt: skip
    best = min(tried, key=lambda one: one.cost)
    a_c, p_c, a_v, p_v, inf, start, scale, speed, exponent, gain = best.x
    estimates = {
        "coulomb_slope": a_c, "coulomb_intercept": -a_c * p_c, "viscous_slope": a_v, "viscous_intercept": -a_v * p_v,
        "beta_inf": inf, "beta_onset": start, "beta_scale": scale, "stribeck_speed": speed, "viscous_exponent": exponent,
    }  # fmt: skip
    return {**{f"clutch.{name}": float(value) for name, value in estimates.items()}, "oil.viscous_gain": float(gain)}


def estimate_oil(s: Samples) -> dict[str, float] | None:
    """Estimate heat capacity [J/K], heat transfer [W/K] and sump temperature [degC]; None where the temperature hardly
    changes."""
    time, power, warm = (
        np.concatenate([[0.0], np.cumsum(values * s.seconds)])
        for values in (np.ones_like(s.slip), np.abs(s.torque * s.slip), s.temperature)
    )
    begin, last = np.arange(len(s.slip)), np.flatnonzero(s.last)
    end = begin + np.maximum(1, np.round(_SPAN / s.seconds).astype(int))
    inside = end <= last[np.searchsorted(last, begin)]  # both in one run
    if np.count_nonzero(inside) < 5:
        return None
    begin, end = begin[inside], end[inside]
    rise = s.temperature[end] - s.temperature[begin]
    terms = np.column_stack([power[end] - power[begin], -(warm[end] - warm[begin]), time[end] - time[begin]])
    (a, b, c), *_ = np.linalg.lstsq(terms, rise, rcond=None)
    if not (a > 0.0 and b > 0.0):
        return None
    return {"oil.heat_capacity": 1.0 / a, "oil.heat_transfer": b / a, "oil.sump_temperature": c / b}


def estimate_motor(s: Samples, limit: float) -> dict[str, float]:
    """Estimate the inertia [kg m^2] and the speed regulator's gains [Nm s/rad, Nm/rad], as far as possible. limit: torque
    [Nm]."""
    k = np.flatnonzero(~s.last[:-1])
    estimates: dict[str, float] = {}
    balance = 0.5 * ((s.motor - s.torque)[k] + (s.motor - s.torque)[k + 1]) * s.seconds[k]
    change = s.slip[k + 1] - s.slip[k]
    fast = np.abs(change) > 0.2
    if (
        np.count_nonzero(fast) > 5
        and (inertia := float(balance[fast] @ change[fast] / (change[fast] @ change[fast]))) > 0.0
    ):
        estimates["motor.inertia"] = inertia
    free = (np.abs(s.motor[k]) < _NEAR_LIMIT * limit) & (np.abs(s.motor[k + 1]) < _NEAR_LIMIT * limit)
    terms = np.column_stack([s.error[k + 1] - s.error[k], 0.5 * (s.error[k] + s.error[k + 1]) * s.seconds[k]])[free]
    if len(terms) > 5:
        (proportional, integral), *_ = np.linalg.lstsq(terms, (s.motor[k + 1] - s.motor[k])[free], rcond=None)
        for name, value in (("motor.proportional_gain", proportional), ("motor.integral_gain", integral)):
            if value > 0.0:
                estimates[name] = float(value)
    return estimates
