"""The joint fit: where it ends in a bent valley, as that of C_v, gamma and the zeros of two speeds; what it knows roughly; what
an output counts that the model does not describe."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import FreeParameter
from clutch_hil.fitting.model import Candidate, Columns, Output, Values
from clutch_hil.identify.clutch_effects import SPEED
from clutch_hil.identify.free_parameters import know_roughly
from clutch_hil.identify.joint_fit import fit_jointly, linearise_past_jumps, settle, shorten_step
from protocols.files.parameters import ParameterSet


class Valley:
    """Evidence whose residuals (2,) are like those of Rosenbrock's valley: their least cost is 0 at x = y = 1."""

    redundancy = 1.0

    def compute_residuals(self, points: Sequence[Point]) -> list[np.ndarray]:
        return [30.0 * np.array([5.0 * (p["y"] - p["x"] ** 2), 1.0 - p["x"]]) for p, _ in points]


@pytest.mark.parametrize("start", [(-1.2, 1.0), (0.0, 0.0), (3.0, 9.0)])
def test_in_a_bent_valley_the_fit_goes_on_to_the_end(start: tuple[float, float]) -> None:
    evidence: Any = Valley()
    free = [shorten_step(FreeParameter(name, 0.2, 1.0, -10.0, 10.0)) for name in "xy"]
    at = settle(evidence, (dict(zip("xy", start, strict=True)), {}), free)
    assert at.cost < 1e-9
    assert at.point[0]["x"] == pytest.approx(1.0, abs=1e-9)


def test_what_the_runs_hardly_excite_is_known_roughly() -> None:
    """A parameter to 15 % of its value, an effect to what is usual; in the middle is what it is without the runs."""
    parameter = know_roughly(FreeParameter("oil.viscous_gain", 0.01, 0.1, 0.5, 10.0), 2.0)
    assert (parameter.centre, parameter.scale, parameter.step) == (2.0, pytest.approx(0.3), 0.01)
    offset = know_roughly(FreeParameter(SPEED, 0.006, 0.03, -5.0, 5.0), 0.0)
    assert (offset.centre, offset.scale) == (0.0, pytest.approx(0.3))


class Gain:
    """A model whose two outputs are an input times `gain`."""

    name = "gain"
    inputs = ("u",)
    outputs = (Output("plain", "1", "gain"), Output("smoothed", "1", "gain"))
    parameters = ParameterSet({})
    candidates: tuple[Candidate, ...] = ()

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
        return {output.column: parameters["gain"] * run["u"] for output in self.outputs}


def record_gain(delay: int) -> tuple[Evidence, np.ndarray]:
    """A gain of 2 on a square wave (n,), also returned; one output has little noise and is the mean over `delay` rows."""
    random, u = np.random.default_rng(31), np.sign(np.sin(2.0 * np.pi * 3.0 * (1e-3 * np.arange(20_000) + 1e-4)))
    run = {
        "time_s": 1e-3 * np.arange(len(u)), "u": u, "plain": 2.0 * u + 0.02 * random.standard_normal(len(u)),
        "smoothed": np.convolve(2.0 * u, np.ones(delay) / delay)[: len(u)] + 0.002 * random.standard_normal(len(u)),
    }  # fmt: skip
    return Evidence(Gain(), [run], {"plain": 0.02, "smoothed": 0.002}), u


GAIN = [FreeParameter("gain", 0.01, 0.1, 0.0, 10.0)]


def test_an_output_that_the_model_does_not_describe_does_not_outweigh_the_others() -> None:
    """One that was smoothed before it was recorded has hardly any noise, and errs by far more than that."""
    evidence, _ = record_gain(20)
    joint = fit_jointly(evidence, evidence, ({"gain": 1.0}, {}), GAIN, lambda share: None)
    assert joint.at.point[0]["gain"] == pytest.approx(2.0, abs=0.02)


def test_outputs_that_the_model_describes_count_by_their_noise() -> None:
    evidence, u = record_gain(1)
    joint = fit_jointly(evidence, evidence, ({"gain": 1.0}, {}), GAIN, lambda share: None)
    counted = joint.evidence.weights > 0.0
    np.testing.assert_array_equal(joint.evidence.weights[counted], evidence.weights[counted])
    assert joint.half[0] == pytest.approx(1.96 * 0.002 / np.sqrt(len(u)), rel=0.3)


class Step:
    """Evidence of a line (100,) in x, whose last residual jumps where x passes `at`, and else rises `steeply`."""

    redundancy, size = 1.0, 100

    def __init__(self, at: float, height: float, steeply: float) -> None:
        self._at, self._height, self._steeply = at, height, steeply

    def compute_residuals(self, points: Sequence[Point]) -> list[np.ndarray]:
        return [self._compute(p["x"]) for p, _ in points]

    def _compute(self, x: float) -> np.ndarray:
        line = x * np.linspace(-1.0, 1.0, self.size)
        line[-1] += self._height * (x > self._at) + self._steeply * x
        return line


STEP = 0.01  # of the differences


@pytest.mark.parametrize("at", [-0.7 * STEP, 0.0, 0.5 * STEP, 1.5 * STEP, 3.0 * STEP])
@pytest.mark.parametrize("height", [-20.0, 5.0, 0.0])
def test_a_jump_of_one_residual_is_no_sensitivity(at: float, height: float) -> None:
    evidence: Any = Step(at, height, 0.0)
    result = linearise_past_jumps(evidence, ({"x": 0.0}, {}), [FreeParameter("x", STEP, 1.0, -10.0, 10.0)])
    assert np.abs(result.jacobian[:, 0]) == pytest.approx(np.abs(np.linspace(-1.0, 1.0, 100)), abs=1e-9)


def test_one_residual_may_tell_most_of_a_parameter() -> None:
    evidence: Any = Step(10.0, 0.0, 50.0)
    result = linearise_past_jumps(evidence, ({"x": 0.0}, {}), [FreeParameter("x", STEP, 1.0, -10.0, 10.0)])
    assert abs(result.jacobian[-1, 0]) == pytest.approx(51.0)
