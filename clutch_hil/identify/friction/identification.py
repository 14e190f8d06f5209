"""Identification of friction: records to a law, its terms by held-out stretches, its values by simulation error.

Method          1. size of the records, and what they excite              starts.py, excitation.py
                2. terms and elements by forward selection                selection.py
                3. the chosen law from several starts, and its intervals  intervals.py
References      Janssens 2010, sec. 5.8 and app. D; Janot, Gautier and Brunot 2019
"""

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from math import nan
from pathlib import Path

import numpy as np

from clutch_hil.bench.arguments import take_function, take_list, take_name, take_number, take_runs, take_whole
from clutch_hil.identify.friction.excitation import find_excited, judge_break_points
from clutch_hil.identify.friction.intervals import compute_intervals
from clutch_hil.identify.friction.law import EXCLUSIVE, NEEDS, PARAMETERS, RIGID, Law, Structure, Values, find_law
from clutch_hil.identify.friction.motion_model import MotionModel
from clutch_hil.identify.friction.result import IdentifiedFriction, Parameter, TriedStep, UsedRun
from clutch_hil.identify.friction.selection import Progress, Step, fit_structure, judge, select
from clutch_hil.identify.friction.slide_record import Columns, SlideRecord, read_records
from clutch_hil.identify.friction.starts import Scale, list_bounds, list_constants, measure_scale, start_values
from clutch_hil.recordings.checks.finding import refuse_hard
from clutch_hil.recordings.checks.repeated import find_repeated
from clutch_hil.recordings.import_map import load_map
from clutch_hil.recordings.rasters import Sampling
from plant_sim.friction.identification.least_squares import Estimate
from protocols.errors import InputError, suggest_closest
from protocols.files.run import Run

MOST_ELEMENTS = 8  # that a selection tries; 4 are nearly as good as 10 (Janssens 2010, sec. 5.5)
SPREAD = 1.0  # standard deviation of the logarithm of a start about the best value known: a factor of e
SAME_MINIMUM = 1.005  # ratio of RMS errors that count as one minimum
WIDE = 1.0  # half an interval over its value: the data do not say even the sign


def _ignore(what: str, share: float) -> None:
    """Show no progress."""


def identify_friction(
    runs: Sequence[Path | str | Run] | Path | str | Run,
    law: str,
    *,
    holdout: Sequence[Path | str | Run] = (),
    position: str = "",
    force: str = "",
    load: str = "",
    speed: str = "",
    time: str = "",
    map_name: str | None = None,
    low_pass: float = 0.0,
    rate: float = 0.0,
    elements: int | None = None,
    terms: Sequence[str] | None = None,
    starts: int = 8,
    seed: int = 0,
    rig: str = "",
    progress: Progress = _ignore,
) -> IdentifiedFriction:
    """Identify the friction `law` of a rig: stribeck, maxwell-slip, gms, xgms or lugre.

    runs: files, or runs in memory, with position (or speed), force, and load where it varies. Columns are recognised by name,
    or named `COLUMN` or `COLUMN:UNIT`; `map_name` reads foreign files by an import map. `low_pass` [Hz] filters all of them
    alike without delay, `rate` [Hz] resamples; 0 leaves them as they are. holdout: runs that are judged, not fitted.

    `elements` and `terms` fix the law; if None, held-out stretches decide. `starts` searches, spread by `seed`. `progress(what,
    share)`. Raises InputError.
    """
    chosen, progress = find_law(take_name("law", law)), take_function("progress", progress)
    given, judging = take_runs("runs", runs), take_runs("holdout", holdout)
    named = {"position": position, "force": force, "load": load, "speed": speed, "time": time}
    columns = Columns(**{what: take_name(what, name) for what, name in named.items()})
    own_map = load_map(take_name("map_name", map_name)) if map_name else None
    low_pass, rate = take_number("low-pass", low_pass), take_number("rate", rate)
    for name, value in (("low-pass", low_pass), ("rate", rate)):
        if not 0.0 <= value < np.inf:
            raise InputError(f"{name} is {value:g} Hz; allowed is 0 or more")
    starts, seed, rig = take_whole("number of starts", starts, 1), take_whole("seed", seed, 0), take_name("rig", rig)
    elements = None if elements is None else take_whole("number of elements", elements, 1)
    terms = None if terms is None else [take_name("terms", term) for term in take_list("terms", terms)]
    sampling = Sampling(low_pass, rate, low_pass_name="low-pass")
    records = read_records(given, columns, own_map, sampling)
    held = read_records(judging, columns, own_map, sampling) if judging else []
    if held and held[0].units != records[0].units:
        raise InputError("held-out runs have other quantities than the fitted ones; allowed are runs of one rig")
    names = [*(one.source for one in records), *(f"{one.source}, held out" for one in held)]
    slides = [{"position": one.position, "force": one.force, "load": one.load} for one in (*records, *held)]
    refuse_hard(find_repeated([*zip(names, slides, strict=True)]), "")
    first = _choose_first_structure(chosen, elements, terms)  # before anything is computed: names may be wrong
    scale = measure_scale(records)
    offered, warnings = find_excited(chosen, records, scale)
    if "load_gain" in first.terms and scale.load == 0.0:
        raise InputError("term 'load_gain' is given, but the load is 0 throughout; leave it out, or give another load")
    if terms is None:
        most = elements or MOST_ELEMENTS
        steps = select(first, offered, most, records, scale, progress)
    else:
        values, _ = fit_structure(first, records, scale, [start_values(first, scale, records)])
        steps = [replace(judge(first, values, records, scale), chosen=True)]
    step = next(one for one in steps if one.chosen)
    progress(f"{step.structure}: searching from {starts} starts", 0.9)
    values, estimate, agree = _search(step, records, scale, starts, seed, progress)
    progress("intervals", 0.99)
    return _make_result(step.structure, values, estimate, agree, steps, records, held, scale, warnings, rig)


def _choose_first_structure(law: Law, elements: int | None, terms: Sequence[str] | None) -> Structure:
    """The barest structure of `law`, or the one that the user fixed. Raises InputError."""
    if elements is not None and not law.elements:
        raise InputError(f"law {law.name} has no elements, but {elements} were requested")
    if elements is not None and not 1 <= elements <= 20:  # 20: twice the most of the thesis
        raise InputError(f"number of elements is {elements}; allowed is 1 to 20")
    allowed = (*RIGID, *law.terms)
    for term in terms or ():
        if term not in PARAMETERS:
            raise InputError(f"term {term!r} is unknown; {suggest_closest(term, allowed)}")
        if term not in allowed:
            raise InputError(f"law {law.name} has no term {term!r}; it has {', '.join(allowed)}")
    if set(terms or ()) >= EXCLUSIVE:
        raise InputError("terms fall and preload were both given; only one of them is allowed")
    for term in terms or ():
        if (needed := NEEDS.get(term, term)) not in (terms or ()):
            raise InputError(f"term {term!r} needs {needed!r} as well; add it, or leave {term!r} out")
    return Structure(law, elements or (law.elements[0] if law.elements else 0), tuple(dict.fromkeys(terms or ())))


def _search(
    step: Step, records: Sequence[SlideRecord], scale: Scale, starts: int, seed: int, progress: Progress
) -> tuple[dict[str, float], Estimate, tuple[int, int]]:
    """The best of several searches from points about the values known, its elements in order, and how many agree with it."""
    structure, random = step.structure, np.random.default_rng(seed)
    limits = list_bounds(structure, scale)
    fits = []
    for number in range(starts):
        start = dict(step.values)
        if number:
            for name in structure.names:
                low, high = limits[name]
                spread = start[name] * float(np.exp(SPREAD * random.standard_normal()))
                margin = 1e-6 * (high - low)
                start[name] = float(np.clip(spread, low + (margin if low < 0.0 else 0.0), high - margin))
        fits.append(fit_structure(structure, records, scale, [start]))
        progress(f"{structure}: start {number + 1} of {starts}", 0.9 + 0.07 * number / starts)
    known, best = fits[0], min(fits, key=lambda one: one[1].rmse)
    if best[1].rmse * SAME_MINIMUM < known[1].rmse:  # another minimum: it must explain what is not fitted, too
        progress("judging another minimum", 0.97)
        if judge(structure, best[0], records, scale).held_out > step.held_out:
            best = known
    same = sum(abs(one[1].rmse / best[1].rmse - 1.0) <= SAME_MINIMUM - 1.0 for one in fits)
    values, estimate = fit_structure(structure, records, scale, [_sort_elements(structure, best[0])])
    return values, estimate, (same, starts)


def _sort_elements(structure: Structure, values: Values) -> dict[str, float]:
    """`values` with the elements in the order of their break points."""
    numbers = range(1, structure.elements + 1)
    order = sorted(numbers, key=lambda i: values[f"break_point_{i}"])
    moved: dict[str, float] = {}
    for i, j in zip(numbers, order, strict=True):
        moved |= {f"{what}_{i}": values[f"{what}_{j}"] for what in ("limit", "break_point")}
    return {**values, **moved}


def _make_result(
    structure: Structure,
    values: Values,
    estimate: Estimate,
    agree: tuple[int, int],
    steps: Sequence[Step],
    records: Sequence[SlideRecord],
    held: Sequence[SlideRecord],
    scale: Scale,
    warnings: Sequence[str],
    rig: str,
) -> IdentifiedFriction:
    model = MotionModel(structure, records)
    residual = model.compute_residual(values)
    used = [block[model.usable[block]] for block in model.split_blocks(1)]
    limits = list_bounds(structure, scale)
    bound = np.array([limits[name] for name in structure.names])
    spans, correlation = compute_intervals(estimate, bound, [residual[one] for one in used])
    units = records[0].units
    parameters = tuple(
        Parameter(name, values[name], float(low), float(high), find_unit(name, units, values))
        for name, (low, high) in zip(structure.names, spans, strict=True)
    )
    doubts = [*warnings, *_describe_doubt(parameters)]
    if structure.elements:
        points = [values[f"break_point_{i}"] for i in range(1, structure.elements + 1)]
        doubts += judge_break_points(points, records, units[0])
    elif values.get("beta", 1.0) > 1.0 and structure.law.centred:
        doubts.append(
            "friction rises from rest: with a law without memory, pre-sliding looks like this; compare with gms or lugre"
        )
    if agree[1] > 1 and agree[0] == 1:
        doubts.append(f"one of {agree[1]} starts ended at this minimum: another may be better, try more --starts")
    chosen = next(step for step in steps if step.chosen)
    errors = {"fitted": float(np.sqrt(np.mean(residual**2))), "held_out": chosen.held_out, "held_out_runs": nan}
    if held:
        left = MotionModel(structure, held).compute_residual(values)
        errors["held_out_runs"] = float(np.sqrt(np.mean(left**2)))
    return IdentifiedFriction(
        structure=structure,
        parameters=parameters,
        constants={name: values[name] for name in list_constants(scale, records)},
        correlation=correlation,
        errors=errors,
        units=units,
        starts=agree,
        steps=tuple(
            TriedStep(str(one.structure), len(one.structure.names), one.fitted, one.held_out, one.chosen)
            for one in steps
        ),
        runs=(
            *(UsedRun(one.source, one.digest, "fitted") for one in records),
            *(UsedRun(one.source, one.digest, "held out") for one in held),
        ),
        warnings=tuple(doubts),
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        rig=rig,
    )


def _describe_doubt(parameters: Sequence[Parameter]) -> list[str]:
    """One sentence for each parameter that the runs do not determine."""
    doubts = []
    for one in parameters:
        half = 0.5 * (one.high - one.low)
        if not np.isfinite(half):
            doubts.append(f"{one.name} rests at its bound {one.value:.4g} {one.unit}: these runs do not determine it")
        elif half > WIDE * abs(one.value) and one.name not in ("offset", "delay", "load_gain"):
            doubts.append(f"{one.name} is poorly determined: {one.value:.3g} +- {half:.2g} {one.unit}")
    return doubts


def find_unit(name: str, units: tuple[str, str, str], values: Values) -> str:
    """SI unit of a parameter; `units` of position, force and load."""
    length, force, load = units
    speed = f"{length}/s"
    exponent = values.get("exponent", 1.0)
    stem = name.rstrip("0123456789").rstrip("_")
    return {
        "limit": force, "static_force": force, "break_point": length, "stiffness": f"{force}/{length}",
        "viscous": f"{force}/({speed})" if exponent == 1.0 else f"{force}/({speed})^{exponent:.4g}",
        "stribeck_velocity": speed, "attraction": "1/s", "damping": f"{force}/({speed})", "load_scale": load, "preload": load,
        "mass": "kg" if length == "m" else "kg m^2", "offset": force, "delay": "s", "load_gain": f"{force}/{load}",
    }.get(stem, "1")  # fmt: skip
