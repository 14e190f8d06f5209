"""Judge one case: generate it, let the engine investigate its runs, keep what is needed to score it and to set thresholds.

The engine is given columns as rig.md has them under plain names, nothing else; what the case hides is looked at afterwards.
"""

import gc
import os
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from benchmarks.battery.cases import Case, Generated, Record, floors, further, generate
from benchmarks.battery.truth import COLUMNS, PERIOD
from clutch_hil.discrepancy import evidence, search
from clutch_hil.discrepancy.atlas import find_concentration
from clutch_hil.discrepancy.decision import Explanation
from clutch_hil.discrepancy.fit import LinearModel
from clutch_hil.discrepancy.model import Candidate, Columns
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.regimes import ALL, Regimes
from clutch_hil.discrepancy.result import ONE_OF, Claim, Result
from plant_sim.profiles.profile import load_profile

Told = dict[str, Any]
_JointFit = tuple[LinearModel, tuple[Candidate, ...]]  # a fit of several candidates together
RIVALS = 5  # kept of each case


def use_threads(count: int) -> None:
    """Threads of this process that simulate at a time."""
    evidence._POOL = ThreadPoolExecutor(count)


def judge(name: str) -> Told:
    """What the engine said of the case of this name, and the truth, as JSON takes it. An exception is told, not raised."""
    case = Case.of(name)
    began = time.perf_counter()
    made = generate(case)
    told = _timed(made, columns(made.runs, "run"), columns(made.held_out, "held"), began)
    gc.collect()  # a fit's cycles hold few objects but a gigabyte: the collector counts objects
    return told


def columns(records: Sequence[Record], kind: str) -> dict[str, Columns]:
    """Runs as the engine and its rivals are given them, by a name that tells nothing."""
    return {f"{kind}-{k}": record.columns for k, record in enumerate(records)}


def _timed(made: Generated, runs: dict[str, Columns], held_out: dict[str, Columns], began: float) -> Told:
    generated = time.perf_counter()
    told: Told = {"case": made.truth["name"], "truth": made.truth, "generating_seconds": generated - began}
    cpu = time.process_time()
    try:
        with _Watch() as watch:
            result = search.investigate(WetClutch(), runs, held_out)
    except Exception:  # a case that breaks the engine is a wrong answer, and the others go on
        return told | {"error": traceback.format_exc()}
    spent = {
        "seconds": time.perf_counter() - generated,
        "cpu_seconds": time.process_time() - cpu,
        "load": os.getloadavg()[0],
    }
    told |= spent | _said(result) | {"weighed": watch.features(result), "claims": _claims(result, made)}
    names = [n for group in result.alternatives for n in group]
    if result.verdict == ONE_OF and {e["name"] for e in made.truth["effects"]} & set(names):
        told["resolved"] = _resolved(made, result, runs, held_out)
    return told


def _resolved(made: Generated, result: Result, runs: dict[str, Columns], held_out: dict[str, Columns]) -> Told | None:
    """What is said once the proposed experiment has been played and joined the runs; None where none was proposed."""
    proposed = result.experiment
    if not proposed or not proposed["profile"]:
        return None
    profile = load_profile(proposed["profile"])
    demands = [profile.at(k * PERIOD) for k in range(round(profile.duration / PERIOD))]
    pressure, speed = (np.array([getattr(d, name) for d in demands]) for name in ("pressure", "speed"))
    record = further(made.truth, proposed["profile"], pressure, speed, proposed["settings"]["temperature"])
    again = search.investigate(WetClutch(), {**runs, "experiment": record.columns}, held_out)
    return {
        "profile": record.title,
        "verdict": again.verdict,
        "effects": again.effects,
        "alternatives": again.alternatives,
    }


def _said(result: Result) -> Told:
    whole = result.as_json()
    keys = ("verdict", "effects", "alternatives", "confidence", "where", "parameters", "floors", "notes", "experiment")
    told = {key: whole[key] for key in keys} | {"gap": whole["gap"]["holdout"]}
    size = max(sum(len(t.columns["time_s"]) for t in result.traces if not t.held_out), 1)
    first = [r for r in result.rivals if r.round == 1]
    best: dict[str, Any] = {}
    for r in sorted(first, key=lambda r: -r.gain):
        best.setdefault(r.name, {"name": r.name, "gain_a_sample": r.gain / size, "closed": r.closed})
    return told | {"rivals": list(best.values())[:RIVALS]}


def _claims(result: Result, made: Generated) -> list[Told]:
    """What the truth says of each claim: whether its difference is in that output and regime.

    `times_floor`: root mean square of the difference there. `density`: its power there a sample over that of all samples.
    `concentrated`: whether atlas.find_concentration, given the difference itself, names the regime ("all" where it names none).
    """
    if not result.where:
        return []
    model = WetClutch()
    regimes = Regimes(model, [r.columns for r in made.runs], {n: p.value for n, p in model.parameters.items()})
    masks = [regimes(r.columns) for r in made.runs]
    whole = {name: np.concatenate([m[name] for m in masks]) for name in masks[0] if all(name in m for m in masks)}
    return [_against(claim, made, whole) for claim in result.where]


def _against(claim: Claim, made: Generated, masks: Mapping[str, np.ndarray]) -> Told:
    i = COLUMNS.index(claim.output)
    power = np.concatenate([record.difference[:, i] ** 2 for record in made.runs])
    total, floor = float(power.sum()), floors(made.truth["noise"])[i]
    told: Told = {"block": claim.block, "output": claim.output, "regime": claim.regime, "p_value": claim.p_value}
    mask = masks.get(claim.regime)
    if total <= 0.0 or mask is None or not mask.any():
        return told | {"times_floor": 0.0, "density": 0.0, "concentrated": False}
    shares = {n: (float(power[m].sum()) / total, float(np.mean(m))) for n, m in masks.items() if m.any()}
    part, time_share = shares[claim.regime]
    return told | {
        "times_floor": float(np.sqrt(np.mean(power[mask]))) / floor,
        "density": part / time_share,
        "concentrated": claim.regime in (find_concentration(shares) or [ALL]),
    }


class _Watch:
    """Keeps what a search weighed, which its result does not hold: costs, and each set of effects taken or rejected."""

    def __enter__(self) -> "_Watch":
        self.seen: Any = None
        self.steps: list[Told] = []
        self._original = search.EffectSelection
        watch = self

        class Watched(search.EffectSelection):
            def _accept(self, at: LinearModel, candidates: tuple[Candidate, ...], costs: dict[str, float]) -> None:
                super()._accept(at, candidates, costs)
                watch.step([c.name for c in candidates], self.explanation, True)

            def _fit_jointly(self, sets: Any) -> Any:
                fits = super()._fit_jointly(sets)
                at, candidates = fits[0]
                if len(candidates) > 1:
                    watch.step([c.name for c in candidates], self._explain(at, len(candidates)), False)
                return fits

            def decide(self) -> Any:
                watch.seen = self
                return super().decide()

        search.EffectSelection = Watched  # type: ignore[misc]
        return self

    def __exit__(self, *_: object) -> None:
        search.EffectSelection = self._original  # type: ignore[misc]

    def step(self, names: list[str], w: Explanation, taken: bool) -> None:
        """Keep what a set of effects would leave."""
        self.steps.append(
            {"effects": names, "cost": w.best, "excess": w.excess, "rest": w.rest, "base": w.base, "taken": taken}
        )

    def features(self, result: Result) -> Told:
        """Base, best, size, count, and what comes from them; costs of the rivals, steps of the search."""
        inquiry, w = self.seen, self.seen.explanation
        costs = dict(sorted(inquiry.costs.items(), key=lambda one: one[1])[: 2 * RIVALS])
        ordered = sorted(costs.values())
        margin = (ordered[1] - ordered[0]) / max(w.base - ordered[0], 1e-9) if len(ordered) > 1 else 1.0
        return {
            "base": w.base, "best": w.best, "size": w.size, "count": w.count, "gain": w.gain, "excess": w.excess,
            "rest": w.rest, "relief": w.prior_gain, "strain": w.prior_chi2, "alike": w.redundancy,
            "closed": w.closed, "margin": margin,
            "named": [c.name for c in inquiry.named],
            "costs": costs, "steps": self.steps,
        }  # fmt: skip


Judge = Callable[[str], Told]
