"""Features of residuals for a classifier: size, mean, slope on signals, spectrum, by output and regime; (k,) a case."""

from itertools import pairwise

import numpy as np
from scipy.signal import welch

from benchmarks.battery.rivals.prepared import PERIOD, Prepared

TOUCH = 2.35  # bar
_BANDS = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 126.0])  # Hz
_ORDERS = np.arange(1, 31)
_LAGS = (1, 3, 10, 30, 100)  # of 4 ms


def features(made: Prepared) -> np.ndarray:
    """Features of a case."""
    p, slip, celsius = (made.output(n) for n in ("cylinder_pressure_bar", "slip_speed_rad_s", "oil_temperature_degc"))
    torque, volts, angle = made.output("clutch_torque_nm"), made.input("valve_voltage_v"), made.input("shaft_angle_rad")
    rising = np.gradient(p, PERIOD, axis=-1)
    touching = p > TOUCH
    signals = np.array([p, rising, slip, np.abs(slip), np.sign(slip), celsius, torque, np.abs(torque),
                        np.gradient(torque, PERIOD, axis=-1), volts, np.tanh(rising),
                        np.cumsum(np.abs(torque * slip), axis=-1)])  # fmt: skip
    regimes = [
        ~touching & (volts <= 0.0), ~touching & (volts > 0.0), touching & (np.abs(rising) <= 0.2), touching & (rising > 0.2),
        touching & (rising < -0.2), touching & (slip > 1.0), touching & (slip < -1.0), touching & (np.abs(slip) <= 1.0),
        touching & (p < 3.0), touching & (p > 3.7), touching & (np.abs(slip) > 15.0), celsius > np.median(celsius),
    ]  # fmt: skip
    found: list[float] = [np.log10(made.excess + 1e-4)]
    for i in range(made.residuals.shape[1]):
        r = made.residuals[:, i]
        rms = float(np.sqrt(np.mean(r**2)))
        found += [np.log10(rms + 1e-3), float(np.mean(r)), _skew(r), _kurtosis(r)]
        for regime in regimes:
            part = r[regime]
            found += [float(np.sqrt(np.mean(part**2))) / rms, float(np.mean(part)) / rms] if part.size else [0.0, 0.0]
        found += [_correlation(r, s, np.ones_like(touching)) for s in signals]
        found += [_correlation(r, s, touching) for s in signals]
        found += [float(np.mean(r[:, lag:] * r[:, :-lag])) / rms**2 for lag in _LAGS]
        frequency, power = welch(r, 1.0 / PERIOD, nperseg=1024, axis=-1)
        power = power.mean(axis=0)
        bands = [power[(frequency >= a) & (frequency < b)].sum() for a, b in pairwise(_BANDS.tolist())]
        found += [float(np.log10(b / power.sum() + 1e-6)) for b in bands]
        found += _order_lines(r, angle) + _order_lines(r / np.maximum(np.abs(torque), 2.0), angle)
    for i in range(made.residuals.shape[1]):
        found += [_correlation(made.residuals[:, i], made.residuals[:, j], np.ones_like(touching)) for j in range(i)]
    return np.nan_to_num(np.array(found, float))


def _correlation(a: np.ndarray, b: np.ndarray, mask: np.ndarray) -> float:
    x, y = a[mask.astype(bool)], b[mask.astype(bool)]
    if x.size < 10:
        return 0.0
    x, y = x - x.mean(), y - y.mean()
    return float(x @ y / np.sqrt((x @ x) * (y @ y) + 1e-12))


def _order_lines(r: np.ndarray, angle: np.ndarray) -> list[float]:
    waves = np.exp(-1j * _ORDERS[:, None, None] * angle)
    lines = np.abs(np.mean(waves * r, axis=(1, 2))) / (np.sqrt(np.mean(r**2)) + 1e-12)
    return [float(lines.max()), float(_ORDERS[lines.argmax()])]


def _skew(r: np.ndarray) -> float:
    d = r - r.mean()
    return float(np.mean(d**3) / (np.mean(d**2) ** 1.5 + 1e-12))


def _kurtosis(r: np.ndarray) -> float:
    d = r - r.mean()
    return float(np.log10(np.mean(d**4) / (np.mean(d**2) ** 2 + 1e-12)))
