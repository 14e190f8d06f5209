"""Numbers of the atlas beside its claims: what a residual is like, channel by channel. `report.json` has them under "atlas".

floor           rms over floor; share of each source (sources.py) in its mean square, root over floor
autocorrelation time after which what is no noise has fallen to 1/e of itself
coherence       with each input: largest, and at which frequency; 0.2 is chance in 5 runs of 24 s
orders          of residuals over the shaft's angle: the largest, its amplitude
loop            mean torque with rising less that with falling pressure, over the pressures of the runs: measured and simulated
cross           correlation of residuals of two channels
"""

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from scipy.signal import coherence

from clutch_hil.discrepancy.model import Columns, Model, Values
from clutch_hil.discrepancy.regimes import Regimes
from clutch_hil.discrepancy.sources import MEAN, PRESSURE, TORQUE, means, sources

_SEGMENT = 512  # means of 4 ms: 2 s, some 60 segments in 5 runs of 24 s
_CROSS = 0.05  # smaller correlations are not told
_ANGLE = "shaft_angle_rad"
_ORDERS = np.arange(0.5, 60.01, 0.5)  # periods a turn
_BINS = 12  # of pressure in a loop
_IN_BIN = 25  # means that a bin needs


def atlas_numbers(
    model: Model, runs: Sequence[Columns], floors: Values, parameters: Values, effects: Values
) -> dict[str, Any]:
    """Peaks, no arrays; units as in the names."""
    shown = [model.simulate(run, parameters, effects) for run in runs]
    residuals = {
        o.column: [means(run[o.column] - s[o.column], run) for run, s in zip(runs, shown, strict=True)]
        for o in model.outputs
    }
    outputs: dict[str, Any] = {}
    for output in model.outputs:
        parts = residuals[output.column]
        raw = np.concatenate([run[output.column] - s[output.column] for run, s in zip(runs, shown, strict=True)])
        outputs[output.column] = {
            "rms_times_floor": _rounded(np.sqrt(np.mean(raw**2)) / floors[output.column]),
            "autocorrelation_s": _memory(parts),
            "coherence": {name: _coherent(parts, runs, name) for name in model.inputs},
        }
        if all(_ANGLE in run for run in runs):
            order, amplitude = _order(parts, runs)
            outputs[output.column]["order"] = {"a_turn": order, "amplitude": amplitude, "unit": output.unit}
    found: dict[str, Any] = {"outputs": outputs, "cross": _cross(residuals)}
    by_block: dict[str, float] = {}
    for source in sources(model, runs, floors, parameters, effects):
        size = np.sqrt(max(float(np.mean(np.concatenate(source.power))), 0.0)) / floors[source.column]
        name = f"{source.block}: {source.column}"
        by_block[name] = max(by_block.get(name, 0.0), _rounded(size))
    found["blocks_times_floor"] = by_block
    if TORQUE in residuals and PRESSURE in runs[0]:
        regimes = Regimes(model, runs, parameters)
        masks = [regimes(run) for run in runs]
        if "direction=apply" in masks[0]:
            found["loop"] = {
                "measured_nm": _loop(runs, runs, masks), "simulated_nm": _loop(runs, shown, masks),
            }  # fmt: skip
    return found


def _rounded(value: float) -> float:
    return float(f"{float(value):.4g}")


def _memory(parts: Sequence[np.ndarray]) -> float | None:
    """Time [s] in which the correlated part falls to 1/e; None where there is none."""
    most = min(len(parts[0]) // 2, 2000)
    total = np.zeros(most)
    for part in parts:
        x = part - part.mean()
        spectrum = np.fft.rfft(x, 2 * len(x))
        total += np.fft.irfft(np.abs(spectrum) ** 2)[:most]
    if total[1] <= 0.02 * total[0]:  # lag 0 has the noise in it
        return None
    below = np.flatnonzero(total[1:] < total[1] / np.e)
    return _rounded(MEAN * (1 + int(below[0]) if len(below) else most))


def _coherent(parts: Sequence[np.ndarray], runs: Sequence[Columns], name: str) -> dict[str, float]:
    inputs = np.concatenate([means(run[name] - run[name].mean(), run) for run in runs])
    if not float(np.ptp(inputs)) > 0.0:
        return {"largest": 0.0, "hz": 0.0}
    segment = min(_SEGMENT, len(inputs) // 4)
    hertz, size = coherence(inputs, np.concatenate(parts), 1.0 / MEAN, nperseg=segment)
    best = 1 + int(np.argmax(size[1:]))
    return {"largest": _rounded(size[best]), "hz": _rounded(hertz[best])}


def _order(parts: Sequence[np.ndarray], runs: Sequence[Columns]) -> tuple[float, float]:
    """Order with the largest amplitude, and the amplitude, over all samples."""
    angles = [means(run[_ANGLE], run) for run in runs]
    count = sum(len(part) for part in parts)
    first = [np.exp(-1j * _ORDERS[0] * a) * part for a, part in zip(angles, parts, strict=True)]
    step = [np.exp(-1j * (_ORDERS[1] - _ORDERS[0]) * a) for a in angles]
    sizes = []
    for _ in _ORDERS:
        sizes.append(2.0 * sum(abs(wave.sum()) for wave in first) / count)
        first = [wave * s for wave, s in zip(first, step, strict=True)]
    best = int(np.argmax(sizes))
    return float(_ORDERS[best]), _rounded(sizes[best])


def _cross(residuals: dict[str, list[np.ndarray]]) -> dict[str, float]:
    found = {}
    for one, other in combinations(residuals, 2):
        a, b = (np.concatenate([part - part.mean() for part in residuals[c]]) for c in (one, other))
        size = float(a @ b) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-300)
        if abs(size) >= _CROSS:
            found[f"{one}, {other}"] = _rounded(size)
    return found


def _loop(runs: Sequence[Columns], torques: Sequence[Columns], masks: Sequence[dict[str, np.ndarray]]) -> float | None:
    """Mean over pressure of torque (without its sign) with rising less that with falling pressure [Nm]; None for no overlap."""
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
        if min(np.sum(up & (number == i)), np.sum(down & (number == i))) >= _IN_BIN
    ]
    return _rounded(float(np.mean(gaps))) if gaps else None
