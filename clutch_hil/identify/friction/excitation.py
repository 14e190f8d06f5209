"""Excitation: what the runs cannot say of a friction law, one sentence each, and which terms are therefore not offered."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from clutch_hil.identify.friction.law import Law
from clutch_hil.identify.friction.slide_record import SlideRecord
from clutch_hil.identify.friction.starts import SLIDING_SHARE, Scale
from clutch_hil.recordings.checks.knowledge import Knowledge, Recorded
from clutch_hil.recordings.checks.values import find_saturated
from protocols.errors import InputError

SLOWEST = 0.01  # of the greatest speed: a Stribeck curve is looked for down to it; chosen, two decades
BINS = 8  # of the speeds from there to the greatest, by logarithm
# Of the sliding samples in a bin that counts as excited. Chosen: on the way to its speed a trapezoid leaves less in a slow bin
LEAST_SHARE = 0.02
LEAST_BINS = 5  # excited bins for a Stribeck curve: it has five parameters
LOAD_RATIO = 1.3  # of greatest and least load for a load law; chosen: its fall then changes friction by some per cent
LEAST_STEPS = 3.0  # samples within a break point, for pre-sliding to be resolved


def find_excited(law: Law, records: Sequence[SlideRecord], scale: Scale) -> tuple[list[str], list[str]]:
    """Terms of `law` and of the rig that the records excite, and warnings of those they do not. Raises InputError."""
    length = records[0].units[0]
    speed = np.abs(np.concatenate([one.speed for one in records]))
    slides = speed > SLOWEST * scale.speed
    spread = float(np.std(speed[slides])) / scale.speed
    turns = count_reversals(records)
    terms, warnings = list(law.terms), []
    if not turns and spread < 0.01:  # 1 %: chosen, the ripple of a speed loop
        raise InputError(
            f"the speed is constant at {scale.speed:.3g} {length}/s: at one speed, friction is a single number, not a"
            " law; different speeds or reversals are needed"
        )
    if not turns:
        warnings.append(
            "no reversal: these runs show neither pre-sliding nor an offset; the break points are not valid"
        )
    edges = np.geomspace(SLOWEST * scale.speed, scale.speed, BINS + 1)
    # by friction, not by inertia
    ruled = scale.mass * np.abs(np.concatenate([one.acceleration for one in records])) < scale.level
    share = np.histogram(speed[ruled], edges)[0] / max(int(slides.sum()), 1)
    if np.sum(share > LEAST_SHARE) < LEAST_BINS and "stribeck" in terms:
        seen = speed[ruled & (speed > SLIDING_SHARE * scale.speed)]
        low, high = np.quantile(seen, (0.05, 0.95)) if seen.size else (0.0, 0.0)
        warnings.append(
            f"a Stribeck curve needs speeds over two decades at which inertia does not hide the friction; these runs have "
            f"{f'{low:.3g} to {high:.3g} {length}/s' if seen.size else 'none'}: beta, V_S, gamma and lag are not fitted"
        )
        terms = [term for term in terms if term not in ("stribeck", "exponent", "lag")]
    rigid = ["offset", "mass", "delay"] if turns else ["mass"]
    load_terms, load_warnings = _judge_load(law, records)
    warnings += load_warnings
    if not load_terms:
        terms = [term for term in terms if term not in ("fall", "preload", "level_asymmetry")]
    rigid += load_terms
    if not turns:
        terms = [term for term in terms if term not in ("viscous_asymmetry", "level_asymmetry", "shape")]
    return [*rigid, *terms], [*warnings, *_describe_saturated(records)]


def _describe_saturated(records: Sequence[SlideRecord]) -> list[str]:
    """Sentences of forces and loads that rest at an end; a command at its limit does so, too, so that it is only told."""
    sentences = []
    for one in records:
        columns = {"time_s": one.period * np.arange(one.size), "force": one.force, "load": one.load}
        known = {"force": Knowledge(one.units[1]), "load": Knowledge(one.units[2])}
        sentences += [
            str(replace(finding, run=one.source)) for finding in find_saturated(Recorded(one.source, columns, known))
        ]
    return sentences


def _judge_load(law: Law, records: Sequence[SlideRecord]) -> tuple[list[str], list[str]]:
    """Terms of the rig that a varying load excites, none where it is constant; and warnings. Raises InputError."""
    unit = records[0].units[2]
    if not unit:
        if law.knows_load:
            raise InputError(
                f"law {law.name} needs the load, and the runs have no column with a known name for it; give it with"
                " --load, or use gms"
            )
        return [], []
    load = np.concatenate([one.load for one in records])
    low, high = (float(value) for value in np.quantile(load, (0.02, 0.98)))
    if not np.any(load):
        if law.knows_load:
            raise InputError(
                f"law {law.name} needs the load, and it is 0 {unit} throughout; give another column with --load, or use gms"
            )
        return [], []
    if high > LOAD_RATIO * low:
        known = [f"the load goes from {low:.4g} to {high:.4g} {unit}, but {law.name} has no load: use xgms"]
        return ["load_gain"], [] if law.knows_load else known
    constant = [
        f"the load is {low:.4g} to {high:.4g} {unit}: friction is taken as proportional to it, which is not identified"
    ]
    return [], constant if law.knows_load else []


def count_reversals(records: Sequence[SlideRecord]) -> int:
    """Changes of the direction of sliding in all records."""
    count = 0
    for one in records:
        fast = np.abs(one.speed) > SLIDING_SHARE * float(np.quantile(np.abs(one.speed), 0.995))
        count += int(np.sum(np.diff(np.sign(one.speed[fast])) != 0.0))
    return count


def judge_break_points(break_points: Sequence[float], records: Sequence[SlideRecord], length: str) -> list[str]:
    """Warn of `break_points` [m] (n,) that the samples do not resolve."""
    steps = [np.abs(np.diff(one.path)) for one in records]
    slow = float(np.median(np.concatenate([step[step > 0.0] for step in steps])))
    least = min(break_points)
    at_turns = min(float(np.quantile(step[step > 0.0], 0.05)) for step in steps)
    if least < LEAST_STEPS * at_turns:
        return [
            f"pre-sliding is not resolved: a break point is at {least:.3g} {length}, and the position moves {slow:.3g} "
            f"{length} a sample ({at_turns:.3g} where it is slow); use slower strokes, or a faster sampling"
        ]
    return []
