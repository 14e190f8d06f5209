"""Sparse regression of the residuals on terms that stand for the mechanisms of the catalogue, by pysindy.

Method          discrepancy SINDy: residuals (all outputs, stacked, in floors) = sum of terms times coefficients, sequentially
                thresholded ridge regression (STLSQ) over a path of thresholds; the effect whose terms survive longest is named.
                A term is what its effect does to the outputs by the baseline's own equations to first order; a ripple has sine
                and cosine of each order
References      Brunton, Proctor and Kutz 2016, PNAS 113; Kaheman et al. 2019, arXiv:1909.08574 (discrepancy models);
                de Silva et al. 2020, JOSS 5(49) (pysindy)
"""

from collections.abc import Iterator

import numpy as np
from scipy.signal import lfilter

from benchmarks.battery.rivals.prepared import OUTPUTS, PERIOD, Prepared

PRESSURE, TORQUE, MOTOR, CELSIUS = (
    OUTPUTS.index(name) for name in ("cylinder_pressure_bar", "clutch_torque_nm", "motor_torque_nm", "oil_temperature_degc")
)  # fmt: skip
TOUCH, PER_BAR = 2.35, 10.8  # bar, Nm/bar: rig.md 3, 5
ORDERS = range(1, 31)  # a turn
_THINNED = 3  # every third mean: 12 ms
_PATH = np.geomspace(1e-3, 1.0, 40)  # thresholds, of the largest standardised coefficient
_RIDGE = 1e-3

Part = dict[int, np.ndarray]  # by output (runs, n)


def ranked(made: Prepared) -> list[tuple[str, float]]:
    """Effects, that survive longest first, each with the share of the excess power that its terms take away alone."""
    names, columns = [], []
    for name, part in terms(made):
        column = np.zeros_like(made.residuals)
        for output, values in part.items():
            column[:, output] = values
        names.append(name)
        columns.append(column[:, :, ::_THINNED].ravel())
    matrix = np.column_stack(columns)
    target = made.residuals[:, :, ::_THINNED].ravel()
    size = np.sqrt(np.mean(matrix**2, axis=0))
    kept = size > 1e-12
    matrix, names = matrix[:, kept] / size[kept], [n for n, ok in zip(names, kept, strict=True) if ok]
    count, power = len(target), float(target @ target)
    q, matrix = np.linalg.qr(matrix)  # the same least squares with as many rows as terms
    target = q.T @ target
    lasts = dict.fromkeys(names, -1)
    scale = float(np.max(np.abs(matrix.T @ target)) / count)
    for step, threshold in enumerate(_PATH * max(scale, 1e-9)):
        for name, c in zip(names, _fitted(matrix, target, threshold, count), strict=True):
            if c != 0.0:
                lasts[name] = step
    share = {name: _explained(matrix[:, [n == name for n in names]], target) / power for name in lasts}
    return [(n, share[n]) for n in sorted(lasts, key=lambda n: (-lasts[n], -share[n]))]


def _fitted(matrix: np.ndarray, target: np.ndarray, threshold: float, count: int) -> np.ndarray:
    import warnings

    import pysindy

    scale = 1.0 / np.sqrt(count)  # the ridge is then a share of each column's power
    optimiser = pysindy.STLSQ(threshold=threshold, alpha=_RIDGE, max_iter=10)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "all coefficients eliminated": the end of the path
        found: np.ndarray = optimiser.fit(matrix * scale, target[:, None] * scale).coef_[0]
    return found


def _explained(columns: np.ndarray, target: np.ndarray) -> float:
    fitted = columns @ np.linalg.lstsq(columns, target, rcond=1e-8)[0]
    return float(fitted @ fitted)


def terms(made: Prepared) -> Iterator[tuple[str, Part]]:
    """Terms by effect."""
    p, torque, motor = (
        made.output("cylinder_pressure_bar"),
        made.output("clutch_torque_nm"),
        made.output("motor_torque_nm"),
    )
    slip, celsius, volts = (
        made.output("slip_speed_rad_s"),
        made.output("oil_temperature_degc"),
        made.input("valve_voltage_v"),
    )
    angle = made.input("shaft_angle_rad")
    rising, twisting = _rate(p), _rate(torque)
    touching = p > TOUCH
    forth, rise = np.tanh(slip / 0.1), np.tanh(rising / 0.5)
    gain = np.where(touching, PER_BAR, 0.0) * forth
    one = np.ones_like(p)

    def pressed(a: np.ndarray) -> Part:
        return {PRESSURE: a, TORQUE: gain * a, MOTOR: gain * a}

    def pushed(a: np.ndarray) -> Part:
        return {TORQUE: gain * a, MOTOR: gain * a}

    def rubbed(a: np.ndarray) -> Part:
        return {TORQUE: a, MOTOR: a}

    since = _since(touching)
    yield "valve_deadband", pressed(-np.tanh(volts / 0.05))
    yield "valve_hysteresis", pressed(-_play(p, 0.1))
    yield "spool_stiction", pressed(-rise * (np.abs(rising) < 2.0))
    yield "valve_delay", pressed(-rising)
    yield "slower_valve", pressed(_rate(rising))
    yield "valve_gain", pressed(p)
    yield "supply_sag", pressed(-np.maximum(rising, 0.0))
    yield "entrapped_air", pressed(-rising / (1.0 + p) ** 2)
    yield "internal_leakage", pressed(-p * (p > 0.1))
    yield "centrifugal_pressure", pushed(slip**2)
    yield "piston_seal_friction", pushed(-_play(p, 0.05))
    yield "clearance_change", pressed(-np.exp(-((p - TOUCH) ** 2) / 0.02) * (rising > 0.0))
    yield "return_spring_change", pushed(one)
    yield "plate_waviness", pushed(np.exp(-np.abs(p - TOUCH) / 0.15))
    yield "coulomb_temperature", rubbed(torque * (celsius - 70.0))
    yield "friction_level", rubbed(torque)
    yield "load_dependent_friction", rubbed(-torque * np.exp(-np.maximum(p - TOUCH, 0.0)))
    yield "friction_fade", rubbed(-torque * _lagged(np.abs(torque * slip), 4.0))
    yield "stribeck_change", rubbed(-torque * np.exp(-11.52 / np.maximum(np.abs(slip), 0.1)))
    yield "friction_lag", rubbed(-twisting)
    yield "squeeze_film", rubbed(-torque * np.exp(-since / 0.2))
    yield "drag_torque", rubbed(slip * ~touching)
    yield "direction_asymmetry", rubbed(np.abs(torque))
    yield "presliding", rubbed(-torque * np.exp(-np.abs(slip) / 0.5))
    yield "shaft_compliance", {MOTOR: _rate(twisting)}
    yield "backlash", {MOTOR: np.abs(_rate(np.tanh(torque)))}
    yield "pressure_sensor_gain", {PRESSURE: p}
    yield "pressure_sensor_offset", {PRESSURE: one}
    yield "torque_sensor_gain", {TORQUE: torque}
    yield "torque_sensor_offset", {TORQUE: one}
    yield "torque_sensor_leakage", {TORQUE: -_lagged(torque, 10.0)}
    yield "torque_time_offset", {TORQUE: -twisting}
    yield "pressure_time_offset", {PRESSURE: -rising}
    yield "temperature_sensor_lag", {CELSIUS: -_rate(celsius)}
    yield "sensor_saturation", {PRESSURE: -np.maximum(p - 3.3, 0.0)}
    yield "sensor_saturation", {TORQUE: -np.sign(torque) * np.maximum(np.abs(torque) - 16.5, 0.0)}
    for step in (0.05, 0.1, 0.2, 0.4):
        yield "coarse_quantisation", {PRESSURE: step * np.round(p / step) - p}
        yield "coarse_quantisation", {TORQUE: 5.0 * step * np.round(torque / (5.0 * step)) - torque}
    for order in ORDERS:
        for wave in (np.cos(order * angle), np.sin(order * angle)):
            yield "motor_torque_ripple", {MOTOR: motor * wave}
            if order <= 12:
                yield "shaft_angle_ripple", rubbed(torque * wave)
                yield "position_ripple", rubbed(wave)


def _rate(values: np.ndarray) -> np.ndarray:
    return np.gradient(values, PERIOD, axis=-1)


def _lagged(values: np.ndarray, seconds: float) -> np.ndarray:
    share = 1.0 - np.exp(-PERIOD / seconds)
    found: np.ndarray = lfilter([share], [1.0, share - 1.0], values, axis=-1)
    return found


def _play(values: np.ndarray, half: float) -> np.ndarray:
    """Where `values` stand within a play of 2 `half`, -1..1."""
    behind = values[:, 0].copy()
    found = np.empty_like(values)
    for k in range(values.shape[1]):
        behind = np.minimum(np.maximum(behind, values[:, k] - half), values[:, k] + half)
        found[:, k] = (values[:, k] - behind) / half
    return found


def _since(touching: np.ndarray) -> np.ndarray:
    """Time [s] since the touch; long while open."""
    n = np.arange(touching.shape[1])
    opened = np.maximum.accumulate(np.where(touching, -1, n), axis=1)
    return np.where(touching, (n - opened) * PERIOD, 1e3)
