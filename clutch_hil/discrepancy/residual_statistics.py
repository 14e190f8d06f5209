"""Statistics of the residuals, output by output. `report.json` has them under "atlas".

floor           rms over floor; for each source (sources.py): share of the mean square, root mean power over floor
autocorrelation time after which the correlated part has decayed to 1/e
coherence       with each input: the maximum, and its frequency. In 5 runs of 24 s chance gives up to 0.2
orders          of residuals over the shaft's angle, in periods per turn: the largest amplitude, and its order
loop            mean torque with rising pressure minus mean torque with falling pressure: measured and simulated
cross           correlation of the residuals of two outputs
Runs of several rates: autocorrelation and coherence are those of the runs at the rate of most of the time
"""

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from scipy.signal import coherence

from clutch_hil.discrepancy.regimes import Regimes
from clutch_hil.discrepancy.sources import PRESSURE, TORQUE, average, compute_step, find_sources, select_usual
from clutch_hil.fitting.model import Columns, Model, Values

_SEGMENT = 512  # means: 2 s at 1 kHz, about 60 segments in 5 runs of 24 s
_LEAST_CORRELATION = 0.05  # smaller correlations are left out
_ANGLE = "shaft_angle_rad"
_ORDERS = np.arange(0.5, 60.01, 0.5)  # periods per turn
_BINS = 12  # pressure bins of a loop
_LEAST_IN_BIN = 25  # least number of means in a bin


def compute_statistics(
    model: Model, runs: Sequence[Columns], floors: Values, parameters: Values, effects: Values
) -> dict[str, Any]:
    """Return statistics of `model` at `parameters` with `effects`, as JSON: peaks only, no arrays; units as in the names."""
    shown = [model.simulate(run, parameters, effects) for run in runs]
    residuals = {
        o.column: [average(run[o.column] - s[o.column], run) for run, s in zip(runs, shown, strict=True)]
        for o in model.outputs
    }
    steps = [compute_step(run) for run in runs]
    alike = select_usual(steps, [len(run["time_s"]) for run in runs])
    step, usual = steps[alike[0]], [runs[k] for k in alike]
    outputs: dict[str, Any] = {}
    for output in model.outputs:
        parts = residuals[output.column]
        own = [parts[k] for k in alike]
        raw = np.concatenate([run[output.column] - s[output.column] for run, s in zip(runs, shown, strict=True)])
        outputs[output.column] = {
            "rms_times_floor": _round_digits(np.sqrt(np.mean(raw**2)) / floors[output.column]),
            "autocorrelation_s": _find_correlation_time(own, step),
            "coherence": {name: _find_coherence(own, usual, name, step) for name in model.inputs},
        }
        if all(_ANGLE in run for run in runs):
            order, amplitude = _find_order(parts, runs)
            outputs[output.column]["order"] = {"a_turn": order, "amplitude": amplitude, "unit": output.unit}
    statistics: dict[str, Any] = {"outputs": outputs, "cross": _correlate_channels(residuals)}
    by_block: dict[str, float] = {}
    for source in find_sources(model, runs, floors, parameters, effects):
        size = np.sqrt(max(float(np.mean(np.concatenate(source.power))), 0.0)) / floors[source.column]
        name = f"{source.block}: {source.column}"
        by_block[name] = max(by_block.get(name, 0.0), _round_digits(size))
    statistics["blocks_times_floor"] = by_block
    if TORQUE in residuals and PRESSURE in runs[0]:
        regimes = Regimes(model, runs, parameters)
        masks = [regimes(run) for run in runs]
        if "direction=apply" in masks[0]:
            statistics["loop"] = {
                "measured_nm": _measure_loop(runs, runs, masks), "simulated_nm": _measure_loop(runs, shown, masks),
            }  # fmt: skip
    return statistics


def _round_digits(value: float) -> float:
    return float(f"{float(value):.4g}")


def _find_correlation_time(parts: Sequence[np.ndarray], step: float) -> float | None:
    """Return the time [s] in which the correlated part decays to 1/e; None where they are white. step [s]: between means."""
    most = min(max(map(len, parts)) // 2, 2000)
    total = np.zeros(most)
    for part in parts:
        x = part - part.mean()
        spectrum = np.fft.rfft(x, 2 * len(x))
        count = min(most, len(x))  # a short run has no larger lags
        total[:count] += np.fft.irfft(np.abs(spectrum) ** 2)[:count]
    if total[1] <= 0.02 * total[0]:  # white noise contributes to lag 0 only
        return None
    below = np.flatnonzero(total[1:] < total[1] / np.e)
    return _round_digits(step * (1 + int(below[0]) if len(below) else most))


def _find_coherence(parts: Sequence[np.ndarray], runs: Sequence[Columns], name: str, step: float) -> dict[str, float]:
    inputs = np.concatenate([average(run[name] - run[name].mean(), run) for run in runs])
    left = np.concatenate(parts)
    if not (float(np.ptp(inputs)) > 0.0 and float(np.ptp(left)) > 0.0):
        return {"largest": 0.0, "hz": 0.0}
    segment = min(_SEGMENT, len(inputs) // 4)
    hertz, size = coherence(inputs, left, 1.0 / step, nperseg=segment)
    best = 1 + int(np.argmax(size[1:]))
    return {"largest": _round_digits(size[best]), "hz": _round_digits(hertz[best])}


def _find_order(parts: Sequence[np.ndarray], runs: Sequence[Columns]) -> tuple[float, float]:
    """Return the order with the largest amplitude, and that amplitude, over all samples."""
    angles = [average(run[_ANGLE], run) for run in runs]
    count = sum(len(part) for part in parts)
    first = [np.exp(-1j * _ORDERS[0] * a) * part for a, part in zip(angles, parts, strict=True)]
    step = [np.exp(-1j * (_ORDERS[1] - _ORDERS[0]) * a) for a in angles]
    sizes = []
    for _ in _ORDERS:
        sizes.append(2.0 * sum(abs(wave.sum()) for wave in first) / count)
        first = [wave * s for wave, s in zip(first, step, strict=True)]
    best = int(np.argmax(sizes))
    return float(_ORDERS[best]), _round_digits(sizes[best])


def _correlate_channels(residuals: dict[str, list[np.ndarray]]) -> dict[str, float]:
    correlations = {}
    for one, other in combinations(residuals, 2):
        a, b = (np.concatenate([part - part.mean() for part in residuals[c]]) for c in (one, other))
        size = float(a @ b) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-300)
        if abs(size) >= _LEAST_CORRELATION:
            correlations[f"{one}, {other}"] = _round_digits(size)
    return correlations


def _measure_loop(
    runs: Sequence[Columns], torques: Sequence[Columns], masks: Sequence[dict[str, np.ndarray]]
) -> float | None:
    """Return the mean over pressure of |torque| [Nm] at rising minus falling pressure; None without common pressures."""
    pressure = np.concatenate([run[PRESSURE] for run in runs])
    torque = np.abs(np.concatenate([t[TORQUE] for t in torques]))
    late = np.concatenate([mask["phase=slip"] for mask in masks])
    up, down = (np.concatenate([mask[f"direction={way}"] for mask in masks]) & late for way in ("apply", "release"))
    if not (up.any() and down.any()):
        return None
    edges = np.quantile(pressure[up | down], np.linspace(0.0, 1.0, _BINS + 1))
    number = np.clip(np.searchsorted(edges, pressure, side="right") - 1, 0, _BINS - 1)
    gaps = [
        float(np.mean(torque[up & (number == i)]) - np.mean(torque[down & (number == i)]))
        for i in range(_BINS)
        if min(np.sum(up & (number == i)), np.sum(down & (number == i))) >= _LEAST_IN_BIN
    ]
    return _round_digits(float(np.mean(gaps))) if gaps else None
