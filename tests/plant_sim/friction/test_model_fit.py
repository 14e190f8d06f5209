"""The fit of any model: intervals, starts, and what data cannot tell."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from plant_sim.friction.identification.fit import Measured, fit
from plant_sim.friction.identification.least_squares import Estimate, minimise
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import Array
from protocols.errors import InputError
from tests.plant_sim.friction.test_identifiability import MOTION, SUBJECTS
from tests.plant_sim.friction.test_identification import make_triangle

DAHL, LUGRE, TWO_ELEMENTS = (SUBJECTS[name] for name in ("Dahl", "LuGre", "Maxwell-slip"))


def test_intervals_shrink_with_the_noise_and_with_the_root_of_the_length() -> None:
    build, truth = DAHL.build, DAHL.truth
    width = {}
    for size, repeats in ((0.2, 1), (0.1, 1), (0.2, 4)):
        motion = np.tile(MOTION, repeats)
        force = build(truth).trace(motion, 1e-3).force + np.random.default_rng(1).normal(0.0, size, motion.size)
        result = fit(build, list(truth), truth, DAHL.bounds, Measured(motion, 1e-3, force))
        width[size, repeats] = np.ptp(result.intervals, axis=1)
    np.testing.assert_allclose(width[0.1, 1] / width[0.2, 1], 0.5, rtol=0.05)
    np.testing.assert_allclose(width[0.2, 4] / width[0.2, 1], 0.5, rtol=0.1)


def test_frozen_parameters_stay() -> None:
    build, truth = LUGRE.build, LUGRE.truth
    trace = Measured(MOTION, 1e-3, build(truth).trace(MOTION, 1e-3).force)
    result = fit(build, ["F", "s0"], {**truth, "F": 6.0, "s0": 1e6}, LUGRE.bounds, trace)
    assert result.names == ("F", "s0")
    assert result.frozen == {k: v for k, v in truth.items() if k not in ("F", "s0")}
    assert result["V"] == truth["V"]
    np.testing.assert_allclose(result.values, [8.0, 2e6], rtol=1e-6)


def test_several_starts_leave_a_local_minimum() -> None:
    """A limit that no stroke reaches at the start has no slope there: only other starts find it."""
    build, truth = TWO_ELEMENTS.build, TWO_ELEMENTS.truth
    motion = make_triangle(8e-6, 200, 2)
    trace = Measured(motion, 1e-3, build(truth).trace(motion, 1e-3).force)
    far = {"k1": 1e5, "k2": 1e5, "W1": 30.0, "W2": 30.0}
    wide = {"k1": (1e4, 1e8), "k2": (1e4, 1e8), "W1": (0.1, 50.0), "W2": (0.1, 50.0)}
    calls: list[tuple[int, int]] = []
    one = fit(build, list(truth), far, wide, trace)
    many = fit(build, list(truth), far, wide, trace, starts=8, progress=lambda done, total: calls.append((done, total)))
    assert one.rmse > 0.1
    assert many.rmse < 1e-6
    assert calls == [(i, 8) for i in range(1, 9)]


def test_interval_does_not_shrink_where_the_output_jumps() -> None:
    """A sampled model jumps where an event moves by a sample; a search likes to end there, and a jump is no slope."""
    x = np.linspace(0.0, 1.0, 200)
    y = x + np.random.default_rng(0).normal(0.0, 0.1, x.size)
    slope = float(x @ y / (x @ x))

    def width(height: float) -> float:
        def residual(theta: Array) -> Array:
            return theta[0] * x + height * (theta[0] > slope) - y

        return float(np.ptp(minimise(residual, ["slope"], np.array([slope]), np.array([[0.1, 10.0]])).intervals))

    assert width(1e-3) == pytest.approx(width(0.0), rel=0.01)


def test_parameter_that_moves_nothing_is_told() -> None:
    """Pre-sliding says nothing of a limit that is never reached."""
    build, truth = TWO_ELEMENTS.build, TWO_ELEMENTS.truth
    motion = make_triangle(3e-6, 200)  # the second element slips at 5 um
    force = build(truth).trace(motion, 1e-3).force + np.random.default_rng(0).normal(0.0, 0.01, motion.size)
    result = fit(build, list(truth), truth, TWO_ELEMENTS.bounds, Measured(motion, 1e-3, force))
    assert result.doubts == ("W2 is not identifiable: it has no influence on these data",)
    assert np.isinf(result.intervals[3]).all()
    assert np.isfinite(result.intervals[:3]).all()


def test_limit_that_is_not_reached_at_the_start_joins_the_search() -> None:
    """A spring too soft to slip: its limit changes nothing until the stiffness has been found."""

    def build(p: dict[str, float]) -> MaxwellSlip:
        return MaxwellSlip([p["k"]], [p["W"]])

    motion = make_triangle(8e-6, 200, 2)
    trace = Measured(motion, 1e-3, build({"k": 2e6, "W": 3.0}).trace(motion, 1e-3).force)
    result = fit(build, ["k", "W"], {"k": 1e5, "W": 2.0}, {"k": (1e4, 1e8), "W": (0.1, 50.0)}, trace)
    np.testing.assert_allclose(result.values, [2e6, 3.0], rtol=1e-6)
    dead = fit(build, ["W"], {"k": 1e5, "W": 9.0}, {"W": (0.1, 50.0)}, trace)
    assert dead["W"] == 9.0
    assert dead.doubts == ("W is not identifiable: it has no influence on these data",)


def test_parameters_that_are_only_known_together_are_told() -> None:
    """Two elements that never slip are one spring: only the sum of their stiffness is in the data."""
    motion = make_triangle(1e-7, 100)
    build, truth = TWO_ELEMENTS.build, TWO_ELEMENTS.truth
    force = build(truth).trace(motion, 1e-3).force + np.random.default_rng(0).normal(0.0, 1e-3, motion.size)
    result = fit(build, ["k1", "k2"], truth, TWO_ELEMENTS.bounds, Measured(motion, 1e-3, force))
    assert result.doubts == (
        "k1 and k2 are not identifiable separately: these data determine only a combination of them",
    )
    assert np.isinf(result.intervals).all()


def test_parameter_at_its_bound_is_told() -> None:
    build, truth = DAHL.build, DAHL.truth
    trace = Measured(MOTION, 1e-3, build(truth).trace(MOTION, 1e-3).force)
    result = fit(build, ["F", "s"], {**truth, "F": 5.0}, {"F": (1.0, 7.0), "s": (1e5, 1e8)}, trace)
    assert result["F"] == pytest.approx(7.0)
    assert any("F rests at its bound 7" in doubt for doubt in result.doubts)


CHAIN = {"k1": 1e5, "k2": 2e5, "W1": 10.0, "W2": 5.0}
CHAIN_BOUNDS = {"k1": (1e4, 1e6), "k2": (1e4, 1e6), "W1": (1.0, 50.0), "W2": (1.0, 50.0)}


def fit_chain(delay: float, seed: int = 1) -> Estimate:
    """Fit two Maxwell-slip elements to 4 s of their own force, `delay` [s] late, with 0.05 N of noise."""

    def build(p: dict[str, float]) -> MaxwellSlip:
        return MaxwellSlip([p["k1"], p["k2"]], [p["W1"], p["W2"]])

    time = 1e-3 * np.arange(4000)
    motion = 1e-4 * (np.sin(np.pi * time) + 0.6 * np.sin(2.6 * np.pi * time + 1.0))
    force = np.interp(time - delay, time, build(CHAIN).trace(motion, 1e-3).force)
    force = force + 0.05 * np.random.default_rng(seed).standard_normal(time.size)
    start = {name: 0.5 * value for name, value in CHAIN.items()}
    return fit(build, list(CHAIN), start, CHAIN_BOUNDS, Measured(motion, 1e-3, force), starts=3)


@pytest.mark.parametrize(
    ("delay", "expected_text"), [(0.05, "50 ms behind"), (0.005, "5 ms behind"), (-0.05, "50 ms before")]
)
def test_force_of_another_time_than_its_position_is_told(delay: float, expected_text: str) -> None:
    """Its stiffness is then half of the true one, with an interval of 1.4 %."""
    message = [doubt for doubt in fit_chain(delay).doubts if "the position" in doubt]
    assert len(message) == 1
    number, _, rest = expected_text.partition(" ")
    assert rest in message[0]
    assert float(message[0].split()[3]) == pytest.approx(float(number), rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_force_of_its_time_is_not_doubted(seed: int) -> None:
    assert fit_chain(0.0, seed).doubts == ()


def make_trace(values: list[float]) -> Measured:
    return Measured(np.arange(len(values)) * 1.0, 1.0, values)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: make_trace([0.0, np.inf, 1.0]), "force of the measured trace holds inf"),
        (lambda: replace(make_trace([0.0, 1.0, 2.0]), dt=0.0), "time step is 0 s"),
        (lambda: replace(make_trace([0.0, 1.0, 2.0]), load=np.nan), "load of the measured trace [N] holds nan"),
        (lambda: replace(make_trace([0.0, 1.0, 2.0]), load=[1, 2]), "load of the measured trace has shape (2,)"),
        (lambda: replace(make_trace([0.0, 1.0, 2.0]), load=-1.0), "least load of the measured trace is -1 N"),
        (
            lambda: fit(DAHL.build, ["F"], {"F": 1.0}, {"F": 3.0}, make_trace([0.0, 1.0, 2.0])),
            "bounds of F are 3.0; they must be two numbers",
        ),
        (
            lambda: fit(DAHL.build, ["F"], {"F": "a"}, {"F": (1.0, 3.0)}, make_trace([0.0, 1.0, 2.0])),
            "start of F is 'a'; allowed is a number",
        ),
        (lambda: fit(DAHL.build, ["F"], {"F": 1.0}, {"F": (1.0, 3.0)}, None), "measured trace is None"),
        (lambda: fit(DAHL.build, ["F"], {}, {}, make_trace([0.0, 1.0, 2.0])), "parameter 'F' has no start"),
        (
            lambda: fit(DAHL.build, ["F"], {"F": 1.0}, {}, make_trace([0.0, 1.0, 2.0])),
            "parameter 'F' has no bounds",
        ),
        (
            lambda: fit(
                DAHL.build, ["F"], {"F": 9.0, "s": 1.0, "i": 1.0}, {"F": (1.0, 2.0)}, make_trace([0.0, 1.0, 2.0])
            ),
            "start of F is 9; allowed is 1 to 2",
        ),
        (
            lambda: fit(
                DAHL.build,
                ["F"],
                {"F": 9.0, "s": 1.0, "i": 1.0},
                {"F": (1.0, inf)},
                make_trace([0.0, 1.0, 2.0]),
                starts=2,
            ),
            "several starts need finite bounds",
        ),
        (
            lambda: fit(DAHL.build, ["F", "s", "i"], DAHL.truth, DAHL.bounds, make_trace([0, 1, 2])),
            "3 samples for 3 parameters",
        ),
    ],
)
def test_bad_input_is_told_in_one_sentence(make: object, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        make()  # type: ignore[operator]
    assert sentence in str(caught.value)
