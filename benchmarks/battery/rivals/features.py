"""Features of residuals for a classifier: size, mean, correlation with signals, and spectrum, by output and regime."""

from itertools import pairwise

import numpy as np
from scipy.signal import welch

from benchmarks.battery.rivals.residuals import PERIOD, ResidualData

TOUCH_PRESSURE = 2.35  # bar, contact of the plates: Janssens 2010, Table 6.3
# Hz, edges; chosen: octaves up to half the rate
_BANDS = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 126.0])
_ORDERS = np.arange(1, 31)  # periods per turn; chosen: above any of the catalogue's ripples
_LAGS = (1, 3, 10, 30, 100)  # samples of 4 ms, of the autocorrelation; chosen: half decades


def compute_features(data: ResidualData) -> np.ndarray:
    """Compute the features of a case (k,)."""
    p, slip, celsius = (
        data.select_output(n) for n in ("cylinder_pressure_bar", "slip_speed_rad_s", "oil_temperature_degc")
    )
    torque, volts, angle = (
        data.select_output("clutch_torque_nm"),
        data.select_input("valve_voltage_v"),
        data.select_input("shaft_angle_rad"),
    )
    rising = np.gradient(p, PERIOD, axis=-1)
    touching = p > TOUCH_PRESSURE
    signals = np.array([p, rising, slip, np.abs(slip), np.sign(slip), celsius, torque, np.abs(torque),
                        np.gradient(torque, PERIOD, axis=-1), volts, np.tanh(rising),
                        np.cumsum(np.abs(torque * slip), axis=-1)])  # fmt: skip
    regimes = [
        ~touching & (volts <= 0.0), ~touching & (volts > 0.0), touching & (np.abs(rising) <= 0.2), touching & (rising > 0.2),
        touching & (rising < -0.2), touching & (slip > 1.0), touching & (slip < -1.0), touching & (np.abs(slip) <= 1.0),
        touching & (p < 3.0), touching & (p > 3.7), touching & (np.abs(slip) > 15.0), celsius > np.median(celsius),
    ]  # fmt: skip
    values: list[float] = [np.log10(data.excess + 1e-4)]
    for i in range(data.residuals.shape[1]):
        r = data.residuals[:, i]
        rms = float(np.sqrt(np.mean(r**2)))
        values += [np.log10(rms + 1e-3), float(np.mean(r)), _compute_skew(r), _compute_kurtosis(r)]
        for regime in regimes:
            part = r[regime]
            values += [float(np.sqrt(np.mean(part**2))) / rms, float(np.mean(part)) / rms] if part.size else [0.0, 0.0]
        values += [_compute_correlation(r, s, np.ones_like(touching)) for s in signals]
        values += [_compute_correlation(r, s, touching) for s in signals]
        values += [float(np.mean(r[:, lag:] * r[:, :-lag])) / rms**2 for lag in _LAGS]
        frequency, power = welch(r, 1.0 / PERIOD, nperseg=1024, axis=-1)
        power = power.mean(axis=0)
        bands = [power[(frequency >= a) & (frequency < b)].sum() for a, b in pairwise(_BANDS.tolist())]
        values += [float(np.log10(b / power.sum() + 1e-6)) for b in bands]
        values += _compute_order_lines(r, angle) + _compute_order_lines(r / np.maximum(np.abs(torque), 2.0), angle)
    for i in range(data.residuals.shape[1]):
        values += [
            _compute_correlation(data.residuals[:, i], data.residuals[:, j], np.ones_like(touching)) for j in range(i)
        ]
    return np.nan_to_num(np.array(values, float))


def _compute_correlation(a: np.ndarray, b: np.ndarray, mask: np.ndarray) -> float:
    x, y = a[mask.astype(bool)], b[mask.astype(bool)]
    if x.size < 10:
        return 0.0
    x, y = x - x.mean(), y - y.mean()
    return float(x @ y / np.sqrt((x @ x) * (y @ y) + 1e-12))


def _compute_order_lines(r: np.ndarray, angle: np.ndarray) -> list[float]:
    waves = np.exp(-1j * _ORDERS[:, None, None] * angle)
    lines = np.abs(np.mean(waves * r, axis=(1, 2))) / (np.sqrt(np.mean(r**2)) + 1e-12)
    return [float(lines.max()), float(_ORDERS[lines.argmax()])]


def _compute_skew(r: np.ndarray) -> float:
    d = r - r.mean()
    return float(np.mean(d**3) / (np.mean(d**2) ** 1.5 + 1e-12))


def _compute_kurtosis(r: np.ndarray) -> float:
    d = r - r.mean()
    return float(np.log10(np.mean(d**4) / (np.mean(d**2) ** 2 + 1e-12)))
