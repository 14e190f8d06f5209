"""Timing: length of a run, channels that are late or early, clocks that run apart, stretches in a fault.

Steps of the clock itself are checked where a run is read (protocols/files/runs.py): rows, equal steps, no jump.
Equation        delay = the shift with the largest correlation of measured and predicted
"""

from collections.abc import Mapping, Sequence

import numpy as np

from clutch_hil.recordings.checks.finding import Finding
from clutch_hil.recordings.checks.knowledge import Recorded

LEAST_SECONDS = 1.0  # s of a run: residuals of one second are taken as one independent cluster (fitting/intervals.py)
LEAST_ROWS = 50  # of a run: with fewer, noise floor, shapes and delays rest on a handful of differences
LEAST_TOTAL = (
    2.0  # s of all runs: eight blocks of 0.25 s; with fewer no claim can reach a p-value of 0.01 (2^-7 = 0.008)
)
EARLY = 0.05  # s: nothing real is early; half a window of a smoother is
APART = 0.05  # s that the delay may change in a run: oil that warms, or a valve that sticks, change it by less
_LEAK_RATES = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # 1/s: those of the catalogue's leaking sensor, and around
# of the movement: half widths of the loops of a valve or piston that sticks
_LOOPS = np.array([0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2])
_STEADY = 0.25  # of what clocks run apart: how far the middle of a run may be from half of it
_MOST_DELAY = 5.0  # s that are searched, and a quarter of the run
_STEP = 5e-3  # s of the means that delays are read from: a tenth of what is told
_BETTER = 0.25  # of the unexplained share that is left: a shift explains most of the rest, or it is another fault
_AS_GOOD = 0.02  # of correlation: peaks that differ by less are those of a period
_LEAST_CORRELATION = 0.95  # at the best shift; noise of 5 % and a gain leave 0.97, a saturated triangle has less


def find_short(run: Recorded) -> list[Finding]:
    """A run that is too short to conclude anything from."""
    rows = len(run.columns["time_s"])
    if (seconds := rows * run.period) >= LEAST_SECONDS and rows >= LEAST_ROWS:
        return []
    text = f"is {seconds:.3g} s with {rows} rows; {LEAST_SECONDS:g} s and {LEAST_ROWS} rows are needed: record longer"
    return [Finding("length", "time_s", run.rows, text, True)]


def find_late(run: Recorded) -> list[Finding]:
    """Columns whose clock is not that of the inputs."""
    findings = []
    most = find_longest_delay(run)
    for name, known in run.known.items():
        if known.predicted is None:
            continue
        found_delay = find_delay(run.columns[name], known.predicted, run.period, most)
        if found_delay is None:
            continue
        delay, sure = found_delay
        if not sure or -EARLY <= delay <= known.limits.delay:
            continue
        if _is_physical(run.columns[name], known.predicted, run.period, delay):
            continue
        text = (
            f"is {abs(delay):.3g} s {'behind' if delay > 0.0 else 'before'} {known.source}: its clock is not that of the"
            " inputs; shift it, or record with one clock"
        )
        findings.append(Finding("delay", name, run.rows, text, True))
    return findings


def _is_physical(measured: np.ndarray, predicted: np.ndarray, period: float, delay: float) -> bool:
    """Whether a leak or a loop explains more than a shift by `delay` [s]; both shift slow movements more than fast ones.

    A sensor whose charge leaks is early. A valve with hysteresis or a piston with friction is late. With the smallest leak or
    loop the prediction itself explains more.
    """
    block = max(1, round(_STEP / period))
    m, p = (_average(values, block) for values in (measured, predicted))
    shift = round(abs(delay) / (block * period))
    early, late = (m, p) if delay < 0.0 else (p, m)
    shifted = np.corrcoef(early[: len(m) - shift], late[shift:])[0, 1]
    physical = _loop(p) if delay > 0.0 else _leak(p, block * period)
    return any(np.corrcoef(m, one)[0, 1] > shifted for one in physical)


def _leak(values: np.ndarray, period: float) -> list[np.ndarray]:
    """`values` (n,) as sensors show them whose charge leaks at _LEAK_RATES."""
    from scipy.signal import lfilter  # loading takes half a second of CPU; only a delay needs it

    decays = np.exp(-np.array(_LEAK_RATES) * period)
    return [lfilter([0.5 * (1.0 + decay), -0.5 * (1.0 + decay)], [1.0, -decay], values) for decay in decays]


def _loop(values: np.ndarray) -> np.ndarray:
    """`values` (n,) with play of each of _LOOPS (k, n): they follow at a distance, and stay where the direction turns."""
    width = _LOOPS * np.ptp(values)
    held = np.full(len(width), values[0])
    shown = np.empty((len(values), len(width)))
    for row, value in enumerate(values):
        held = np.clip(held, value - width, value + width)
        shown[row] = held
    return shown.T


def find_longest_delay(run: Recorded) -> float:
    """Delay [s] up to which one is searched in a run."""
    return min(_MOST_DELAY, 0.25 * len(run.columns["time_s"]) * run.period)


def find_drift(run: Recorded) -> list[Finding]:
    """Columns whose delay grows in the course of the run: two clocks that run apart."""
    findings = []
    n = len(run.columns["time_s"])
    most = min(_MOST_DELAY, 0.08 * n * run.period)  # a quarter of a third
    for name, known in run.known.items():
        if known.predicted is None or n < 3 * LEAST_ROWS:
            continue
        thirds = [slice(0, n // 3), slice(n // 3, 2 * n // 3), slice(2 * n // 3, n)]
        delays = [find_delay(run.columns[name][part], known.predicted[part], run.period, most) for part in thirds]
        if any(one is None for one in delays):
            continue
        (first, sure), (middle, _), (last, too) = delays  # type: ignore[misc]
        apart = last - first
        steady = abs(middle - 0.5 * (first + last)) < _STEADY * abs(apart)
        if abs(apart) > max(APART, 0.5 * known.limits.delay) and steady and (sure or too):
            k = int(np.argmax(np.abs([first, middle, last])))
            part = thirds[k]
            if _is_physical(run.columns[name][part], known.predicted[part], run.period, (first, middle, last)[k]):
                continue
            text = (
                f"runs apart from {known.source} by {apart:.3g} s from the first to the last third: its clock is another one;"
                " resample it by a channel that both have"
            )
            findings.append(Finding("drift", name, run.rows, text, True))
    return findings


def cut_at_fault(columns: Mapping[str, np.ndarray]) -> tuple[Mapping[str, np.ndarray], Finding | None]:
    """The rows before the first fault of a controller, and what was cut; all of them, and None, where there is none.

    A column of faults is named `fault` or `..._fault` and is 0 without one. In a fault the controller opens the clutch and
    stops the motor, whatever its demands say.
    """
    rows = len(columns["time_s"])
    first, name = rows, ""
    for column, values in columns.items():
        if column.rpartition("_")[2] == "fault" and len(at := np.flatnonzero(np.nan_to_num(values))) and at[0] < first:
            first, name = int(at[0]), column
    if not name:
        return columns, None
    text = f"shows a fault from {columns['time_s'][first]:.4g} s on; only the {first} rows before it are used"
    kept = {column: values[:first] for column, values in columns.items()}
    return kept, Finding("fault", name, (first, rows - 1), text, False)


def sum_seconds(runs: Sequence[Recorded]) -> float:
    """Length of all runs together [s]."""
    return sum(len(run.columns["time_s"]) * run.period for run in runs)


def find_delay(measured: np.ndarray, predicted: np.ndarray, period: float, most: float) -> tuple[float, bool] | None:
    """Delay [s] of measured behind predicted, within `most`, and whether it explains most of their difference.

    None where both have too little in common to tell.
    """
    block = max(1, round(_STEP / period))
    m, p = (_average(values, block) for values in (measured, predicted))
    shifts = int(most / (block * period))
    if shifts < 1 or len(m) < 4 * shifts or not (np.ptp(m) > 0.0 and np.ptp(p) > 0.0):
        return None
    # the middle of the prediction is moved along the measured: each shift has the same samples of the prediction
    inner = p[shifts : len(p) - shifts]
    inner = (inner - inner.mean()) / np.linalg.norm(inner - inner.mean()) if np.ptp(inner) > 0.0 else inner * 0.0
    size = 1 << int(np.ceil(np.log2(len(m) + len(inner))))
    cross = np.fft.irfft(np.fft.rfft(m - m.mean(), size) * np.conj(np.fft.rfft(inner, size)), size)[: 2 * shifts + 1]
    sums, squares = (np.concatenate([[0.0], np.cumsum((m - m.mean()) ** k)]) for k in (1, 2))
    n = len(inner)
    total, square = (s[n : n + 2 * shifts + 1] - s[: 2 * shifts + 1] for s in (sums, squares))
    spread = np.sqrt(np.maximum(square - total**2 / n, 0.0))
    r = np.where(spread > 0.0, cross / np.where(spread > 0.0, spread, 1.0), 0.0)
    inside = r[1:-1]
    peaks = 1 + np.flatnonzero((inside >= r[:-2]) & (inside >= r[2:]) & (inside > r.max() - _AS_GOOD))
    # of a period, the nearest
    best = int(peaks[np.argmin(np.abs(peaks - shifts))]) if len(peaks) else int(np.argmax(r))
    if r[best] < _LEAST_CORRELATION or best in (0, 2 * shifts):  # at the end of the search it is no maximum
        return None
    gains = 1.0 - r[best] ** 2 < _BETTER * (1.0 - max(r[shifts], 0.0) ** 2)
    return (best - shifts) * block * period, bool(gains)


def _average(values: np.ndarray, block: int) -> np.ndarray:
    n = len(values) // block
    return np.asarray(values[: n * block].reshape(n, block).mean(axis=1))
