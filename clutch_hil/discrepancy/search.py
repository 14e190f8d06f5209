"""Search: the whole workflow, from runs to a `Result`.

Steps: estimate the noise floor, select the missing effects, measure the gap on held-out runs, locate the disagreement, and
propose an experiment where effects cannot be distinguished.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from clutch_hil.discrepancy.atlas import find_claims, locate_effect
from clutch_hil.discrepancy.decision import CALIBRATION_CONFIDENCE, DISAGREEMENT, LEAST_CLOSED, NONE_CONFIDENCE
from clutch_hil.discrepancy.experiment_design import propose
from clutch_hil.discrepancy.held_out import DOUBTFUL_CONFIDENCE, fit_without_each, measure_gaps, note_open_gap
from clutch_hil.discrepancy.identify_first import look_for_calibration, note_limits, note_rest
from clutch_hil.discrepancy.memory import check_memory
from clutch_hil.discrepancy.recalibration import Recalibration
from clutch_hil.discrepancy.residual_statistics import compute_statistics
from clutch_hil.discrepancy.result import (
    IDENTIFY_FIRST,
    NAMED,
    NONE_OF_THESE,
    NOTHING,
    ONE_OF,
    Claim,
    Estimate,
    Result,
    Rival,
    Trace,
)
from clutch_hil.discrepancy.selection import EffectSelection, Progress
from clutch_hil.discrepancy.surrogate_term import describe_residual
from clutch_hil.discrepancy.unlike_runs import compute_powers, describe_held_out, note_unlike
from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import LinearModel
from clutch_hil.fitting.model import Candidate, Columns, Evident, Model, Values, Witnessing
from clutch_hil.fitting.noise import estimate_floors
from protocols.errors import InputError, suggest_closest


def investigate(
    model: Model,
    runs: Mapping[str, Columns],
    held_out: Mapping[str, Columns] | None = None,
    names: Sequence[str] | None = None,
    progress: Progress = lambda what, share: None,
) -> Result:
    """Find what `model` lacks to explain `runs` (by file or name). `names` restricts the candidates.

    Without `held_out` runs, whole runs are left out in turn. Raises InputError.
    """
    started = time.perf_counter()
    candidates = _choose_candidates(model, names)
    progress("noise floor", 0.0)
    held = dict(held_out or {})
    if runs:
        check_memory(model, list(runs.values()), list(held.values()))
    floors = estimate_floors([*runs.values(), *held.values()], model.outputs)
    seen = model.find_evident_effects(list(runs.values())) if isinstance(model, Witnessing) else {}
    evident = {c: seen[c.name] for c in candidates if c.name in seen}
    rounding = {column: rms for one in evident.values() for column, rms in one.rounding.items()}
    evidence = Evidence(model, list(runs.values()), floors, rounding)
    selection = EffectSelection(model, evidence, [c for c in candidates if c not in evident], progress)
    selection.run()
    found = _conclude(selection, evidence, runs, held, evident, progress)
    verdict, notes = found.verdict, found.notes
    baseline = selection.estimate_parameters(effects=False)
    notes += note_limits(model, baseline, found.recalibration)
    rivals = selection.judge_rivals()
    if found.recalibration and verdict == IDENTIFY_FIRST:
        rivals = [_refuse_for(found.recalibration, rival) for rival in rivals]
    if found.recalibration:
        notes += note_rest(found.recalibration, verdict in (NAMED, ONE_OF))
    progress("gap on runs that were not fitted", 0.85)
    evidence, before, after = selection.evidence, selection.fits.base, selection.final
    points = [(before.point, after.point)] * len(runs) if held else fit_without_each(evidence, before, after)
    surrogate: dict[str, Any] | None = None
    if found.held_out_alone:
        surrogate = {"sentence": found.held_out_alone, "values": {}}
    elif verdict == NONE_OF_THESE:
        progress("shape of the residual", 0.9)
        surrogate, after, points = _fit_surrogate(evidence, before, points, floors, bool(held))
    traces = _make_traces(model, runs, held, [*points, *([(before.point, after.point)] * len(held))])
    judged = [t for t in traces if t.held_out or not held]
    gap, by_regime = measure_gaps(model, judged, floors)
    confidence = found.confidence
    if verdict in (NAMED, ONE_OF) and not evident and (doubts := note_open_gap(gap)):
        notes += doubts
        confidence = min(confidence, DOUBTFUL_CONFIDENCE)
    progress("regimes of the disagreement", 0.9)
    where = find_claims(model, list((held if found.held_out_alone else runs).values()), floors, *before.point)
    if verdict in (NAMED, ONE_OF):
        where = _locate_effects(evidence, after.point, floors, selection.named, evident) or where
    proposed = None
    if verdict == ONE_OF:
        progress("experiment that separates the alternatives", 0.95)
        options = [selection.values[name] for name in found.alternatives[0]]
        proposed = propose(model, after.point[0], options, floors)
    progress("done", 1.0)
    return Result(
        rig=model.name,
        verdict=verdict,
        effects=found.effects,
        alternatives=found.alternatives,
        confidence=confidence,
        where=where,
        parameters=[*selection.estimate_parameters(effects=True), *_list_evident_estimates(evident)]
        if verdict in (NAMED, ONE_OF)
        else [],
        baseline=baseline,
        recalibration=found.recalibration,
        gap=gap,
        gap_by_regime=by_regime,
        rivals=[*(Rival(c.name, 1.0, 0.0, {}, "", 1) for c in evident), *rivals],
        surrogate=surrogate,
        experiment=proposed,
        floors=floors,
        units={o.column: o.unit for o in model.outputs},
        equations={c.name: c.equation for c in (*selection.named, *evident)}
        | selection.collect_equations(found.alternatives),
        hashes={},
        seconds=time.perf_counter() - started,
        held_out="given" if held else "in turn",
        notes=notes,
        atlas=compute_statistics(model, list(runs.values()), floors, *before.point),
        traces=traces,
    )


@dataclass(frozen=True)
class _Conclusion:
    """The verdict, with the effects or the alternatives that it names, and the notes that explain it.

    held_out_alone: the sentence on a disagreement that only held-out runs have, else "".
    """

    verdict: str
    effects: list[str]
    alternatives: list[list[str]]
    confidence: float
    recalibration: Recalibration | None
    notes: list[str]
    held_out_alone: str


def _conclude(
    selection: EffectSelection, evidence: Evidence, runs: Mapping[str, Columns], held: Mapping[str, Columns],
    evident: Mapping[Candidate, Evident], progress: Progress,
) -> _Conclusion:  # fmt: skip
    """Return the conclusion from the selected effects, a re-calibration, the `evident` effects and the `held` runs.

    Effects that do not explain enough are dropped from `selection`.
    """
    model = evidence.model
    verdict, effects, alternatives = selection.decide()
    recalibration = None
    if verdict != NOTHING:
        progress("a calibration beyond the stated uncertainty", 0.82)
        named = 0 if verdict == NONE_OF_THESE else len(selection.named)
        recalibration = look_for_calibration(
            evidence, selection.fits.base, selection.final.point, named == 1, named > 1 or verdict == ONE_OF
        )
    if evident and selection.explanation.is_negligible:
        verdict, effects, alternatives = NOTHING, [], []  # a coarse converter alone leaves as much
    elif recalibration and recalibration.explains:
        verdict, effects, alternatives = IDENTIFY_FIRST, [], []
    notes = []
    if verdict == NONE_OF_THESE and (bounded := selection.list_at_bounds()):
        notes.append(
            f"{' and '.join(c.name for c in selection.named)} would explain the disagreement best, but {' and '.join(bounded)}"
            f" {'rests at its bound' if len(bounded) == 1 else 'rest at their bounds'}, so this is not accepted"
        )
    if verdict not in (NAMED, ONE_OF):
        selection.drop_effects()  # the effects do not explain enough
    if evident and verdict not in (NONE_OF_THESE, IDENTIFY_FIRST):
        verdict = verdict if verdict == ONE_OF else NAMED
        effects = [*(c.name for c in evident), *effects]
    confidence = CALIBRATION_CONFIDENCE if verdict == IDENTIFY_FIRST else selection.confidence
    held_out_alone, at = "", selection.final.point
    powers = compute_powers(model, list(runs.values()), at, evidence.floors, evidence.rounding)
    if verdict == NONE_OF_THESE:
        notes += note_unlike(list(runs), powers)
    if held and not np.any(powers > DISAGREEMENT):
        held_powers = compute_powers(model, list(held.values()), at, evidence.floors, evidence.rounding)
        unseen = describe_held_out(model, held, held_powers, at, evidence.floors)
        if unseen and verdict == NOTHING:
            verdict, confidence, held_out_alone = NONE_OF_THESE, NONE_CONFIDENCE, unseen
        elif unseen:
            notes.append(unseen)
    notes += [f"{c.name} is evident without a fit: {one.why}" for c, one in evident.items()]
    if selection.reading:
        notes.append(f"the baseline alone fits these runs better where {selection.reading}")
    return _Conclusion(verdict, effects, alternatives, confidence, recalibration, notes, held_out_alone)


def _fit_surrogate(
    evidence: Evidence, before: LinearModel, points: Sequence[tuple[Point, Point]], floors: Values, held: bool
) -> tuple[dict[str, Any], LinearModel, list[tuple[Point, Point]]]:
    """Describe the residual of the baseline by a surrogate, see `describe_residual`.

    Return the surrogate, without values if it does not fit better; the model with it; and `points`, before and after of each
    run, with it. held: whether runs are held out, so that none is left out in turn.
    """
    surrogate = describe_residual(evidence.model, evidence.runs, floors, *before.point)
    after = _add_surrogate(evidence, before, surrogate["values"])
    if after is before:
        return {**surrogate, "values": {}}, after, list(points)
    if held:
        return surrogate, after, [(before.point, after.point)] * len(points)
    return surrogate, after, [
        (own, _add_surrogate_of_others(evidence, own, k, floors)) for k, (own, _) in enumerate(points)
    ]  # fmt: skip


def _locate_effects(
    evidence: Evidence, at: Point, floors: Values, named: Sequence[Candidate], evident: Mapping[Candidate, Evident]
) -> list[Claim]:
    """Return claims on where the effects act: the largest in each block, output and regime; largest first."""
    shown = {n: values[0] for one in evident.values() for n, values in one.intervals.items()}
    point = at[0], {**at[1], **shown}
    acts = [
        claim for c in (*named, *evident) for claim in locate_effect(evidence.model, evidence.runs, floors, *point, c)
    ]
    largest = {(c.block, c.output, c.regime): c for c in sorted(acts, key=lambda claim: claim.size)}
    return sorted(largest.values(), key=lambda claim: -claim.times_floor)


def _choose_candidates(model: Model, names: Sequence[str] | None) -> list[Candidate]:
    known = {c.name: c for c in model.candidates}
    for name in names or []:
        if name not in known:
            raise InputError(
                f"effect {name!r} is not a candidate of the rig {model.name}; {suggest_closest(name, known)}"
            )
    return [known[n] for n in dict.fromkeys(names)] if names else list(model.candidates)


def _refuse_for(recalibration: Recalibration, rival: Rival) -> Rival:
    """Return a rival that closes enough to be named, with the reason that a calibration explains more."""
    if rival.closed < LEAST_CLOSED[0]:
        return rival
    reason = f"closes {rival.closed:.1%} of the gap where another calibration closes {recalibration.closed:.1%}"
    return replace(rival, reason=reason)


def _list_evident_estimates(evident: Mapping[Candidate, Evident]) -> list[Estimate]:
    """Return the parameters of effects that the recorded values show without any fit."""
    declared = {n: p for c in evident for n, p in c.declare_parameters().items()}
    return [
        Estimate(n, value, declared[n].unit, (low, high), declared[n].value, 0.0)
        for one in evident.values()
        for n, (value, low, high) in one.intervals.items()
    ]


def _add_surrogate(evidence: Evidence, before: LinearModel, values: Values) -> LinearModel:
    """Return `before` with a surrogate of these values, or `before` itself if there are none or they do not fit better."""
    if not values:
        return before
    point: Point = before.point[0], {**before.point[1], **values}
    after = replace(before, point=point, residual=evidence.compute_residuals([point])[0])
    return after if after.cost < before.cost else before


def _add_surrogate_of_others(evidence: Evidence, own: Point, left: int, floors: Values) -> Point:
    """Return the point of the left-out run `left`: its parameters `own`, and a surrogate fitted to the other runs."""
    others = [run for k, run in enumerate(evidence.runs) if k != left]
    surrogate = describe_residual(evidence.model, others, floors, *own) if others else {"values": {}}
    return own[0], {**own[1], **surrogate["values"]}


def _make_traces(
    model: Model, runs: Mapping[str, Columns], held: Mapping[str, Columns], points: Sequence[tuple[Point, Point]]
) -> list[Trace]:
    traces = []
    for k, ((name, run), (first, last)) in enumerate(zip([*runs.items(), *held.items()], points, strict=True)):
        traces.append(
            Trace(
                name, name in held and k >= len(runs), dict(run), {o.column: run[o.column] for o in model.outputs},
                dict(model.simulate(run, *first)), dict(model.simulate(run, *last)),
            )
        )  # fmt: skip
    return traces
