"""Statistics of residuals: 95 % intervals contain the true value, also of short runs; power is that of predicted rows."""

import numpy as np
import pytest

from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.fit import FreeParameter, LinearModel
from clutch_hil.fitting.intervals import compute_half_widths
from clutch_hil.fitting.model import Candidate, Columns, Output, Values
from protocols.files.parameters import ParameterSet

DRAWS, COUNT = 400, 3  # cases, and parameters of each
LEAST, MOST = 0.90, 0.985  # of 1200 intervals; sandwiches of few clusters have 92 to 94 % (Cameron and Miller 2015)


class Nothing:
    """A model that predicts 0."""

    name = "nothing"
    inputs: tuple[str, ...] = ()
    outputs: tuple[Output, ...] = (Output("signal_v", "V", "nothing"),)
    parameters = ParameterSet({})
    candidates: tuple[Candidate, ...] = ()

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> Columns:
        """See `Model`."""
        return {"signal_v": np.zeros(len(run["time_s"]))}


@pytest.mark.parametrize(("runs", "seconds"), [(1, 1.0), (1, 2.0), (1, 4.0), (2, 4.0), (4, 4.0), (2, 24.0)])
def test_intervals_of_white_residuals_contain_the_true_value(runs: int, seconds: float) -> None:
    random = np.random.default_rng(1)
    time = np.arange(round(1000 * seconds)) / 1000.0
    columns = [{"time_s": time, "signal_v": random.standard_normal(len(time))} for _ in range(runs)]
    evidence = Evidence(Nothing(), columns, {"signal_v": 1.0})
    free = tuple(FreeParameter(f"effect.{k}", 1.0, 1.0, -1e9, 1e9, off=0.0) for k in range(COUNT))
    values = {f.name: 0.0 for f in free}
    at = np.concatenate([np.arange(piece.stop - piece.start) * evidence.lengths[0] for piece in evidence.pieces])
    slopes = np.column_stack([np.cos(2.0 * np.pi * (0.37 * k + 0.6) * at + k) for k in range(COUNT)])
    inside = 0
    for _ in range(DRAWS):
        noise = random.standard_normal(evidence.size)
        begin = LinearModel(({}, values), free, noise, slopes, 1.0)
        move, _ = begin.find_best(noise)
        fit = begin.move_to(begin.move_by(move), noise + slopes @ move)
        inside += np.count_nonzero(np.abs(move) <= compute_half_widths(evidence, fit))
    assert LEAST <= inside / (DRAWS * COUNT) <= MOST


class Half(Nothing):
    """A model that does not predict the first half of a run."""

    def find_unseen(self, run: Columns) -> dict[str, np.ndarray]:
        """See `Partial`."""
        return {"signal_v": np.arange(len(run["time_s"])) < len(run["time_s"]) // 2}


def test_the_power_of_a_run_is_that_of_the_rows_that_the_model_predicts() -> None:
    time = np.arange(4000) / 1000.0
    run = {"time_s": time, "signal_v": 3.0 + np.random.default_rng(1).standard_normal(len(time))}
    evidence = Evidence(Half(), [run], {"signal_v": 1.0})
    residual = evidence.compute_residuals([({}, {})])[0]
    assert evidence.compute_excess_by_run(residual) == pytest.approx([evidence.compute_excess(residual)])
