"""Judge one case: generate it, let the engine investigate its runs, and keep the data for scores and thresholds.

The engine gets only the measured columns of docs/rig.md, under names that reveal nothing. The truth is used afterwards.
"""

import gc
import os
import time
import traceback
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np

from benchmarks.battery.cases import Case
from benchmarks.battery.floors import compute_noise_floors
from benchmarks.battery.records import GeneratedCase, RecordedRun, generate_case, record_further_run
from benchmarks.battery.score import Answer
from benchmarks.battery.truth_simulation import COLUMNS, PERIOD
from clutch_hil.discrepancy import search, selection
from clutch_hil.discrepancy.atlas import find_concentration
from clutch_hil.discrepancy.decision import Explanation
from clutch_hil.discrepancy.joint_fits import JointFit, Start
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.regimes import ALL, Regimes
from clutch_hil.discrepancy.result import ONE_OF, Claim, Result
from clutch_hil.fitting import evidence
from clutch_hil.fitting.fit import LinearModel
from clutch_hil.fitting.model import Candidate, Columns
from plant_sim.profiles.profile import load_profile

RIVALS = 5  # candidates kept for each case, the best ones; chosen by judgement


@cache
def use_threads(count: int) -> None:
    """Set the number of threads with which this process simulates."""
    evidence._POOL = ThreadPoolExecutor(count)


def judge(name: str) -> Answer:
    """Investigate the case of this name; return the engine's answer and the truth as a JSON object.

    An exception of the engine is part of the answer (`error`), and is not raised. Raises InputError for a wrong name.
    """
    case = Case.of(name)
    start = time.perf_counter()
    generated = generate_case(case)
    answer = _investigate(
        generated, name_columns(generated.runs, "run"), name_columns(generated.held_out, "held"), start
    )
    gc.collect()  # circular references of a fit hold a gigabyte in few objects; the collector waits for many objects
    return answer


def name_columns(records: Sequence[RecordedRun], kind: str) -> dict[str, Columns]:
    """Give the columns of each run a name that reveals nothing. This is all that the engine and other methods get."""
    return {f"{kind}-{k}": record.columns for k, record in enumerate(records)}


def _investigate(
    generated_case: GeneratedCase, runs: dict[str, Columns], held_out: dict[str, Columns], start: float
) -> Answer:
    generated = time.perf_counter()
    answer: Answer = {
        "case": generated_case.truth["name"],
        "truth": generated_case.truth,
        "generating_seconds": generated - start,
    }
    cpu = time.process_time()
    try:
        with _SearchLog() as watch:
            result = search.investigate(WetClutch(), runs, held_out)
    except Exception:  # counted as a wrong answer; the other cases continue
        return answer | {"error": traceback.format_exc()}
    spent = {
        "seconds": time.perf_counter() - generated,
        "cpu_seconds": time.process_time() - cpu,
        "load": os.getloadavg()[0],
    }
    answer |= (
        spent
        | _summarise_result(result)
        | {"weighed": watch.collect_features(result), "claims": _check_claims(result, generated_case)}
    )
    names = [n for group in result.alternatives for n in group]
    if result.verdict == ONE_OF and {e["name"] for e in generated_case.truth["effects"]} & set(names):
        answer["resolved"] = _resolve_tie(generated_case, result, runs, held_out)
    return answer


def _resolve_tie(
    generated: GeneratedCase, result: Result, runs: dict[str, Columns], held_out: dict[str, Columns]
) -> Answer | None:
    """Investigate again with the run of the proposed experiment; return None if no experiment was proposed."""
    proposed = result.experiment
    if not proposed or not proposed["profile"]:
        return None
    profile = load_profile(proposed["profile"])
    demands = [profile.interpolate(k * PERIOD) for k in range(round(profile.duration / PERIOD))]
    pressure, speed = (np.array([getattr(d, name) for d in demands]) for name in ("pressure", "speed"))
    record = record_further_run(
        generated.truth, proposed["profile"], pressure, speed, proposed["settings"]["temperature"]
    )
    again = search.investigate(WetClutch(), {**runs, "experiment": record.columns}, held_out)
    return {
        "profile": record.title,
        "verdict": again.verdict,
        "effects": again.effects,
        "alternatives": again.alternatives,
    }


def _summarise_result(result: Result) -> Answer:
    whole = result.as_json()
    keys = ("verdict", "effects", "alternatives", "confidence", "where", "parameters", "floors", "notes", "experiment")
    answer = {key: whole[key] for key in keys} | {"gap": whole["gap"]["holdout"]}
    size = max(sum(len(t.columns["time_s"]) for t in result.traces if not t.held_out), 1)
    first = [r for r in result.rivals if r.round == 1]
    best: dict[str, Any] = {}
    for r in sorted(first, key=lambda r: -r.gain):
        best.setdefault(r.name, {"name": r.name, "gain_a_sample": r.gain / size, "closed": r.closed})
    return answer | {"rivals": list(best.values())[:RIVALS]}


def _check_claims(result: Result, generated: GeneratedCase) -> list[Answer]:
    """Compare each claim with the truth: check the difference that the effects make in that output and regime.

    `times_floor`: root mean square of the difference there, in floors. `density`: its power per sample there, over that of all
    samples. `concentrated`: whether `atlas.find_concentration`, applied to the true difference, names the regime.
    """
    if not result.where:
        return []
    model = WetClutch()
    regimes = Regimes(model, [r.columns for r in generated.runs], {n: p.value for n, p in model.parameters.items()})
    masks = [regimes(r.columns) for r in generated.runs]
    whole = {name: np.concatenate([m[name] for m in masks]) for name in masks[0] if all(name in m for m in masks)}
    return [_check_claim(claim, generated, whole) for claim in result.where]


def _check_claim(claim: Claim, generated: GeneratedCase, masks: Mapping[str, np.ndarray]) -> Answer:
    i = COLUMNS.index(claim.output)
    power = np.concatenate([record.difference[:, i] ** 2 for record in generated.runs])
    total, floor = float(power.sum()), compute_noise_floors(generated.truth["noise"])[i]
    answer: Answer = {"block": claim.block, "output": claim.output, "regime": claim.regime, "p_value": claim.p_value}
    mask = masks.get(claim.regime)
    if total <= 0.0 or mask is None or not mask.any():
        return answer | {"times_floor": 0.0, "density": 0.0, "concentrated": False}
    shares = {n: (float(power[m].sum()) / total, float(np.mean(m))) for n, m in masks.items() if m.any()}
    part, time_share = shares[claim.regime]
    return answer | {
        "times_floor": float(np.sqrt(np.mean(power[mask]))) / floor,
        "density": part / time_share,
        "concentrated": claim.regime in (find_concentration(shares) or [ALL]),
    }


class _SearchLog:
    """Context that logs a search: costs, and each set of effects that was taken or rejected.

    The result of a search does not hold them.
    """

    def __enter__(self) -> "_SearchLog":
        self.selection: Any = None
        self.steps: list[Answer] = []
        self._original = search.EffectSelection, selection.JointFits
        watch = self

        class Watched(search.EffectSelection):
            def _accept(self, at: LinearModel, candidates: tuple[Candidate, ...], costs: dict[str, float]) -> None:
                super()._accept(at, candidates, costs)
                watch.log_step([c.name for c in candidates], self.explanation, True)

            def decide(self) -> Any:
                watch.selection = self
                return super().decide()

        class WatchedFits(selection.JointFits):
            def fit(self, sets: Sequence[Start]) -> list[JointFit]:
                fits = super().fit(sets)
                at, candidates = fits[0]
                if len(candidates) > 1:
                    watch.log_step([c.name for c in candidates], self.explain(at, len(candidates)), False)
                return fits

        search.EffectSelection, selection.JointFits = Watched, WatchedFits  # type: ignore[misc]
        return self

    def __exit__(self, *_: object) -> None:
        search.EffectSelection, selection.JointFits = self._original  # type: ignore[misc]

    def log_step(self, names: list[str], w: Explanation, taken: bool) -> None:
        """Log a set of effects, its unexplained remainder, and whether it was accepted."""
        self.steps.append(
            {"effects": names, "cost": w.best, "excess": w.excess, "rest": w.rest, "base": w.base, "taken": taken}
        )

    def collect_features(self, result: Result) -> Answer:
        """Collect the inputs of the decision: `decision.Explanation`, costs of the best candidates, steps."""
        effects, w = self.selection, self.selection.explanation
        costs = dict(sorted(effects.costs.items(), key=lambda one: one[1])[: 2 * RIVALS])
        ordered = sorted(costs.values())
        margin = (ordered[1] - ordered[0]) / max(w.base - ordered[0], 1e-9) if len(ordered) > 1 else 1.0
        return {
            "base": w.base, "best": w.best, "size": w.size, "count": w.count, "gain": w.gain, "excess": w.excess,
            "rest": w.rest, "relief": w.prior_gain, "strain": w.prior_chi2, "alike": w.redundancy,
            "closed": w.closed, "margin": margin,
            "named": [c.name for c in effects.named],
            "costs": costs, "steps": self.steps,
        }  # fmt: skip
