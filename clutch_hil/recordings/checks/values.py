"""Values: checks of single columns, without timing: dead, out of range, frozen, saturated, outliers.

The limits were set on runs of the battery (benchmarks/dirty_channels.py counts): sound ones stay far inside, see each constant.
"""

from math import isfinite

import numpy as np
from scipy.ndimage import median_filter

from clutch_hil.recordings.checks.finding import Finding
from clutch_hil.recordings.checks.knowledge import Knowledge, Recorded
from clutch_hil.recordings.checks.likely_unit import name_own_unit
from protocols.errors import format_count

MOVES = 10.0  # floors, peak to peak: a prediction that moves by more must show in the channel, whatever its sensor
MARGIN = 0.05  # of the width between limits: noise and offset of a sensor at its end
SPAN_FACTOR = 100.0  # times the span: strokes of 0.01 to 100 times it occur on rigs of a kind; a wrong prefix is 1000
# Shares of an input's span, told outside: inch for m is 39; chosen, a rig of the model moves as it does
_TOLD_SPAN = (1.0 / 30.0, 4.0)
_FROZEN = 0.5  # s of equal values: noise of an amplifier never leaves a converter on one step for 500 samples in motion
_FROZEN_MOVE = 0.2  # of its whole movement: what the prediction moves, or is off, beside a frozen stretch
# Turns of direction, as a share of the steps: white noise has two thirds; a simulated torque, which follows a controlled
# pressure, had up to a fifth
_SMOOTH_TURNS = 0.4
_MOSTLY = 0.5  # share of rows: a clutch that touches later than its baseline rests a little longer
_UNSEEN_FROZEN = (
    0.1  # share of rows with one value in a column that else moves; only told, where no prediction judges it
)
_CLIPPED = (
    0.01  # share of rows at the end of a channel: noise alone reaches its own extreme once, not in one row of 100
)
# Of its noise, by which a channel without a prediction is judged: equal neighbours, and turns of its direction. White noise of
# a converter's step or more has at most 0.5 and 2/3; a smooth signal has no turns, a coarse one has equal neighbours
_MOST_EQUAL, _LEAST_TURNS = 0.6, 0.3
_CLIPPED_ROWS = 40  # of such noise, all at one end: chance makes a stretch of them once in 1e9 rows
_BEYOND = 0.1  # of its whole movement: how far the prediction is beyond the end of a saturated channel
_BEYOND_ROWS = 0.5  # share of rows at the end where it is: a signal comes near its end before it is beyond
_BESIDE = np.array([[1], [2], [3]])  # rows to each side whose median is the level there
_JUMP = 0.5  # of a spike's height: levels that differ by more are those of a jump
_SPIKE = (
    0.3  # of the whole movement of a column, away from the median of five rows: no block of a rig returns within 2 rows
)
_SPIKE_FLOORS = 30.0  # floors: the largest of 1e9 samples of noise is 6
# Without a known noise: times the distance from the median that 0.9 of the samples keep, which is 1.6 standard deviations of
# noise, and steps of the converter. A rig at rest shows nothing but noise and such steps, and they are no spikes
_USUAL, _SPIKE_STEPS = 6.0, 3.0
_WRAP = 0.7  # of an angle's range: a step by so much in one sample; where it begins anew it is all but a step of it
_SAME_WRAP = 0.05  # of a turn: what such steps may differ by, at a speed that changes
# Movements of all other values, by which a value is away that stands for no value: -999 degC beside 20 to 80 is 17. In all
# columns of the shipped scenarios a value that occurs twice or more is at most 4.2 away, the pressure demand of an open clutch
_FAR_AWAY = 10.0
_MANY_SPIKES = 1e-3  # share of rows: more are not single disturbances, but a channel that loses its signal


def find_dead(run: Recorded) -> list[Finding]:
    """Columns of one value while the baseline predicts a movement."""
    findings = []
    for name, known in run.known.items():
        values = run.columns[name]
        if np.ptp(values) > 0.0:
            continue
        if known.predicted is not None and np.ptp(known.predicted) > MOVES * known.floor:
            text = (
                f"is {values[0]:.6g} {known.unit} throughout, where {known.source} moves by {np.ptp(known.predicted):.3g}: the"
                " channel is dead; connect it, or map the column that holds the signal"
            )
            findings.append(Finding("dead", name, run.rows, text, True))
        elif known.predicted is None and name not in run.inputs:
            text = f"is {values[0]:.6g} {known.unit} throughout; check that this channel was connected"
            findings.append(Finding("dead", name, run.rows, text, False))
    return findings


def find_out_of_range(run: Recorded) -> list[Finding]:
    """Columns with values, or a movement, that the rig cannot have."""
    findings = []
    for name, known in run.known.items():
        values, limits = run.columns[name], known.limits
        width = limits.high - limits.low
        margin = MARGIN * width if isfinite(width) else 0.0
        outside = np.flatnonzero((values < limits.low - margin) | (values > limits.high + margin))
        if len(outside):
            worst = outside[np.argmax(np.abs(values[outside]))]
            text = (
                f"is {values[worst]:.4g} {known.unit} in row {worst}, where the rig has {limits.low:g} to {limits.high:g}:"
                f" check the unit and the sign in the import map, and whether the run ended in a fault{run.of_unknown_rig}"
            )
            findings.append(Finding("range", name, (int(outside[0]), int(outside[-1])), text, True))
            continue
        ratio = float(np.ptp(values)) / limits.span if isfinite(limits.span) else 1.0
        if ratio == 0.0:
            text = f"is {values[0]:.6g} {known.unit} throughout: it is dead, or the rig stood still"
            findings.append(Finding("range", name, run.rows, text, True))
        elif not (_TOLD_SPAN[0] < ratio < _TOLD_SPAN[1] or (name not in run.inputs and _is_of_a_kind(ratio))):
            text = (
                f"moves by {np.ptp(values):.3g} {known.unit}, {ratio:.2g} of what this rig is made for:"
                f" {name_own_unit(known, ratio)}, or give the model of your rig"
            )
            findings.append(Finding("range", name, run.rows, text, not _is_of_a_kind(ratio)))
    return findings


def _is_of_a_kind(ratio: float) -> bool:
    """Whether rigs of a kind may differ so much in the size of their movement."""
    return 1.0 / SPAN_FACTOR < ratio < SPAN_FACTOR


def find_frozen(run: Recorded) -> list[Finding]:
    """Stretches in which a column keeps one value while the baseline moves on."""
    findings = []
    for name, known in run.known.items():
        if name in run.inputs and known.predicted is None:
            continue  # a demand may rest; what that does to the prediction is another check
        values = run.columns[name]
        first, last = find_longest_rest(values)
        length = last - first + 1
        if not 2 <= length < len(values):
            continue
        if known.predicted is None:
            moving = np.count_nonzero(np.diff(values)) > 0.5 * (len(values) - length)  # it is no status
            if moving and length > _UNSEEN_FROZEN * len(values) and length * run.period >= _FROZEN:
                kept = f"keeps {values[first]:.6g} {known.unit} for {length * run.period:.3g} s"
                text = f"{kept}: leave this stretch out if it froze"
                findings.append(Finding("frozen", name, (first, last), text, False))
        elif length * run.period >= _FROZEN and _moves_on(known, values[first], first, last):
            if known.clips and _is_at_end(values, values[first]):
                continue  # saturated: see there
            if _rests_without_noise(known, values, first, last):
                continue
            other = f", or {known.limits.rest}" if known.limits.rest else ""
            text = (
                f"keeps {values[first]:.6g} {known.unit} for {length * run.period:.3g} s while {known.source} moves on: the"
                f" channel froze{other}; leave this stretch out (from_s, to_s in the import map)"
            )
            findings.append(Finding("frozen", name, (first, last), text, True))
    return findings


def _moves_on(known: Knowledge, value: float, first: int, last: int) -> bool:
    assert known.predicted is not None
    beside = known.predicted[first : last + 1]
    least = max(_FROZEN_MOVE * float(np.ptp(known.predicted)), MOVES * known.floor)
    return bool(np.ptp(beside) > least or abs(float(np.mean(beside)) - value) > least)


def _rests_without_noise(known: Knowledge, values: np.ndarray, first: int, last: int) -> bool:
    """Return whether a channel without noise, as of a simulation, rests in rows where its prediction mostly does, too.

    Such a torque is exactly 0 while the clutch is open. With noise no channel keeps one value.
    """
    assert known.predicted is not None
    near = np.abs(known.predicted[first : last + 1] - values[first]) <= MOVES * known.floor
    steps = np.diff(np.concatenate([values[:first], values[last + 1 :]]))
    steps = steps[steps != 0.0]
    turns = float(np.mean(steps[1:] * steps[:-1] < 0.0)) if len(steps) > 1 else 0.0
    return turns < _SMOOTH_TURNS and float(np.mean(near)) > _MOSTLY


def _is_at_end(values: np.ndarray, value: float) -> bool:
    return value in (values.min(), values.max())


def find_saturated(run: Recorded) -> list[Finding]:
    """Columns that rest at an end of theirs while the baseline goes beyond it, or, without one, while they else have noise."""
    findings = []
    for name, known in run.known.items():
        values, predicted = run.columns[name], known.predicted
        if np.ptp(values) == 0.0 or (predicted is None and name in run.inputs):
            continue
        for end, sign in ((values.max(), 1.0), (values.min(), -1.0)):
            at = np.flatnonzero(values == end)
            if len(at) <= _CLIPPED * len(values) or len(at) <= _count_next(values, end):
                continue
            if predicted is None:
                saturated, why = _has_lost_noise(values, float(end)), "without its noise"
            else:
                least = max(_BEYOND * float(np.ptp(predicted)), MOVES * known.floor)
                saturated = float(np.mean(sign * (predicted[at] - end) > least)) > _BEYOND_ROWS
                why = f"where {known.source} is beyond it"
            if saturated:
                text = (
                    f"rests at its end, {end:.6g} {known.unit}, in {format_count(len(at), 'row')} {why}: it is saturated;"
                    " widen its range and record again"
                )
                findings.append(Finding("saturated", name, (int(at[0]), int(at[-1])), text, not known.clips))
    return findings


def _count_next(values: np.ndarray, end: float) -> int:
    """Rows of `values` (n,) at the value next to their `end`.

    What is beyond the end of a saturated channel is all at its end. On the coarse steps of a converter the dips of a sound one
    come to rest there, too, but more rows are one step before it.
    """
    others = np.unique(values[values != end])
    return int(np.count_nonzero(values == others[np.argmin(np.abs(others - end))]))


def _has_lost_noise(values: np.ndarray, end: float) -> bool:
    """Whether `values` (n,) keep their `end` for long, and else have noise; at 0 many sensors rest."""
    if end == 0.0:
        return False
    edges = np.flatnonzero(np.diff(np.concatenate([[False], values == end, [False]]).astype(np.int8)))
    if np.max(edges[1::2] - edges[::2]) < _CLIPPED_ROWS:
        return False
    steps = np.diff(values)
    away = (values[:-1] != end) & (values[1:] != end)
    if not np.any(away[1:]):
        return False
    equal = np.mean(steps[away] == 0.0)
    turns = np.mean(steps[1:][away[1:]] * steps[:-1][away[1:]] < 0.0)
    return bool(equal < _MOST_EQUAL and turns > _LEAST_TURNS)


def find_placeholders(run: Recorded) -> list[Finding]:
    """Numbers that stand for no value, as -9999 and 1e37 do: the same one several times, far from all others.

    Only in columns that no prediction judges, and in no input, which may be a pulse.
    """
    findings = []
    for name, known in run.known.items():
        values = run.columns[name]
        if known.predicted is not None or name in run.inputs:
            continue
        text, rows = find_placeholder(values)
        if len(rows):
            findings.append(Finding("placeholder", name, (int(rows[0]), int(rows[-1])), text, False))
    return findings


def find_placeholder(values: np.ndarray, fewest: int = 2) -> tuple[str, np.ndarray]:
    """Return a text on the number in `values` (n,) that marks missing ones, and its rows (m,); "" and no rows without one.

    fewest: rows with this number, of which a finding has at least so many.
    """
    known = values[np.isfinite(values)]
    for value in (known.min(), known.max()) if len(known) else ():
        others = known[known != value]
        rows = np.flatnonzero(values == value)
        if len(rows) < fewest or not len(others):
            continue
        span = float(np.ptp(others))
        away = float(np.min(np.abs(others - value)))
        if 0.0 < _FAR_AWAY * span < away:
            text = (
                f"is {value:.6g} in {format_count(len(rows), 'row')}, away from all other values by {away / span:.2g}"
                " times their range: if it marks a missing value, set missing for this column in the import map to the"
                " number that the file has"
            )
            return text, rows
    return "", np.zeros(0, int)


def find_outliers(run: Recorded) -> list[Finding]:
    """Single samples far from their neighbours."""
    findings = []
    for name, known in run.known.items():
        values = run.columns[name]
        if name in run.inputs and known.predicted is None:
            continue
        rows, _ = find_spikes(values, known.floor)
        if known.predicted is not None:  # at few rows a second a step of the rig may be a single sample
            rows = np.setdiff1d(rows, find_spikes(known.predicted, known.floor)[0])
        if len(rows):
            text = (
                f"has {format_count(len(rows), 'isolated sample')} far from the neighbours, the first in row {rows[0]}:"
                " replace outliers before the import"
            )
            many = not are_few(rows, values)
            text += "" if many else "; identify replaces them, discrepancy treats them as signal"
            findings.append(Finding("outliers", name, (int(rows[0]), int(rows[-1])), text, many))
    return findings


def are_few(spikes: np.ndarray, values: np.ndarray) -> bool:
    """Return whether the rows (m,) of `spikes` in `values` (n,) are single disturbances; one always is."""
    return len(spikes) <= max(1.0, _MANY_SPIKES * len(values))


def find_spikes(values: np.ndarray, floor: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows (m,) of `values` (n,) that are alone far from their neighbours, and the medians (m,) of five rows there.

    floor: standard deviation of the noise; 0 if unknown, then it is estimated from `values`. The peak of a jump, as of a
    motor's torque after a step of its speed demand, is not alone: the levels before and after it differ.
    """
    if len(values) < 5:
        return np.zeros(0, int), np.zeros(0)
    smooth = median_filter(values, 5, mode="nearest")
    away = np.abs(values - smooth)
    least = max(_SPIKE * float(np.quantile(values, 0.999) - np.quantile(values, 0.001)), _SPIKE_FLOORS * floor)
    if floor == 0.0:
        steps = np.diff(np.unique(values))
        step = float(steps.min()) if len(steps) else 0.0
        least = max(least, _USUAL * float(np.quantile(away, 0.9)), _SPIKE_STEPS * step)
    rows = np.flatnonzero(away > least) if least > 0.0 else np.zeros(0, int)
    before, after = (np.median(values[np.clip(rows + side * _BESIDE, 0, len(values) - 1)], axis=0) for side in (-1, 1))
    rows = rows[np.abs(after - before) < _JUMP * np.abs(values - smooth)[rows]]
    return rows, smooth[rows]


def find_wrapped(run: Recorded) -> list[Finding]:
    """Angles that begin anew after a turn of the sensor: nothing that turns is back by a turn in one sample."""
    findings = []
    for name, known in run.known.items():
        if known.unit != "rad":
            continue
        values = run.columns[name]
        steps, span = np.abs(np.diff(values)), float(np.ptp(values))
        jumps = steps > _WRAP * span
        if np.count_nonzero(jumps) < 2 or float(np.ptp(steps[jumps])) > _SAME_WRAP * span:
            continue
        if np.any(steps[~jumps] > (1.0 - _WRAP) * span):  # it moves so fast that none of its steps tells a turn
            continue
        turn = float(np.median(steps[jumps]) + np.median(steps[~jumps]))
        if abs(turn - 2.0 * np.pi) < _SAME_WRAP * turn:
            turn = 2.0 * np.pi
        rows = np.flatnonzero(jumps)
        text = (
            f"jumps by {turn:.4g} rad {len(rows)} times, as an angle that begins anew: set wraps_at for it in the import map,"
            f" {turn:.5g} where the file has rad, {np.degrees(turn):.5g} where it has deg"
        )
        findings.append(Finding("wrapped", name, (int(rows[0]), int(rows[-1]) + 1), text, True))
    return findings


def find_longest_rest(values: np.ndarray) -> tuple[int, int]:
    """First and last row of the longest stretch of equal values (n,)."""
    edges = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0.0, [True]]))
    k = int(np.argmax(np.diff(edges)))
    return int(edges[k]), int(edges[k + 1]) - 1
