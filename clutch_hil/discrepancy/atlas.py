"""Atlas: where model and measurement disagree. A claim gives the block, output, regime, size and p-value of a disagreement.

Size            root of the mean power of a source (sources.py) over a regime: sqrt(rms^2 - floor^2), without the error of the
                floor
Test            u_b: sum of the `tested` values of a source over the samples of a regime in block b of 62 means, clipped
                z = sum u_b/sqrt(sum u_b^2)
                p: share of random signs of the blocks for which the z of any source and regime is as large
Assumptions     the noise of a sensor is correlated over less than 16 ms and is independent of the noise of other sensors; its
                size may change
Choice          regimes belong to families: phase, direction, slip ... The claims are for the regimes of the family in which the
                power is most concentrated, or for "all" where the power is spread
Not modelled    disagreements shorter than 4 ms
References      Canay, Romano and Shaikh 2017, Econometrica 85 (signs of blocks); Romano and Wolf 2005, J. Am. Stat. Assoc. 100
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from clutch_hil.discrepancy.regimes import ALL, Masks, Regimes, find_family
from clutch_hil.discrepancy.result import Claim
from clutch_hil.discrepancy.sources import (
    DRIVE,
    FRICTION,
    HYDRAULICS,
    MOTOR,
    PRESSURE,
    SENSORS,
    TORQUE,
    Source,
    average,
    find_sources,
)
from clutch_hil.fitting.model import Candidate, Columns, Model, Output, Values
from protocols.files.bounds import check_bytes

CLAIM_LEVEL = 0.01  # p-value of a claim: share of the cases without a disagreement in which any claim may be made
REGIME_LEVEL = 0.05  # p-value of each named regime, where one regime is significant at CLAIM_LEVEL
# floors: root of 1.1^2 - 1, because an error within 1.1 floors counts as closed (docs/battery.md)
LEAST_DISAGREEMENT = 0.458
LEAST_IN_PHASE = 1.0  # floors: least size of a claim for one regime only
_SIGN_BLOCK = 62  # means, 0.25 s at 1 kHz: products of residuals further apart than this are independent
_SIGN_DRAWS = 2000  # number of random signs: the smallest p-value is 1/2001
_CLIP = 2.0  # of the median size of u; 5 % less efficient where u is normal (Huber 1981, Robust Statistics, ch. 4)
_DRAWS_AT_ONCE = 250  # number of random signs drawn at once: limits the memory
_MOST_SIGNS = 4_000_000  # signs in memory at once, 64 MB with their products; runs up to 66 min fit all _DRAWS_AT_ONCE
_SEED = 6  # seed of the random signs: the same runs give the same p-values
_POWER_TOGETHER = 0.6  # share of the power that the claimed regimes must contain together ...
_POWER_EACH = 0.1  # ... and that each of them must contain
# Families of operating regimes. Terciles of pressure, slip and temperature are only in gap_by_regime of report.json.
_CLAIMED_FAMILIES = ("phase", "direction", "slip sign")
_LEAST_DENSITY = 1.6  # least ratio of the share of power to the share of time in the claimed regimes
# of the power of the largest claim, in floors: less may come from another block, whose gain is known to 10 %
_ECHO = 0.15
_LEAST_TIME = 1e-3  # of the time: a shorter regime is ignored
Shares = Mapping[str, tuple[float, float]]  # regime -> (share of power, share of time)


@dataclass(frozen=True)
class PooledSource:
    """One source over all runs, concatenated. `power` (n,) and `tested` (n, lags) as in `Source`.

    block: number (n,) of the time block of each sample. masks: by regime, which samples (n,) belong to it.
    """

    source: Source
    power: np.ndarray
    tested: np.ndarray
    block: np.ndarray
    masks: Masks


def find_claims(
    model: Model, runs: Sequence[Columns], floors: Values, parameters: Values, effects: Values
) -> list[Claim]:
    """Return claims on where `model` at `parameters` with `effects` disagrees with `runs`, the largest power first."""
    outputs = {output.column: output for output in model.outputs}
    seen = pool_sources(find_sources(model, runs, floors, parameters, effects), runs, Regimes(model, runs, parameters))
    p_values = compute_p_values(seen)
    by_output: list[tuple[float, list[Claim]]] = []
    for i, one in enumerate(_merge_double_faults(seen, p_values)):
        output = outputs[one.source.column]
        floor = floors[output.column]
        power = {name: float(np.mean(one.power[mask])) / floor**2 for name, mask in one.masks.items()}
        sure = {name for name in one.masks if p_values[i, name] <= CLAIM_LEVEL}
        there = [n for n in sure if power[n] >= LEAST_IN_PHASE**2 and find_family(n) in _CLAIMED_FAMILIES]
        if sure and (power[ALL] >= LEAST_DISAGREEMENT**2 or (there and power[ALL] > 0.0)):
            # keep the disagreement if it is significant at CLAIM_LEVEL, and the regimes that are at REGIME_LEVEL
            names = [
                name for name in find_concentration(compute_power_shares(one)) if p_values[i, name] <= REGIME_LEVEL
            ]
            where = names or [ALL if ALL in sure else max(sure, key=lambda n: power[n] * float(np.mean(one.masks[n])))]
            by_output.append((power[ALL], [_make_claim(one, output, name, floor, p_values[i, name]) for name in where]))
    by_output.sort(key=lambda pair: -pair[0])
    kept: dict[str, list[Claim]] = {}
    for excess, ours in by_output:
        if excess >= _ECHO * by_output[0][0]:
            kept.setdefault(ours[0].block, ours)  # the output of each block that shows the disagreement best
    return [claim for ours in kept.values() for claim in ours]


def _merge_double_faults(seen: Sequence[PooledSource], p_values: Mapping[tuple[int, str], float]) -> list[PooledSource]:
    """Return `seen` with two faults that have the same cause merged into one.

    A fault of the torque sensor changes the re-fitted friction. Drive and sensor then deviate in opposite directions, and only
    the larger deviation is kept. A wrong pressure is assigned to the pressure sensor where the torque of the plates confirms
    it, also for samples with the plates apart, which show nothing.
    """
    number = {(one.source.block, one.source.column): i for i, one in reversed(list(enumerate(seen)))}
    attributed = list(seen)

    def find_gap(block: str, column: str) -> int | None:
        return number.get((block, column))

    friction, sensor, drive = find_gap(FRICTION, TORQUE), find_gap(SENSORS, TORQUE), find_gap(DRIVE, MOTOR)
    if friction is not None and sensor is not None and drive is not None and np.mean(seen[friction].power) < 0.0:
        less = min(sensor, drive, key=lambda i: float(np.mean(seen[i].power)))
        attributed[less] = replace(seen[less], power=np.zeros_like(seen[less].power))
    accused, off = find_gap(SENSORS, PRESSURE), find_gap(HYDRAULICS, PRESSURE)
    if accused is not None and off is not None and p_values[accused, ALL] <= CLAIM_LEVEL:
        judged = seen[accused].power != 0.0
        if np.sum(seen[accused].power) > 0.5 * np.sum(seen[off].power[judged]):
            attributed[off] = replace(seen[off], source=replace(seen[off].source, block=SENSORS))
            attributed[accused] = replace(seen[accused], power=np.zeros_like(seen[accused].power))
    return attributed


def _make_claim(one: PooledSource, output: Output, regime: str, floor: float, p_value: float) -> Claim:
    size = float(np.sqrt(max(float(np.mean(one.power[one.masks[regime]])), 0.0)))
    return Claim(one.source.block, output.column, regime, size, output.unit, size / floor, p_value)


def compute_power_shares(one: PooledSource) -> dict[str, tuple[float, float]]:
    """Return the shares of the power and of the time of a source, by regime."""
    total = float(np.sum(one.power))
    return {name: (float(np.sum(one.power[m])) / total, float(np.mean(m))) for name, m in one.masks.items()}


def find_concentration(shares: Shares) -> list[str]:
    """Return the regimes of one family in which the power is concentrated; [] where it is spread.

    In each family, the regimes of the highest power density are taken until they contain most of the power. The family with the
    densest set is chosen. A set that consists of all regimes of a family does not count.
    """
    best: tuple[float, list[str]] = (_LEAST_DENSITY, [])
    for one in _CLAIMED_FAMILIES:
        members = [n for n in shares if find_family(n) == one and shares[n][1] > _LEAST_TIME]
        taken: list[str] = []
        power = time = 0.0
        for name in sorted(members, key=lambda n: -shares[n][0] / shares[n][1]):
            if power >= _POWER_TOGETHER or shares[name][0] < _POWER_EACH:
                break
            taken.append(name)
            power, time = power + shares[name][0], time + shares[name][1]
        if taken and len(taken) < len(members) and power >= _POWER_TOGETHER and power / time > best[0]:
            best = power / time, taken
    return best[1]


def compute_p_values(seen: Sequence[PooledSource]) -> dict[tuple[int, str], float]:
    """Return p-values by index in `seen` and by regime, corrected for all tests together (family-wise)."""
    columns, keys = [], []
    for i, one in enumerate(seen):
        for name, mask in one.masks.items():
            for tested in one.tested.T:
                columns.append(_clip_outliers(np.bincount(one.block, tested * mask)))
                keys.append((i, name))
    check_bytes("tests of the regimes of these runs need", 2.0 * len(columns) * sum(map(len, columns[:1])) * 8.0)
    u = np.column_stack(columns)
    size = np.sqrt(np.sum(u**2, axis=0))
    u = u / np.where(size > 0.0, size, 1.0)
    z = np.abs(u.sum(axis=0))
    random = np.random.default_rng(_SEED)
    at_once = max(1, min(_DRAWS_AT_ONCE, _MOST_SIGNS // max(len(u), 1)))
    largest = [
        np.abs((2.0 * random.integers(0, 2, (min(at_once, _SIGN_DRAWS - begin), len(u))) - 1.0) @ u).max(axis=1)
        for begin in range(0, _SIGN_DRAWS, at_once)
    ]
    drawn = np.sort(np.concatenate(largest))
    p = (1.0 + len(drawn) - np.searchsorted(drawn, z)) / (len(drawn) + 1.0)
    smallest: dict[tuple[int, str], float] = {}
    for key, value in zip(keys, p, strict=True):
        smallest[key] = min(smallest.get(key, 1.0), float(value))
    return smallest


def _clip_outliers(u: np.ndarray) -> np.ndarray:
    """Clip `u` (blocks,), so that a few blocks do not decide alone. The function is odd, so the sign test stays exact."""
    inside = np.abs(u[u != 0.0])
    most = _CLIP * float(np.median(inside)) if len(inside) else 0.0
    return np.clip(u, -most, most)


def pool_sources(run_sources: Sequence[Source], runs: Sequence[Columns], regimes: Regimes) -> list[PooledSource]:
    """Concatenate the sources of all runs, with the regimes of their samples."""
    masks: dict[str, list[np.ndarray]] = {}
    blocks = []
    begin = 0
    for k, run in enumerate(runs):
        n = len(run_sources[0].power[k])
        for name, mask in regimes(run).items():
            masks.setdefault(name, []).append(average(mask.astype(float), run) > 0.5)
        blocks.append(begin + np.arange(n) // _SIGN_BLOCK)
        begin = int(blocks[-1][-1]) + 1
    whole = {name: np.concatenate(parts) for name, parts in masks.items()}
    whole = {name: mask for name, mask in whole.items() if np.mean(mask) > _LEAST_TIME}
    block = np.concatenate(blocks)
    return [
        PooledSource(one, np.concatenate(one.power), np.concatenate(one.tested), block, whole) for one in run_sources
    ]


def locate_effect(
    model: Model, runs: Sequence[Columns], floors: Values, parameters: Values, effects: Values, candidate: Candidate
) -> list[Claim]:
    """Return claims on where a fitted effect acts: the output that shows it best, in the regimes where it makes a difference.

    parameters, effects: of the joint fit; `candidate` is one of these effects. The p-value is that of the product of two
    signals: measured minus simulated without the effect, and the difference that the effect makes.
    """
    without = {n: v for n, v in effects.items() if n.partition(".")[0] != candidate.name}
    best: tuple[float, list[Source], Output] | None = None
    pairs = [(model.simulate(run, parameters, effects), model.simulate(run, parameters, without)) for run in runs]
    for output in model.outputs:
        c = output.column
        made = [average(one[c] - other[c], run) for (one, other), run in zip(pairs, runs, strict=True)]
        times = float(np.sqrt(np.mean(np.concatenate(made) ** 2))) / floors[c]
        if c in _UNSPECIFIC_OUTPUTS or (best and times <= best[0]):
            continue
        missing = [average(run[c] - other[c], run) for (_, other), run in zip(pairs, runs, strict=True)]
        tested = [(d * r)[:, None] for d, r in zip(made, missing, strict=True)]
        best = times, [Source(candidate.block, c, [d**2 for d in made], tested, made)], output
    if best is None or not best[0] > 0.0:
        return []
    seen = pool_sources(best[1], runs, Regimes(model, runs, parameters))
    p_values = compute_p_values(seen)
    names = find_concentration(compute_power_shares(seen[0])) or [ALL]
    return [_make_claim(seen[0], best[2], name, floors[best[2].column], p_values[0, name]) for name in names]


_UNSPECIFIC_OUTPUTS = ("slip_speed_rad_s",)  # they react to every block, with little noise, so they show no location
