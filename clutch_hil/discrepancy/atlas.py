"""Atlas: where model and measurement disagree: block, output, regime, how much, and how sure that is.

Size            root of a source's mean power (sources.py) over a regime: sqrt(rms^2 - floor^2) without the floor's own error
Test            u_b: sum of a source's power, as tested, over the samples of a regime in block b of 0.25 s, clipped
                z = sum u_b/sqrt(sum u_b^2);  p: share of random signs of the blocks with z as large for any source, regime
Assumptions     a sensor's noise is correlated over less than 16 ms and independent of another sensor's; its size may change
Choice          an output is claimed in the regimes of that family (phase, direction, slip, ...) in which its power is most
                concentrated, if it is, else in "all"
Not modelled    disagreements shorter than 4 ms
References      Canay, Romano and Shaikh 2017, Econometrica 85 (signs of blocks); Romano and Wolf 2005, J. Am. Stat. Assoc. 100
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from clutch_hil.discrepancy.model import Candidate, Columns, Model, Output, Values
from clutch_hil.discrepancy.regimes import ALL, Masks, Regimes, family
from clutch_hil.discrepancy.result import Claim
from clutch_hil.discrepancy.sources import (
    DRIVE,
    FRICTION,
    HYDRAULICS,
    MEAN,
    MOTOR,
    PRESSURE,
    SENSORS,
    TORQUE,
    Source,
    means,
    sources,
)

LEVEL = 0.01  # of p-values: share of cases without a disagreement in which anything may be claimed
WHICH = 0.05  # of p-values of the regimes named, where the disagreement as such is sure at LEVEL
LEAST = (
    0.458  # floors: root of 1.1^2 - 1; an error within 1.1 floors is closed (battery.md), and so no disagreement, ...
)
MUCH = 1.0  # ... nor is one of less in a phase of the rig's work
_BLOCK = 0.25  # s: beyond it products of residuals are independent
_DRAWS = 2000  # random signs: p-values down to 1/2001
_CLIP = 2.0  # of the median size of u: Huber 1981, Robust Statistics, ch. 4, loses 5 % where u is normal
_CHUNK = 250
_SEED = 6
_SHARE = 0.6  # of the power that regimes of a family must hold to be claimed ...
_PART = 0.1  # of the power that each of them must hold
_PLACES = (
    "phase",
    "direction",
    "slip sign",
    "reversal turn",
)  # families of the rig's work; terciles are in report.json's gap_by_regime
_DENSER = 1.6  # a set of regimes is claimed where it holds this many times more than its share of the time
_BESIDE = 0.15  # of the power (in floors) of the largest claim: less is its echo in another block, whose gain is known to 10 %
_TINY = 1e-3  # of the time: a regime with less is none
Shares = Mapping[str, tuple[float, float]]  # regime -> (share of power, share of time)


@dataclass(frozen=True)
class Seen:
    """A source in all runs: `power` (n,), `tested` (n, k), number of the `block` (n,), `masks` (n,) by regime."""

    source: Source
    power: np.ndarray
    tested: np.ndarray
    block: np.ndarray
    masks: Masks


def claims(model: Model, runs: Sequence[Columns], floors: Values, parameters: Values, effects: Values) -> list[Claim]:
    """Where `model` at `parameters` with `effects` disagrees with `runs`; what explains most of the disagreement first."""
    outputs = {output.column: output for output in model.outputs}
    seen = gathered(sources(model, runs, floors, parameters, effects), runs, Regimes(model, runs, parameters))
    p_values = significance(seen)
    found: list[tuple[float, list[Claim]]] = []
    for i, one in enumerate(_plain(seen, p_values)):
        output = outputs[one.source.column]
        floor = floors[output.column]
        power = {name: float(np.mean(one.power[mask])) / floor**2 for name, mask in one.masks.items()}
        sure = {name for name in one.masks if p_values[i, name] <= LEVEL}
        there = [n for n in sure if power[n] >= MUCH**2 and family(n) in _PLACES]
        if sure and (power[ALL] >= LEAST**2 or (there and power[ALL] > 0.0)):
            # that they disagree is sure at LEVEL; which of the regimes it is, at WHICH
            names = [name for name in concentrated(shares(one)) if p_values[i, name] <= WHICH]
            where = names or [ALL if ALL in sure else max(sure, key=lambda n: power[n] * float(np.mean(one.masks[n])))]
            found.append((power[ALL], [_claim(one, output, name, floor, p_values[i, name]) for name in where]))
    found.sort(key=lambda pair: -pair[0])
    kept: dict[str, list[Claim]] = {}
    for excess, ours in found:
        if excess >= _BESIDE * found[0][0]:
            kept.setdefault(ours[0].block, ours)  # a block is claimed by the output that shows it best
    return [claim for ours in kept.values() for claim in ours]


def _plain(seen: Sequence[Seen], p_values: Mapping[tuple[int, str], float]) -> list[Seen]:
    """`seen` without two faults that are one.

    A torque sensor's fault drags the re-fitted friction with it, so that drive and sensor are off to different sides: the
    larger is meant. A pressure that is off is the sensor's where the plates say so, also while they are apart and cannot.
    """
    number = {(one.source.block, one.source.column): i for i, one in reversed(list(enumerate(seen)))}
    found = list(seen)

    def at(block: str, column: str) -> int | None:
        return number.get((block, column))

    friction, sensor, drive = at(FRICTION, TORQUE), at(SENSORS, TORQUE), at(DRIVE, MOTOR)
    if friction is not None and sensor is not None and drive is not None and np.mean(seen[friction].power) < 0.0:
        less = min(sensor, drive, key=lambda i: float(np.mean(seen[i].power)))
        found[less] = replace(seen[less], power=np.zeros_like(seen[less].power))
    accused, off = at(SENSORS, PRESSURE), at(HYDRAULICS, PRESSURE)
    if accused is not None and off is not None and p_values[accused, ALL] <= LEVEL:
        judged = seen[accused].power != 0.0
        if np.sum(seen[accused].power) > 0.5 * np.sum(seen[off].power[judged]):
            found[off] = replace(seen[off], source=replace(seen[off].source, block=SENSORS))
            found[accused] = replace(seen[accused], power=np.zeros_like(seen[accused].power))
    return found


def _claim(one: Seen, output: Output, regime: str, floor: float, p_value: float) -> Claim:
    size = float(np.sqrt(max(float(np.mean(one.power[one.masks[regime]])), 0.0)))
    return Claim(one.source.block, output.column, regime, size, output.unit, size / floor, p_value)


def shares(one: Seen) -> dict[str, tuple[float, float]]:
    """Share of power and of time by regime."""
    total = float(np.sum(one.power))
    return {name: (float(np.sum(one.power[m])) / total, float(np.mean(m))) for name, m in one.masks.items()}


def concentrated(found: Shares) -> list[str]:
    """The regimes of one family in which power is concentrated, [] where it is spread.

    Of each family the densest regimes are taken until they hold most of the power; the family whose set is densest counts. All
    regimes of a family together are no place.
    """
    best: tuple[float, list[str]] = (_DENSER, [])
    for one in _PLACES:
        members = [n for n in found if family(n) == one and found[n][1] > _TINY]
        taken: list[str] = []
        power = time = 0.0
        for name in sorted(members, key=lambda n: -found[n][0] / found[n][1]):
            if power >= _SHARE or found[name][0] < _PART:
                break
            taken.append(name)
            power, time = power + found[name][0], time + found[name][1]
        if taken and len(taken) < len(members) and power >= _SHARE and power / time > best[0]:
            best = power / time, taken
    return best[1]


def significance(seen: Sequence[Seen]) -> dict[tuple[int, str], float]:
    """p-values by number in `seen` and regime, valid for all of them together."""
    columns, keys = [], []
    for i, one in enumerate(seen):
        for name, mask in one.masks.items():
            for tested in one.tested.T:
                columns.append(_clipped(np.bincount(one.block, tested * mask)))
                keys.append((i, name))
    u = np.column_stack(columns)
    size = np.sqrt(np.sum(u**2, axis=0))
    u = u / np.where(size > 0.0, size, 1.0)
    z = np.abs(u.sum(axis=0))
    random = np.random.default_rng(_SEED)
    largest = [
        np.abs((2.0 * random.integers(0, 2, (_CHUNK, len(u))) - 1.0) @ u).max(axis=1) for _ in range(_DRAWS // _CHUNK)
    ]
    drawn = np.sort(np.concatenate(largest))
    p = (1.0 + len(drawn) - np.searchsorted(drawn, z)) / (len(drawn) + 1.0)
    found: dict[tuple[int, str], float] = {}
    for key, value in zip(keys, p, strict=True):
        found[key] = min(found.get(key, 1.0), float(value))
    return found


def _clipped(u: np.ndarray) -> np.ndarray:
    """An odd function of `u`, which keeps the test exact: a few blocks with much of the power are not all that counts."""
    inside = np.abs(u[u != 0.0])
    most = _CLIP * float(np.median(inside)) if len(inside) else 0.0
    return np.clip(u, -most, most)


def gathered(found: Sequence[Source], runs: Sequence[Columns], regimes: Regimes) -> list[Seen]:
    """Sources with the regimes of their samples, the runs one after the other."""
    masks: dict[str, list[np.ndarray]] = {}
    blocks = []
    begin = 0
    for k, run in enumerate(runs):
        n = len(found[0].power[k])
        for name, mask in regimes(run).items():
            masks.setdefault(name, []).append(means(mask.astype(float), run) > 0.5)
        blocks.append(begin + np.arange(n) // max(1, round(_BLOCK / MEAN)))
        begin = int(blocks[-1][-1]) + 1
    whole = {name: np.concatenate(parts) for name, parts in masks.items()}
    whole = {name: mask for name, mask in whole.items() if np.mean(mask) > _TINY}
    block = np.concatenate(blocks)
    return [Seen(one, np.concatenate(one.power), np.concatenate(one.tested), block, whole) for one in found]


def acting(
    model: Model, runs: Sequence[Columns], floors: Values, parameters: Values, effects: Values, candidate: Candidate
) -> list[Claim]:
    """Where a fitted effect acts: regimes in which the difference that it makes is concentrated, in the output that shows it
    best.

    parameters, effects: of the joint fit, `candidate` among them. p-value: as that of a claim, of (measured less simulated
    without it) times what it makes.
    """
    without = {n: v for n, v in effects.items() if n.partition(".")[0] != candidate.name}
    best: tuple[float, list[Source], Output] | None = None
    pairs = [(model.simulate(run, parameters, effects), model.simulate(run, parameters, without)) for run in runs]
    for output in model.outputs:
        c = output.column
        made = [means(one[c] - other[c], run) for (one, other), run in zip(pairs, runs, strict=True)]
        times = float(np.sqrt(np.mean(np.concatenate(made) ** 2))) / floors[c]
        if c in _ANSWERS or (best and times <= best[0]):
            continue
        missing = [means(run[c] - other[c], run) for (_, other), run in zip(pairs, runs, strict=True)]
        tested = [(d * r)[:, None] for d, r in zip(made, missing, strict=True)]
        best = times, [Source(candidate.block, c, [d**2 for d in made], tested, made)], output
    if best is None or not best[0] > 0.0:
        return []
    seen = gathered(best[1], runs, Regimes(model, runs, parameters))
    p_values = significance(seen)
    names = concentrated(shares(seen[0])) or [ALL]
    return [_claim(seen[0], best[2], name, floors[best[2].column], p_values[0, name]) for name in names]


_ANSWERS = ("slip_speed_rad_s",)  # outputs that answer to all others and have no noise to speak of: they tell no place
