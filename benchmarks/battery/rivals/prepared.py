"""What every rival begins with: the workflow's own first steps, noise floor and baseline re-fit, and the residuals left.

Kept on disk, as 16 bit floats: 0.7 MB a case.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.battery.cases import Case, generate
from benchmarks.battery.judged import columns
from clutch_hil.discrepancy.evidence import Evidence, Point
from clutch_hil.discrepancy.fit import LinearModel, free_baseline, linearise, refit
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.noise import estimate_floors

OUTPUTS = tuple(output.column for output in WetClutch.outputs)
INPUTS = ("valve_voltage_v", "motor_speed_demand_rad_s", "shaft_angle_rad")
PERIOD = 4e-3  # s, of evidence.py's means


@dataclass(frozen=True)
class Prepared:
    """Residuals in floors of 4 ms (runs, outputs, n), what the re-fitted baseline predicts, alike, in units of the outputs,
    inputs (runs, inputs, n), and the share of the residuals' power that is above the floor.
    """

    residuals: np.ndarray
    predicted: np.ndarray
    inputs: np.ndarray
    excess: float

    def input(self, name: str) -> np.ndarray:
        """An input (runs, n)."""
        return self.inputs[:, INPUTS.index(name)]

    def output(self, name: str) -> np.ndarray:
        """A predicted output (runs, n)."""
        return self.predicted[:, OUTPUTS.index(name)]


def prepared(name: str, folder: Path) -> Prepared:
    """The residuals of a case, from `folder` if they are there."""
    path = folder / f"{name}.npz"
    if path.exists():
        with np.load(path) as kept:
            return Prepared(
                *(kept[key].astype(np.float64) for key in ("residuals", "predicted", "inputs")), float(kept["excess"])
            )
    made = _prepared(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part.npz")
    half = {key: getattr(made, key).astype(np.float16) for key in ("residuals", "predicted")}
    np.savez_compressed(part, **half, inputs=made.inputs.astype(np.float32), excess=made.excess)
    part.replace(path)
    return made


def _prepared(name: str) -> Prepared:
    evidence, nominal = _begun(name)
    at = refit(evidence, nominal)
    shown = [evidence.model.simulate(run, *at.point) for run in evidence.runs]
    return Prepared(
        at.residual.reshape(len(shown), len(OUTPUTS), -1),
        np.array([[_means(one[c], evidence.blocks[0]) for c in OUTPUTS] for one in shown]),
        np.array([[_means(run[c], evidence.blocks[0]) for c in INPUTS] for run in evidence.runs]),
        max(at.cost / evidence.size - 1.0, 0.0),
    )


@lru_cache(1)  # one method asks for both, residuals and effects
def _begun(name: str) -> tuple[Evidence, LinearModel]:
    """The runs of a case, and the baseline linearised where it is nominal."""
    runs = list(columns(generate(Case.of(name)).runs, "run").values())
    model = WetClutch()
    evidence = Evidence(model, runs, estimate_floors(runs, model.outputs))
    nominal: Point = ({n: p.value for n, p in model.parameters.items()}, {})
    return evidence, linearise(evidence, nominal, free_baseline(model.parameters, model.calibration))


def simulated(name: str) -> dict[str, np.ndarray]:
    """What each effect of the catalogue, typically strong, changes in the runs of a case: residuals in floors
    (runs, outputs, n), less what the baseline's own parameters can do about them.
    """
    evidence, at = _begun(name)
    candidates = evidence.model.candidates
    shown = evidence.residuals([(at.point[0], c.typical()) for c in candidates])
    found = {}
    for c, residual in zip(candidates, shown, strict=True):
        change = np.nan_to_num(residual - at.residual)
        move, _ = at.best(change)
        found[c.name] = (change + at.jacobian @ move).reshape(len(evidence.runs), len(OUTPUTS), -1)
    return found


def _means(values: np.ndarray, block: int) -> np.ndarray:
    n = len(values) // block
    return values[: n * block].reshape(n, block).mean(axis=1)
