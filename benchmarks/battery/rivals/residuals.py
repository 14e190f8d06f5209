"""Residuals that every other method starts from: noise floor and re-fitted baseline are those of the workflow.

They are cached on disk as 16 bit floats, 0.7 MB per case.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.battery.cases import Case
from benchmarks.battery.judgement import name_columns
from benchmarks.battery.records import generate_case
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import LinearModel, free_baseline, linearise, refit
from clutch_hil.fitting.noise import estimate_floors

OUTPUTS = tuple(output.column for output in WetClutch.outputs)
INPUTS = ("valve_voltage_v", "motor_speed_demand_rad_s", "shaft_angle_rad")
PERIOD = 4e-3  # s: samples are means over 4 ms, as in evidence.py


@dataclass(frozen=True)
class ResidualData:
    """Data of a case, means over PERIOD.

    `residuals` (runs, outputs, n): measured minus predicted, in floors. `predicted` (runs, outputs, n): outputs of the
    re-fitted baseline, in their units. `inputs` (runs, inputs, n). `excess`: mean squared residual above that of noise
    [-].
    """

    residuals: np.ndarray
    predicted: np.ndarray
    inputs: np.ndarray
    excess: float

    def select_input(self, name: str) -> np.ndarray:
        """Return an input (runs, n)."""
        return self.inputs[:, INPUTS.index(name)]

    def select_output(self, name: str) -> np.ndarray:
        """Return a predicted output (runs, n)."""
        return self.predicted[:, OUTPUTS.index(name)]


def load_residuals(name: str, folder: Path) -> ResidualData:
    """Read the residuals of a case from `folder`, or compute and write them. Raises InputError for a wrong name."""
    path = folder / f"{name}.npz"
    if path.exists():
        with np.load(path) as kept:
            return ResidualData(
                *(kept[key].astype(np.float64) for key in ("residuals", "predicted", "inputs")), float(kept["excess"])
            )
    data = _compute_residuals(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part.npz")
    half = {key: getattr(data, key).astype(np.float16) for key in ("residuals", "predicted")}
    np.savez_compressed(part, **half, inputs=data.inputs.astype(np.float32), excess=data.excess)
    part.replace(path)
    return data


def _compute_residuals(name: str) -> ResidualData:
    evidence, nominal = _linearise_baseline(name)
    at = refit(evidence, nominal)
    predictions = [evidence.model.simulate(run, *at.point) for run in evidence.runs]
    return ResidualData(
        at.residual.reshape(len(predictions), len(OUTPUTS), -1),
        np.array([[_average_blocks(one[c], evidence.blocks[0]) for c in OUTPUTS] for one in predictions]),
        np.array([[_average_blocks(run[c], evidence.blocks[0]) for c in INPUTS] for run in evidence.runs]),
        max(at.cost / evidence.size - 1.0, 0.0),
    )


@lru_cache(1)  # residuals and effects of the same case both start from it
def _linearise_baseline(name: str) -> tuple[Evidence, LinearModel]:
    """Generate the runs of a case, and linearise the baseline at its nominal parameters."""
    runs = list(name_columns(generate_case(Case.of(name)).runs, "run").values())
    model = WetClutch()
    evidence = Evidence(model, runs, estimate_floors(runs, model.outputs))
    nominal: Point = ({n: p.value for n, p in model.parameters.items()}, {})
    return evidence, linearise(evidence, nominal, free_baseline(model.parameters, model.calibration))


def simulate_effects(name: str) -> dict[str, np.ndarray]:
    """Return the changes (runs, outputs, n) in the residuals of a case by each effect of the catalogue, in floors, by name.

    Effects have their typical strength. The part that a re-fit of the baseline can absorb is removed.
    """
    evidence, at = _linearise_baseline(name)
    candidates = evidence.model.candidates
    shown = evidence.compute_residuals([(at.point[0], c.list_typical_values()) for c in candidates])
    changes = {}
    for c, residual in zip(candidates, shown, strict=True):
        change = np.nan_to_num(residual - at.residual)
        move, _ = at.find_best(change)
        changes[c.name] = (change + at.jacobian @ move).reshape(len(evidence.runs), len(OUTPUTS), -1)
    return changes


def _average_blocks(values: np.ndarray, block: int) -> np.ndarray:
    n = len(values) // block
    return values[: n * block].reshape(n, block).mean(axis=1)
