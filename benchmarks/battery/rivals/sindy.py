"""Sparse regression of the residuals on terms that stand for the effects of the catalogue, by pysindy.

Method          discrepancy SINDy: residuals (all outputs stacked, in floors) = sum of coefficients times terms, by sequentially
                thresholded ridge regression (STLSQ) over a path of thresholds. The effect whose terms survive the
                largest threshold is named. A term is what the effect changes in the outputs, to first order by the equations of
                the baseline. A ripple has sine and cosine of each order
References      Brunton, Proctor and Kutz 2016, PNAS 113; Kaheman et al. 2019, arXiv:1909.08574 (discrepancy models);
                de Silva et al. 2020, JOSS 5(49) (pysindy)
"""

from collections.abc import Iterator

import numpy as np
from scipy.signal import lfilter

from benchmarks.battery.rivals.residuals import OUTPUTS, PERIOD, ResidualData

PRESSURE, TORQUE, MOTOR, CELSIUS = (
    OUTPUTS.index(name) for name in ("cylinder_pressure_bar", "clutch_torque_nm", "motor_torque_nm", "oil_temperature_degc")
)  # fmt: skip
TOUCH_PRESSURE, TORQUE_PER_BAR = 2.35, 10.8  # bar, Nm/bar: docs/rig.md, eq. 3 and 5
ORDERS = range(1, 31)  # periods per turn; chosen: above any of the catalogue's ripples
_STRIDE = 3  # samples of 4 ms: one each 12 ms is used; chosen: to save time
_PATH = np.geomspace(1e-3, 1.0, 40)  # thresholds, of the largest standardised coefficient; chosen: steps of 19 %
_RIDGE = 1e-3  # weight of the squared coefficients, relative to the power of a column; chosen: it only separates equal columns

Part = dict[int, np.ndarray]  # change by a term, (runs, n) by index of the output


def rank_effects(data: ResidualData) -> list[tuple[str, float]]:
    """Rank effects by the largest threshold that one of their terms survives.

    Returns pairs of name and share of the excess power that the terms of the effect explain alone.
    """
    names, columns = [], []
    for name, part in generate_terms(data):
        column = np.zeros_like(data.residuals)
        for output, values in part.items():
            column[:, output] = values
        names.append(name)
        columns.append(column[:, :, ::_STRIDE].ravel())
    matrix = np.column_stack(columns)
    target = data.residuals[:, :, ::_STRIDE].ravel()
    size = np.sqrt(np.mean(matrix**2, axis=0))
    kept = size > 1e-12
    matrix, names = matrix[:, kept] / size[kept], [n for n, ok in zip(names, kept, strict=True) if ok]
    count, power = len(target), float(target @ target)
    q, matrix = np.linalg.qr(matrix)  # an equal least-squares problem with as many rows as terms
    target = q.T @ target
    last_step = dict.fromkeys(names, -1)
    scale = float(np.max(np.abs(matrix.T @ target)) / count)
    for step, threshold in enumerate(_PATH * max(scale, 1e-9)):
        for name, c in zip(names, _fit_sparse(matrix, target, threshold, count), strict=True):
            if c != 0.0:
                last_step[name] = step
    share = {
        name: _compute_explained_power(matrix[:, [n == name for n in names]], target) / power for name in last_step
    }
    return [(n, share[n]) for n in sorted(last_step, key=lambda n: (-last_step[n], -share[n]))]


def _fit_sparse(matrix: np.ndarray, target: np.ndarray, threshold: float, count: int) -> np.ndarray:
    import warnings

    import pysindy

    scale = 1.0 / np.sqrt(count)  # the ridge is then a share of each column's power
    optimiser = pysindy.STLSQ(threshold=threshold, alpha=_RIDGE, max_iter=10)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "all coefficients eliminated": the end of the path
        coefficients: np.ndarray = optimiser.fit(matrix * scale, target[:, None] * scale).coef_[0]
    return coefficients


def _compute_explained_power(columns: np.ndarray, target: np.ndarray) -> float:
    fitted = columns @ np.linalg.lstsq(columns, target, rcond=1e-8)[0]
    return float(fitted @ fitted)


def generate_terms(data: ResidualData) -> Iterator[tuple[str, Part]]:
    """Yield the name of the effect and the change in the outputs, for each term."""
    p, torque, motor = (
        data.select_output("cylinder_pressure_bar"),
        data.select_output("clutch_torque_nm"),
        data.select_output("motor_torque_nm"),
    )
    slip, celsius, volts = (
        data.select_output("slip_speed_rad_s"),
        data.select_output("oil_temperature_degc"),
        data.select_input("valve_voltage_v"),
    )
    angle = data.select_input("shaft_angle_rad")
    rising, twisting = _compute_rate(p), _compute_rate(torque)
    touching = p > TOUCH_PRESSURE
    forth, rise = np.tanh(slip / 0.1), np.tanh(rising / 0.5)
    gain = np.where(touching, TORQUE_PER_BAR, 0.0) * forth
    one = np.ones_like(p)

    def change_pressure(a: np.ndarray) -> Part:
        return {PRESSURE: a, TORQUE: gain * a, MOTOR: gain * a}

    def change_thrust(a: np.ndarray) -> Part:
        return {TORQUE: gain * a, MOTOR: gain * a}

    def change_friction(a: np.ndarray) -> Part:
        return {TORQUE: a, MOTOR: a}

    since = _measure_time_since_touch(touching)
    yield "valve_deadband", change_pressure(-np.tanh(volts / 0.05))
    yield "valve_hysteresis", change_pressure(-_find_play_position(p, 0.1))
    yield "spool_stiction", change_pressure(-rise * (np.abs(rising) < 2.0))
    yield "valve_delay", change_pressure(-rising)
    yield "slower_valve", change_pressure(_compute_rate(rising))
    yield "valve_gain", change_pressure(p)
    yield "supply_sag", change_pressure(-np.maximum(rising, 0.0))
    yield "entrapped_air", change_pressure(-rising / (1.0 + p) ** 2)
    yield "internal_leakage", change_pressure(-p * (p > 0.1))
    yield "centrifugal_pressure", change_thrust(slip**2)
    yield "piston_seal_friction", change_thrust(-_find_play_position(p, 0.05))
    yield "clearance_change", change_pressure(-np.exp(-((p - TOUCH_PRESSURE) ** 2) / 0.02) * (rising > 0.0))
    yield "return_spring_change", change_thrust(one)
    yield "plate_waviness", change_thrust(np.exp(-np.abs(p - TOUCH_PRESSURE) / 0.15))
    yield "coulomb_temperature", change_friction(torque * (celsius - 70.0))
    yield "friction_level", change_friction(torque)
    yield "load_dependent_friction", change_friction(-torque * np.exp(-np.maximum(p - TOUCH_PRESSURE, 0.0)))
    yield "friction_fade", change_friction(-torque * _filter_low_pass(np.abs(torque * slip), 4.0))
    yield "stribeck_change", change_friction(-torque * np.exp(-11.52 / np.maximum(np.abs(slip), 0.1)))
    yield "friction_lag", change_friction(-twisting)
    yield "squeeze_film", change_friction(-torque * np.exp(-since / 0.2))
    yield "drag_torque", change_friction(slip * ~touching)
    yield "direction_asymmetry", change_friction(np.abs(torque))
    yield "presliding", change_friction(-torque * np.exp(-np.abs(slip) / 0.5))
    yield "shaft_compliance", {MOTOR: _compute_rate(twisting)}
    yield "backlash", {MOTOR: np.abs(_compute_rate(np.tanh(torque)))}
    yield "pressure_sensor_gain", {PRESSURE: p}
    yield "pressure_sensor_offset", {PRESSURE: one}
    yield "torque_sensor_gain", {TORQUE: torque}
    yield "torque_sensor_offset", {TORQUE: one}
    yield "torque_sensor_leakage", {TORQUE: -_filter_low_pass(torque, 10.0)}
    yield "torque_time_offset", {TORQUE: -twisting}
    yield "pressure_time_offset", {PRESSURE: -rising}
    yield "temperature_sensor_lag", {CELSIUS: -_compute_rate(celsius)}
    yield "sensor_saturation", {PRESSURE: -np.maximum(p - 3.3, 0.0)}
    yield "sensor_saturation", {TORQUE: -np.sign(torque) * np.maximum(np.abs(torque) - 16.5, 0.0)}
    for step in (0.05, 0.1, 0.2, 0.4):
        yield "coarse_quantisation", {PRESSURE: step * np.round(p / step) - p}
        yield "coarse_quantisation", {TORQUE: 5.0 * step * np.round(torque / (5.0 * step)) - torque}
    for order in ORDERS:
        for wave in (np.cos(order * angle), np.sin(order * angle)):
            yield "motor_torque_ripple", {MOTOR: motor * wave}
            if order <= 12:
                yield "shaft_angle_ripple", change_friction(torque * wave)
                yield "position_ripple", change_friction(wave)


def _compute_rate(values: np.ndarray) -> np.ndarray:
    return np.gradient(values, PERIOD, axis=-1)


def _filter_low_pass(values: np.ndarray, seconds: float) -> np.ndarray:
    share = 1.0 - np.exp(-PERIOD / seconds)
    filtered: np.ndarray = lfilter([share], [1.0, share - 1.0], values, axis=-1)
    return filtered


def _find_play_position(values: np.ndarray, half: float) -> np.ndarray:
    """Find the position [-] of `values` within a play of width 2 `half`, -1..1."""
    follower = values[:, 0].copy()
    positions = np.empty_like(values)
    for k in range(values.shape[1]):
        follower = np.minimum(np.maximum(follower, values[:, k] - half), values[:, k] + half)
        positions[:, k] = (values[:, k] - follower) / half
    return positions


def _measure_time_since_touch(touching: np.ndarray) -> np.ndarray:
    """Measure the time [s] since contact; 1000 s while the clutch is open."""
    n = np.arange(touching.shape[1])
    opened = np.maximum.accumulate(np.where(touching, -1, n), axis=1)
    return np.where(touching, (n - opened) * PERIOD, 1e3)
