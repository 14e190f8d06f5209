"""Result of the workflow. `report.json` is `Result.as_json()`; report and pictures use no other source."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from clutch_hil.discrepancy.recalibration import Recalibration
from clutch_hil.recordings.checks.finding import Finding

NOTHING, NAMED, ONE_OF, NONE_OF_THESE = "nothing_missing", "named", "one_of", "none_of_these"
IDENTIFY_FIRST = "identify_first"


@dataclass(frozen=True)
class Claim:
    """A disagreement of `output`, assigned to `block`, in `regime` ("direction=release", "phase=slip", "all").

    size: root mean square in `unit`. times_floor: size in noise floors. p_value: for autocorrelated data, corrected for all
    claims together.
    """

    block: str
    output: str
    regime: str
    size: float
    unit: str
    times_floor: float
    p_value: float


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter with its 95 % interval, in `unit`. nominal: value before the fit. uncertainty: of nominal, 1 sigma."""

    name: str
    value: float
    unit: str
    ci95: tuple[float, float]
    nominal: float
    uncertainty: float = 0.0


@dataclass(frozen=True)
class Gap:
    """Root mean square error of an output on held-out runs, before and after, and its noise floor, in the output's unit."""

    before: float
    after: float
    floor: float

    @property
    def closed(self) -> float:
        """Return (before^2 - after^2)/(before^2 - floor^2); not-a-number where there was no gap."""
        excess = self.before**2 - self.floor**2
        return (self.before**2 - self.after**2) / excess if excess > 0.0 else float("nan")


@dataclass(frozen=True)
class Rival:
    """A candidate, and why it was not named.

    closed: share of the excess over the floor of the fitted runs that the candidate closes alone. gain: reduction of twice the
    negative log-likelihood. values: fitted parameters by dotted name, in `units`. reason: one sentence, "" when it is named.
    round: round of the search, from 1.
    """

    name: str
    closed: float
    gain: float
    values: dict[str, float]
    reason: str
    round: int
    units: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Trace:
    """One run: `measured`, predicted `before` and `after` by output column, each (n,). columns: the whole run as read."""

    name: str
    held_out: bool
    columns: dict[str, np.ndarray]
    measured: dict[str, np.ndarray]
    before: dict[str, np.ndarray]
    after: dict[str, np.ndarray]


@dataclass(frozen=True)
class Result:
    """The complete result of the workflow, with traces and hashes of the data.

    surrogate: description of the residual where the verdict is `none_of_these`: block, variables, shape, fitted terms.
    experiment: the proposed experiment, None where none is needed.
    """

    rig: str
    verdict: str
    effects: list[str]
    alternatives: list[list[str]]
    confidence: float
    where: list[Claim]
    parameters: list[Estimate]  # of the effects
    baseline: list[Estimate]  # re-fitted parameters of the baseline
    gap: dict[str, Gap]  # by output, held out
    gap_by_regime: dict[str, dict[str, Gap]]  # by output and regime
    rivals: list[Rival]
    surrogate: dict[str, Any] | None
    experiment: dict[str, Any] | None
    floors: dict[str, float]  # by output, in its unit
    units: dict[str, str]  # of outputs
    equations: dict[str, str]  # of the effects named, or of the alternatives
    hashes: dict[str, str]  # SHA-256 of each run file
    seconds: float
    held_out: str = "given"  # or "in turn": whole runs are left out one after the other
    holdout: list[str] = field(default_factory=list)  # files of the runs that were not fitted
    model: str | None = None  # model file that the search started from
    recalibration: Recalibration | None = None  # set where a calibration might explain the disagreement as well
    notes: list[str] = field(default_factory=list)
    checks: list[Finding] = field(default_factory=list)  # findings in the runs before any fit: run_checks.py
    forced: bool = False  # whether the search continued in spite of hard findings
    atlas: dict[str, Any] = field(
        default_factory=dict
    )  # coherence, orders, correlations of the residual: residual_statistics.py
    traces: list[Trace] = field(default_factory=list)

    @property
    def main_output(self) -> str | None:
        """Return the output with the largest gap in floors, for headlines: of those claimed, else of all, or None."""
        claimed = [c for c in self.gap if c in {claim.output for claim in self.where}]
        return max(claimed or self.gap, key=lambda c: self.gap[c].before / (self.gap[c].floor or 1e-300), default=None)

    @property
    def equal_calibration(self) -> Recalibration | None:
        """Return the re-calibration that explains as much as the named effects or alternatives, or None."""
        named = self.verdict in (NAMED, ONE_OF)
        return self.recalibration if named and self.recalibration and self.recalibration.equals else None

    def as_json(self) -> dict[str, Any]:
        """Return the content of `report.json`, see docs/discrepancy.md."""
        return {
            "verdict": self.verdict,
            "effects": self.effects,
            "alternatives": self.alternatives,
            "confidence": self.confidence,
            "where": [vars(claim) for claim in self.where],
            "parameters": [_estimate(estimate) for estimate in self.parameters],
            "gap": {"holdout": {column: vars(gap) for column, gap in self.gap.items()}},
            "experiment": self.experiment,
            "seconds": self.seconds,
            "rig": self.rig,
            "baseline": [_estimate(estimate) for estimate in self.baseline],
            "gap_by_regime": {c: {r: vars(g) for r, g in gaps.items()} for c, gaps in self.gap_by_regime.items()},
            "rivals": [vars(rival) for rival in self.rivals],
            "surrogate": self.surrogate,
            "floors": self.floors,
            "equations": self.equations,
            "runs": self.hashes,
            "held_out": self.held_out,
            "holdout": self.holdout,
            "model": self.model,
            "recalibration": self.recalibration.as_json() if self.recalibration else None,
            "notes": self.notes,
            "checks": [finding.as_json() for finding in self.checks],
            "forced": self.forced,
            "atlas": self.atlas,
        }


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return vars(estimate) | {"ci95": list(estimate.ci95)}
