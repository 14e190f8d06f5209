"""Baseline: checks of a column against what the baseline, as declared, predicts of it: sign, scale, offset, and whether it has
anything to do with it.

Equation        r = correlation of measured and predicted
                scale = s_m/s_p,  s_m^2 = variance - floor^2
                offset = median(measured - predicted)
What            these are far outside of anything that an effect of the catalogue does: a gain of 2, an offset of a fifth of the
                range, a delay of 50 ms are for discovery to name
"""

from collections.abc import Iterator

import numpy as np

from clutch_hil.recordings.checks.finding import Finding
from clutch_hil.recordings.checks.knowledge import BASELINE, Knowledge, Recorded
from clutch_hil.recordings.checks.likely_unit import name_unit
from clutch_hil.recordings.checks.values import MOVES, find_longest_rest

# Measured on 112 sound cases of the battery, seven runs of 24 s each, sensor faults up to a gap of 4 floors behind 5 % noise:
# correlation 0.94 to 1, scale 0.80 to 1.25, offset up to 0.21 of the movement, delay up to 20 ms. Only a slow thermometer is
# further out: 0.26, 0.41, 0.42, 1.9 s (`Knowledge.slow`).
_REVERSED = -0.5  # correlation: half-way between nothing in common and the same with the other sign
# Correlation: a line of another sign and another zero. Of 30 rigs, 22 parameters up to 40 % off the baseline, five runs each,
# it was at least -0.71, but for thermometers: -0.98, as a warm sump heats the oil that a cold one cools.
_SURELY_REVERSED = -0.9
_UNRELATED = 0.2  # correlation: below it three quarters of what is measured, and more, follow something else
SCALE = (
    4.0  # the catalogue's sensor gains end at 2, and a rig whose baseline is known exactly may be off by as much again
)
_TOLD_SCALE = (
    2.0  # times the latitude, from which a scale is told: that a badly known rig may be off is in its latitude
)
OFFSET = 0.5  # of the movement predicted: the catalogue's largest in the battery is 0.21
_TOLD_OFFSET = 0.25
_STILL = 0.05  # of the movement measured: what a prediction moves by that stands still
_MOVED = 0.3  # of its whole movement: what a channel does that does not
_REST = 1.0  # s that an input keeps one value at least: shorter holds belong to steps
_FOLLOWS = 0.2  # correlation from which a prediction follows: as for what is unrelated
_STEADY = 0.05  # s of means: shorter than any step of a demand that rests for _REST
_FAR = 0.7  # of the movement measured: half of its power; of the battery's sound outputs only a slow thermometer comes near
_SURE_LATITUDE = 2.0  # a baseline known no better than by this factor says little of what is unrelated


def find_reversed(run: Recorded) -> list[Finding]:
    """Columns whose sign is the other one.

    One that goes against the prediction, but on the same side of zero, may be sound: its rig is another one than the baseline,
    or its zero has moved, too.
    """
    findings = []
    for name, known, r in _compute_correlations(run):
        if r < _REVERSED:
            assert known.predicted is not None
            text = (
                f"goes against {known.source} (correlation {r:.2f}): reverse its sign, or that of an input, by scale"
                " = -1.0 in the import map"
            )
            turned = is_turned(run.columns[name], known.predicted) or (r < _SURELY_REVERSED and not known.slow)
            findings.append(
                Finding("sign", name, run.rows, text if turned else f"{text}, unless the rig is another one", turned)
            )
    return findings


def is_turned(measured: np.ndarray, predicted: np.ndarray) -> bool:
    """Whether columns (n,) of one unit are on opposite sides of zero most of the time: their cosine is below -0.5."""
    return bool(measured @ predicted < _REVERSED * np.linalg.norm(measured) * np.linalg.norm(predicted))


def find_unrelated(run: Recorded) -> list[Finding]:
    """Columns that have nothing in common with the prediction."""
    findings = []
    for name, known, r in _compute_correlations(run):
        if _REVERSED <= r < _UNRELATED:
            text = (
                f"has little in common with {known.source} (correlation {r:.2f}): check that it, and the inputs, are the right"
                " columns"
            )
            findings.append(
                Finding("unrelated", name, run.rows, text, run.latitude < _SURE_LATITUDE and not known.may_rest)
            )
    return findings


def _compute_correlations(run: Recorded) -> Iterator[tuple[str, Knowledge, float]]:
    """Columns that move, as their prediction does, and the correlation of both."""
    for name, known in run.known.items():
        if known.predicted is not None and _do_both_move(run, name, known):
            yield name, known, float(np.corrcoef(run.columns[name], known.predicted)[0, 1])


def find_scaled(run: Recorded) -> list[Finding]:
    """Columns that move by another order of magnitude than predicted; the likely unit is named."""
    findings = []
    for name, known in run.known.items():
        if known.predicted is None or not np.std(known.predicted) > 3.0 * known.floor:
            continue
        scale = _measure_movement(run.columns[name], known.floor) / float(np.std(known.predicted))
        if known.may_rest and scale < 1.0:
            scale = max(scale, float(np.linalg.norm(run.columns[name]) / np.linalg.norm(known.predicted)))
        off, limit = max(scale, 1.0 / scale) if scale > 0.0 else 1.0, _TOLD_SCALE * run.latitude
        if off <= limit:
            continue
        hard = off > max(SCALE, limit)
        text = f"is {scale:.2g} of what {_describe_ability(known)}: {name_unit(run, known, scale)}"
        findings.append(Finding("scale", name, run.rows, text, hard))
    return findings


def find_offset(run: Recorded) -> list[Finding]:
    """Columns whose zero is far off."""
    findings = []
    for name, known in run.known.items():
        if known.predicted is None or not _do_both_move(run, name, known):
            continue
        off, moves = float(np.median(run.columns[name] - known.predicted)), float(np.ptp(known.predicted))
        # of a prediction about 0, as a friction to and fro, no factor makes an offset
        sure = abs(off) - (run.latitude - 1.0) * abs(float(np.median(known.predicted)))
        share = max(abs(off) / run.latitude, sure) / moves
        if share > _TOLD_OFFSET:
            text = f"is off by {off:.4g} {known.unit} throughout, {share:.2g} of its movement: check its zero, and its unit"
            text += run.of_unknown_rig
            findings.append(Finding("offset", name, run.rows, text, share > OFFSET and not known.slow))
    return findings


def find_still_prediction(run: Recorded) -> list[Finding]:
    """The input that keeps one value for longest while an output moves and the baseline does not follow: it is dead or frozen.

    A position that rests may still give a force of any sign, and another input may move the prediction. So it need not stand
    still: that it does not follow is enough.
    """
    outputs = [n for n in run.predictions if run.known[n].source == BASELINE]
    for name in outputs:
        known, predicted = run.known[name], run.predictions[name]
        moved = float(np.ptp(_average(run.columns[name], run.period)))
        if moved > MOVES * known.floor and np.ptp(_average(predicted, run.period)) < _STILL * moved:
            text = (
                f"moves by {moved:.3g} {known.unit}, where the baseline, driven by {' and '.join(run.inputs)}, stands still: an"
                " input is dead, or in another unit"
            )
            return [Finding("input", name, run.rows, text, True)]
    rests = {name: find_longest_rest(run.columns[name]) for name in run.inputs}
    for source, (first, last) in sorted(rests.items(), key=lambda item: item[1][0] - item[1][1]):
        if (last - first) * run.period < _REST:
            continue
        part = slice(first, last + 1)
        for name in outputs:
            known = run.known[name]
            measured, predicted = (
                _average(values[part], run.period) for values in (run.columns[name], run.predictions[name])
            )
            moved = float(np.ptp(measured))
            if moved < max(_MOVED * float(np.ptp(_average(run.columns[name], run.period))), MOVES * known.floor):
                continue
            still = np.ptp(predicted) < _STILL * moved
            if still or np.corrcoef(measured, predicted)[0, 1] < _FOLLOWS:
                text = (
                    f"keeps {run.columns[source][first]:.6g} for {(last - first + 1) * run.period:.3g} s, in which {name} moves"
                    f" by {moved:.3g} {known.unit} and the baseline does not follow: the input is dead, frozen or cut off there"
                )
                return [Finding("input", source, (first, last), text, True)]
    return []


def find_far(run: Recorded) -> list[Finding]:
    """Columns that are far from the prediction, whatever the reason."""
    findings = []
    for name, known in run.known.items():
        if known.predicted is None or not _do_both_move(run, name, known):
            continue
        off = float(np.sqrt(np.mean((run.columns[name] - known.predicted) ** 2)))
        share = off / float(np.std(run.columns[name]))
        if share > _FAR * max(run.latitude, 1.0):
            text = f"is off from {known.source} by {off:.3g} {known.unit} root mean square, {share:.2g} of its own movement"
            findings.append(Finding("far", name, run.rows, text, False))
    return findings


def _do_both_move(run: Recorded, name: str, known: Knowledge) -> bool:
    assert known.predicted is not None
    return bool(
        np.std(known.predicted) > 3.0 * known.floor and _measure_movement(run.columns[name], known.floor) > 3.0 * known.floor
        and np.ptp(known.predicted) > 0.0 and np.ptp(run.columns[name]) > 0.0
    )  # fmt: skip


def _measure_movement(values: np.ndarray, floor: float) -> float:
    """Standard deviation of values (n,) without noise of the size `floor`; with it where there is hardly more than noise."""
    power = float(np.var(values))
    return float(np.sqrt(power - floor**2 if power > 2.0 * floor**2 else power))


def _average(values: np.ndarray, period: float) -> np.ndarray:
    """Means over 50 ms: without most of the noise."""
    block = min(max(1, round(_STEADY / period)), len(values))
    n = len(values) // block
    return np.asarray(values[: n * block].reshape(n, block).mean(axis=1))


def _describe_ability(known: Knowledge) -> str:
    return "the rig can do by its baseline" if known.source == BASELINE else f"{known.source} makes of it"
