"""Selection: which terms a law needs, by the error on stretches of the runs that were not fitted.

Method          from the barest law on, the term is added that explains most of what is left (forward selection); each step is
                judged by cross-validation on contiguous stretches. The simplest step is taken whose held-out error is at most
                one standard error above the best, or 2 %; then terms are left out again by the same rule. The standard error
                is of the paired differences, as the stretches themselves differ more than the models do on them. It alone
                would ask for ever more terms in a motion that repeats, whose stretches are not independent
Assumptions     a stretch is longer than the memory of the contact and of what is not modelled
References      Breiman, Friedman, Olshen and Stone 1984, sec. 3.4.3 (one standard error); Roberts et al. 2017, Ecography 40
                (blocks in place of single samples); Hastie, Tibshirani and Friedman 2009, sec. 7.10
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from clutch_hil.identify.friction.law import EXCLUSIVE, NEEDS, Structure, Values
from clutch_hil.identify.friction.motion_model import MotionModel
from clutch_hil.identify.friction.slide_record import SlideRecord
from clutch_hil.identify.friction.starts import Scale, list_bounds, list_constants, start_values, widen
from plant_sim.friction.identification.least_squares import Estimate, minimise

FOLDS = 5  # of the cross-validation, as is usual
STRETCHES = 10  # held-out stretches, of all records together, at least: enough for a standard error
LEAST_GAIN = 3e-3  # of the squares: a step that explains less ends the search; chosen, far below a standard error
MOST_STEPS = 10  # terms that are added; no law has more
MATERIAL = 1.02  # ratio of held-out errors that no use of a law notices; as in `reproduce microtribometer`
PATIENCE = 2  # steps without a better held-out error that end the search

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Step:
    """A structure that was tried: its `values`, RMS errors [N] on fitted samples and held out, and whether it was `chosen`."""

    structure: Structure
    values: Values
    fitted: float
    held_out: float
    squares: np.ndarray
    chosen: bool = False


def fit_structure(
    structure: Structure,
    records: Sequence[SlideRecord],
    scale: Scale,
    starts: Sequence[Values],
    part: np.ndarray | None = None,
) -> tuple[dict[str, float], Estimate]:
    """Fit a structure from `starts` on the judged samples, of which only those in `part` (bool) if given: all values, estimate.

    Raises InputError.
    """
    model, fixed = MotionModel(structure, records), list_constants(scale, records)
    kept = model.usable if part is None else model.usable & part
    limits = list_bounds(structure, scale)
    estimate = minimise(
        lambda theta: model.compute_residual({**fixed, **dict(zip(structure.names, map(float, theta), strict=True))})[
            kept
        ],
        structure.names,
        np.array([[one[name] for name in structure.names] for one in starts]),
        np.array([limits[name] for name in structure.names]),
        fixed,
    )
    return {**fixed, **dict(zip(structure.names, map(float, estimate.values), strict=True))}, estimate


def select(
    first: Structure,
    offered: Sequence[str],
    most_elements: int,
    records: Sequence[SlideRecord],
    scale: Scale,
    progress: Progress,
) -> list[Step]:
    """The steps from `first` on, by the terms `offered` and more elements up to `most_elements`; one of them is chosen."""
    values, _ = fit_structure(first, records, scale, [start_values(first, scale, records)])
    steps = [judge(first, values, records, scale)]
    while len(steps) <= MOST_STEPS:
        last = steps[-1]
        tried = []
        candidates = _expand(last.structure, offered, most_elements)
        for number, one in enumerate(candidates):
            progress(f"{last.structure}: adding terms", (len(steps) - 1 + number / len(candidates)) / (MOST_STEPS + 1))
            fitted, estimate = fit_structure(one, records, scale, [widen(last.values, one, scale, records)])
            tried.append((estimate.rmse, one, fitted))
        if not tried:
            break
        error, best, fitted = min(tried, key=lambda each: each[0])
        if error**2 > (1.0 - LEAST_GAIN) * _fit_error(last, records) ** 2:
            break
        steps.append(judge(best, fitted, records, scale))
        lowest = int(np.argmin([step.held_out for step in steps]))
        if len(steps) - 1 - lowest >= PATIENCE:
            break
    return _prune(choose(steps), records, scale, progress)


def _prune(steps: list[Step], records: Sequence[SlideRecord], scale: Scale, progress: Progress) -> list[Step]:
    """Leave terms of the chosen step out again that held-out stretches do not need: an early term may stand for a later one."""
    best = min(steps, key=lambda step: float(step.squares.mean()))
    while (chosen := next(step for step in steps if step.chosen)).structure.terms:
        progress(f"{chosen.structure}: removing terms", 0.85)
        tried = []
        for term in chosen.structure.terms:
            kept = tuple(one for one in chosen.structure.terms if term not in (one, NEEDS.get(one)))
            barer = replace(chosen.structure, terms=kept)
            fitted, estimate = fit_structure(barer, records, scale, [widen(chosen.values, barer, scale, records)])
            tried.append((estimate.rmse, barer, fitted))
        _, barer, fitted = min(tried, key=lambda each: each[0])
        step = judge(barer, fitted, records, scale)
        if not _is_as_good(step, best):
            break
        steps = [*(replace(one, chosen=False) for one in steps), replace(step, chosen=True)]
    return steps


def judge(structure: Structure, values: Values, records: Sequence[SlideRecord], scale: Scale) -> Step:
    """Fit `structure` again without each fold of stretches, from `values`, and judge it there."""
    model = MotionModel(structure, records)
    residual = model.compute_residual(values)
    blocks = model.split_blocks(max(STRETCHES // len(records), 2))
    squares = np.empty(len(blocks))
    for fold in range(FOLDS):
        held = blocks[fold::FOLDS]
        part = np.ones(residual.size, bool)
        part[np.concatenate(held)] = False
        own, _ = fit_structure(structure, records, scale, [values], part)
        left = model.compute_residual(own)
        squares[fold::FOLDS] = [float(np.mean(left[block] ** 2)) for block in held]
    sizes = np.array([block.size for block in blocks])
    held_out = float(np.sqrt(np.sum(sizes * squares) / sizes.sum()))
    return Step(structure, values, float(np.sqrt(np.mean(residual**2))), held_out, squares)


def choose(steps: Sequence[Step]) -> list[Step]:
    """`steps`, the simplest first, with the one chosen whose held-out error is as good as the best."""
    best = min(steps, key=lambda step: float(step.squares.mean()))
    chosen = next(step for step in steps if step is best or _is_as_good(step, best))
    return [replace(step, chosen=step is chosen) for step in steps]


def _is_as_good(step: Step, best: Step) -> bool:
    """Whether the held-out error is within a standard error of the best, or immaterially above it."""
    worse = step.squares - best.squares
    if step.held_out <= MATERIAL * best.held_out:
        return True
    return bool(worse.mean() <= worse.std(ddof=1) / np.sqrt(worse.size))


def _fit_error(step: Step, records: Sequence[SlideRecord]) -> float:
    model = MotionModel(step.structure, records)
    return float(np.sqrt(np.mean(model.compute_residual(step.values)[model.usable] ** 2)))


def _expand(structure: Structure, offered: Sequence[str], most_elements: int) -> list[Structure]:
    """Structures with one term more than `structure`, or one load term for the other, or with twice the elements."""
    wider = []
    for term in offered:
        if term not in structure.terms and NEEDS.get(term, term) in (term, *structure.terms):
            kept = (one for one in structure.terms if not {one, term} <= EXCLUSIVE)
            wider.append(replace(structure, terms=(*kept, term)))
    if 0 < 2 * structure.elements <= most_elements:
        wider.append(replace(structure, elements=2 * structure.elements))
    return wider
