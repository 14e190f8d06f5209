"""Inputs: checks of an input against what the outputs tell of it, by the baseline turned round: a load by the friction that it
causes, a position by the direction in which friction acts.

Equation        N* = (|F| - F_c - F_v |v|)/mu  where the contact slides;  sign(F) = sign(v)
                zero of an input x: x_0 of the line N* = s (x - x_0), by least squares
What            s and mu may be off by any factor, as the checks look at times, at rests and at the zero alone
"""

from collections.abc import Iterator

import numpy as np

from clutch_hil.recordings.checks.finding import Finding
from clutch_hil.recordings.checks.knowledge import Implied, Recorded
from clutch_hil.recordings.checks.timing import EARLY, find_delay, find_longest_delay
from clutch_hil.recordings.checks.values import MOVES

_TOLD_DELAY = 0.1  # s: as for outputs
_LATE = 0.25  # s: chosen; friction that fades with the work done turns before its load does, in sound runs by 0.07 s
_REST = 0.5  # s of equal values of a sensor that else has noise: as for outputs (values.py)
_NOISY = 0.5  # share of the other rows in which the column moves: it is a sensor, not a demand that rests
_MOVE = 0.3  # of its mean: what an implied load moves by beside a constant one; chosen, a friction level drifts by less
_FROZEN_MOVE = 0.2  # of its whole movement, beside a frozen stretch
_STEADY = 0.05  # s of means
_ZERO = (
    0.5  # of the mean of an input: how far its zero is off; the catalogue's loss of friction with load gives a third
)
_LINE = 0.9  # correlation from which the line tells a zero
_LEAST_SPREAD = 0.1  # of its mean: standard deviation of an input below which it does not
_FULL = 0.5  # of the median friction: less may be a contact that sticks
_CLEAR = 2.0  # floors that half of the friction has at least: then noise makes no turn, which is three times as far
_LEAST_ROWS = 50  # with an implied value


def find_late_inputs(run: Recorded) -> list[Finding]:
    """Inputs whose clock is not that of the outputs."""
    findings = []
    for name, implied in run.implied.items():
        most, values = find_longest_delay(run), implied.values
        if values is not None:
            known = np.flatnonzero(np.isfinite(values))
            if len(known) < _LEAST_ROWS:
                continue
            filled = np.interp(np.arange(len(values)), known, values[known])
            delay = find_delay(_find_centre(run, name), filled, run.period, most)
        else:
            assert implied.friction is not None
            assert implied.speed is not None
            delay = find_delay(np.sign(implied.speed), _find_level(implied), run.period, most)
        if delay is None or not delay[1] or -_TOLD_DELAY <= delay[0] <= _TOLD_DELAY:
            continue
        behind = "behind" if delay[0] > 0.0 else "before"
        text = (
            f"is {abs(delay[0]):.3g} s {behind} its course computed from {implied.source}: its clock differs from"
            " that of the force; shift it, or record with one clock"
        )
        # friction follows a position late where the contact bends first, and never comes before it
        hard = delay[0] > EARLY if implied.values is None else abs(delay[0]) > _LATE
        findings.append(Finding("delay", name, run.rows, text, hard))
    return findings


def find_still_inputs(run: Recorded) -> list[Finding]:
    """Sensors that keep one value while the outputs tell that it changes: dead, frozen or at their end."""
    findings = []
    for name, implied in run.implied.items():
        values = run.columns[name]
        if np.ptp(values) == 0.0:
            findings += _find_constant(run, name, implied)
            continue
        rests = [(first, last) for first, last in _find_rests(values) if (last - first + 1) * run.period >= _REST]
        others = len(values) - sum(last - first + 1 for first, last in rests)
        moves = np.count_nonzero(np.diff(values)) - 2 * len(rests)
        if not rests or others < _LEAST_ROWS or moves < _NOISY * others:
            continue
        findings += _find_reversals(run, name, implied, rests) or _find_frozen(run, name, implied, rests)
    return findings


def find_zero_of_inputs(run: Recorded) -> list[Finding]:
    """Inputs whose zero is far off: at the value that they have there, the output does not vanish."""
    findings = []
    for name, implied in run.implied.items():
        if implied.values is None:
            continue
        known = np.isfinite(implied.values)
        x, y = run.columns[name][known], implied.values[known]
        if len(x) < _LEAST_ROWS or np.std(x) <= _LEAST_SPREAD * abs(np.mean(x)) or np.ptp(y) == 0.0:
            continue
        if np.corrcoef(x, y)[0, 1] < _LINE:
            continue
        slope, constant = np.polyfit(x, y, 1)
        zero = -constant / slope
        if abs(zero) > _ZERO * abs(float(np.mean(x))):
            text = (
                f"would be 0 at {zero:.3g} {run.known[name].unit} by {implied.source}: check its zero, as a contact without"
                " load has no friction"
            )
            findings.append(Finding("offset", name, run.rows, text, False))
    return findings


def _find_constant(run: Recorded, name: str, implied: Implied) -> list[Finding]:
    if implied.values is None:
        return []
    moved = _move(run, implied.values, slice(None))
    mean = abs(float(np.nanmean(implied.values))) if np.isfinite(implied.values).any() else 0.0
    if not moved > max(_MOVE * mean, MOVES * implied.floor):
        return []
    text = (
        f"is {run.columns[name][0]:.6g} {run.known[name].unit} throughout, but by {implied.source} it should move by"
        f" {moved:.3g}: it is a set value or a dead channel; map the measured one"
    )
    return [Finding("dead", name, run.rows, text, False)]


def _find_frozen(run: Recorded, name: str, implied: Implied, rests: list[tuple[int, int]]) -> list[Finding]:
    """A stretch of an input with one value, in which its implied one moves on."""
    if implied.values is None:
        return []
    least = max(_FROZEN_MOVE * _move(run, implied.values, slice(None)), MOVES * implied.floor)
    for first, last in sorted(rests, key=lambda rest: rest[0] - rest[1]):
        if (moved := _move(run, implied.values, slice(first, last + 1))) > least:
            text = (
                f"{_explain_kept(run, name, first, last)}, in which by {implied.source} it should move by {moved:.3g}: the"
                " channel"
                " froze, or is at its end; leave this stretch out"
            )
            return [Finding("frozen", name, (first, last), text, True)]
    return []


def _find_reversals(run: Recorded, name: str, implied: Implied, rests: list[tuple[int, int]]) -> list[Finding]:
    """Stretches of a position with one value, in which friction turns from its full level to the other."""
    if implied.friction is None:
        return []
    level = _find_level(implied)
    turned = [(first, last, _count_turns(level[first : last + 1])) for first, last in rests]
    count = sum(turns for _, _, turns in turned)
    if not count:
        return []
    first, last, _ = max(turned, key=lambda rest: (rest[2], rest[1] - rest[0]))
    text = (
        f"{_explain_kept(run, name, first, last)}, in which the"
        f" friction in {implied.source} reverses ({count} times in all such stretches): the channel froze, or is at its end"
    )
    return [Finding("frozen", name, (first, last), text, count > 1)]


def _explain_kept(run: Recorded, name: str, first: int, last: int) -> str:
    seconds = (last - first + 1) * run.period
    return f"keeps {run.columns[name][first]:.6g} {run.known[name].unit} for {seconds:.3g} s"


def _find_level(implied: Implied) -> np.ndarray:
    """Friction (n,) as -1, 0 or 1: 0 where it is far from full."""
    assert implied.friction is not None
    full = _FULL * float(np.median(np.abs(implied.friction)))
    if full < _CLEAR * implied.floor:
        return np.zeros(len(implied.friction))
    return np.where(np.abs(implied.friction) > full, np.sign(implied.friction), 0.0)


def _count_turns(level: np.ndarray) -> int:
    signs = level[level != 0.0]
    return int(np.count_nonzero(np.diff(signs)))


def _move(run: Recorded, values: np.ndarray, part: slice) -> float:
    """Movement of a part of values with NaN, without noise and single samples: of medians over 50 ms, 5 to 95 %."""
    block = max(1, round(_STEADY / run.period))
    there = values[part]
    n = len(there) // block
    if not n:
        return 0.0
    blocks = there[: n * block].reshape(n, block)
    blocks = blocks[np.isfinite(blocks).all(axis=1)]
    if len(blocks) < 2:
        return 0.0
    low, high = np.quantile(np.median(blocks, axis=1), (0.05, 0.95))
    return float(high - low)


def _find_centre(run: Recorded, name: str) -> np.ndarray:
    return run.columns[name] - float(np.mean(run.columns[name]))


def _find_rests(values: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and last row of each stretch of equal values."""
    edges = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0.0, [True]]))
    long = np.flatnonzero(np.diff(edges) > 1)
    yield from zip(edges[long].tolist(), (edges[long + 1] - 1).tolist(), strict=True)
