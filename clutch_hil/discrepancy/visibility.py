"""Visibility: how much of an effect a set of experiments shows after a re-fit of the baseline.

Equation        r = (outputs with the effect - without)/floor, minus its linear least squares in the parameters of the baseline
                with their prior (fit.py). A gap is the root mean square of r over the samples of an output, in floors
Assumptions     the inputs are those without the effect
"""

from collections.abc import Iterable

import numpy as np

from clutch_hil.discrepancy.experiment_design import Bench, Experiment, PredictedRuns, check_bench
from clutch_hil.fitting.fit import free_baseline, linearise
from clutch_hil.fitting.model import Model, Values, find_calibration
from protocols.errors import InputError


class Visibility:
    """How much `experiments` on a `bench` show of the effects of `model`; `floors` by output.

    Raises InputError for an experiment that is not safe.
    """

    def __init__(self, model: Model, bench: Bench, experiments: Iterable[Experiment], floors: Values) -> None:
        parameters: Values = {name: p.value for name, p in model.parameters.items()}
        runs = []
        check_bench(bench, model.name)
        for experiment in experiments:
            if (inputs := bench.plan_inputs(experiment, parameters, {})) is None:
                raise InputError(f"experiment {experiment.name} comes too close to a limit of the rig; see its profile")
            runs.append({**inputs, **model.simulate(inputs, parameters, {})})
        self._evidence = PredictedRuns(model, runs, floors)
        self._at = linearise(self._evidence, (parameters, {}), free_baseline(model.parameters, find_calibration(model)))

    def compute_gaps(self, effects: Values) -> dict[str, float]:
        """Return the gap in floors by output; the largest is the visibility. effects: parameters by dotted name."""
        residual = self._evidence.compute_residuals([(self._at.point[0], effects)])[0]
        left = residual + self._at.jacobian @ self._at.find_best(residual)[0]
        rms = {}
        for column in self._evidence.columns:
            parts = [
                left[self._evidence.find_part(k, column)] / np.sqrt(b) for k, b in enumerate(self._evidence.blocks)
            ]
            rms[column] = float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
        return rms
