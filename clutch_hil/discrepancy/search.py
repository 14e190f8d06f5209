"""Search: the workflow from runs to a result - floor, re-fit, where, what, decision, again, held-out gap."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

from clutch_hil.discrepancy.atlas import acting, claims
from clutch_hil.discrepancy.atlas_numbers import atlas_numbers
from clutch_hil.discrepancy.evidence import Evidence, Point
from clutch_hil.discrepancy.experiment import propose
from clutch_hil.discrepancy.fit import Linear
from clutch_hil.discrepancy.held_out import gaps, left_out
from clutch_hil.discrepancy.inquiry import Inquiry, Progress
from clutch_hil.discrepancy.model import Candidate, Columns, Evident, Model, Values, Witnessing
from clutch_hil.discrepancy.noise import floors
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, NOTHING, ONE_OF, Estimate, Result, Rival, Trace
from clutch_hil.discrepancy.surrogate_term import described
from protocols.errors import InputError, closest


def investigate(
    model: Model,
    runs: Mapping[str, Columns],
    held_out: Mapping[str, Columns] | None = None,
    names: Sequence[str] | None = None,
    progress: Progress = lambda what, share: None,
) -> Result:
    """What is missing in `model` to explain `runs` (by file or name). `names` restricts the candidates.

    Without `held_out` runs, whole runs are left out in turn. Raises InputError.
    """
    started = time.perf_counter()
    candidates = _chosen(model, names)
    progress("noise floor", 0.0)
    held = dict(held_out or {})
    found = floors([*runs.values(), *held.values()], model.outputs)
    seen = model.evident(list(runs.values())) if isinstance(model, Witnessing) else {}
    evident = {c: seen[c.name] for c in candidates if c.name in seen}
    rounding = {column: rms for one in evident.values() for column, rms in one.rounding.items()}
    evidence = Evidence(model, list(runs.values()), found, rounding)
    inquiry = Inquiry(model, evidence, [c for c in candidates if c not in evident], progress)
    inquiry.run()
    verdict, effects, alternatives, notes = inquiry.verdict()
    if evident and inquiry.weighed.slight:
        verdict, effects, alternatives = NOTHING, [], []  # a poor converter's own law leaves as much
    if verdict not in (NAMED, ONE_OF):
        inquiry.drop()  # what does not explain enough is not in the model
    if evident and verdict != NONE_OF_THESE:
        verdict = verdict if verdict == ONE_OF else NAMED
        effects = [*(c.name for c in evident), *effects]
    notes += [f"{c.name} is evident without any fit: {one.why}" for c, one in evident.items()]
    if inquiry.reading:
        notes.append(f"the runs are those of a rig in which {inquiry.reading}")
    progress("gap on runs that were not fitted", 0.85)
    evidence, before, after = inquiry.evidence, inquiry.base, inquiry.final
    points = [(before.point, after.point)] * len(runs) if held else left_out(evidence, before, after)
    surrogate = proposed = None
    if verdict == NONE_OF_THESE:
        progress("what shape the rest has", 0.9)
        surrogate = described(model, evidence.runs, found, *before.point)
        after = _carrying(evidence, before, surrogate["values"])
        if after is before:
            surrogate["values"] = {}  # what does not help is not in the model
        elif held:
            points = [(before.point, after.point)] * len(runs)
        else:
            points = [(own, _carrying_others(evidence, own, k, found)) for k, (own, _) in enumerate(points)]
    traces = _traces(model, runs, held, [*points, *([(before.point, after.point)] * len(held))])
    judged = [t for t in traces if t.held_out or not held]
    gap, by_regime = gaps(model, judged, found)
    progress("where they disagree", 0.9)
    where = claims(model, list(runs.values()), found, *before.point)
    if verdict in (NAMED, ONE_OF):
        shown = {n: values[0] for one in evident.values() for n, values in one.intervals.items()}
        point = after.point[0], {**after.point[1], **shown}
        acts = [claim for c in (*inquiry.named, *evident) for claim in acting(model, evidence.runs, found, *point, c)]
        largest = {(c.block, c.output, c.regime): c for c in sorted(acts, key=lambda claim: claim.size)}
        where = sorted(largest.values(), key=lambda claim: -claim.times_floor) or where
    if verdict == ONE_OF:
        progress("experiment that separates them", 0.95)
        options = [inquiry.values[name] for name in alternatives[0]]
        proposed = propose(model, after.point[0], options, found)
    progress("done", 1.0)
    return Result(
        rig=model.name,
        verdict=verdict,
        effects=effects,
        alternatives=alternatives,
        confidence=inquiry.confidence,
        where=where,
        parameters=[*inquiry.estimates(effects=True), *_read(evident)] if verdict in (NAMED, ONE_OF) else [],
        baseline=inquiry.estimates(effects=False),
        gap=gap,
        gap_by_regime=by_regime,
        rivals=[*(Rival(c.name, 1.0, 0.0, {}, "", 1) for c in evident), *inquiry.rivals()],
        surrogate=surrogate,
        experiment=proposed,
        floors=found,
        units={o.column: o.unit for o in model.outputs},
        equations={c.name: c.equation for c in (*inquiry.named, *evident)} | inquiry.equations(alternatives),
        hashes={},
        seconds=time.perf_counter() - started,
        held_out="given" if held else "in turn",
        notes=notes,
        atlas=atlas_numbers(model, list(runs.values()), found, *before.point),
        traces=traces,
    )


def _chosen(model: Model, names: Sequence[str] | None) -> list[Candidate]:
    known = {c.name: c for c in model.candidates}
    for name in names or []:
        if name not in known:
            raise InputError(f"effect {name!r} is no candidate of the rig {model.name}; {closest(name, known)}")
    return [known[n] for n in names] if names else list(model.candidates)


def _read(evident: Mapping[Candidate, Evident]) -> list[Estimate]:
    """Parameters of effects that recorded values show by themselves."""
    declared = {n: p for c in evident for n, p in c.declared().items()}
    return [
        Estimate(n, value, declared[n].unit, (low, high), declared[n].value, 0.0)
        for one in evident.values()
        for n, (value, low, high) in one.intervals.items()
    ]


def _carrying(evidence: Evidence, before: Linear, values: Values) -> Linear:
    """The model that carries a surrogate of these values; `before` itself where there are none, or it fits no better."""
    if not values:
        return before
    point: Point = before.point[0], {**before.point[1], **values}
    after = replace(before, point=point, residual=evidence.residuals([point])[0])
    return after if after.cost < before.cost else before


def _carrying_others(evidence: Evidence, own: Point, left: int, found: Values) -> Point:
    """`own` parameters of a run that is left out, with a surrogate of what the other runs lack."""
    others = [run for k, run in enumerate(evidence.runs) if k != left]
    told = described(evidence.model, others, found, *own) if others else {"values": {}}
    return own[0], {**own[1], **told["values"]}


def _traces(
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
