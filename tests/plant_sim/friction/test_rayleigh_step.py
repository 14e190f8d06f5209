"""The Rayleigh-step bearing against a numerical Reynolds equation, its limits and symmetries, and its motion against scipy."""

from itertools import product

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant_sim.friction import rayleigh_step as step
from plant_sim.friction.step_bearing import Motion, StepBearing, faces_load, squeeze_at_load
from protocols.errors import InputError
from tests.plant_sim.friction import reynolds

ALPHAS, GAPS = (0.2, 1.5, 6.0), (0.02, 0.4, 3.0)
SLIDINGS, SQUEEZES = (-2.0, 0.0, 1.7), (-1.0, 0.0, 0.6)  # Pa; squeeze over h^3, so that it matters at every gap
CASES = [
    (alpha, gap, sliding, squeeze * gap**3)
    for alpha, gap, sliding, squeeze in product(ALPHAS, GAPS, SLIDINGS, SQUEEZES)
    if sliding or squeeze
]
ROUNDING = 1e-9  # relative; the finite volumes are exact at the nodes but for the rounding of 4000 balances
QUADRATURE = 1e-6  # relative; trapezoids on 4000 cells
PAIR = (1, -1)


def find_load(alpha: float, gap: float, sliding: float, squeeze: float) -> float:
    """W_n [Pa] of a film, negative pressure cut (eq 2.50)."""
    return float(step.load_and_rate(alpha, gap, sliding, squeeze, 0.0, 0.0)[0])


@pytest.mark.parametrize(("alpha", "gap", "sliding", "squeeze"), CASES)
def test_closed_form_solves_the_reynolds_equation(alpha: float, gap: float, sliding: float, squeeze: float) -> None:
    film = reynolds.solve(alpha, gap, sliding, squeeze)
    scale = np.abs(film.pressure).max()
    assert step.ridge_pressure(alpha, gap, sliding, squeeze) == pytest.approx(film.face_force, abs=ROUNDING * scale)
    pressure = [step.pressure(alpha, gap, sliding, squeeze, x) for x in film.x]
    np.testing.assert_allclose(pressure, np.maximum(film.pressure, 0.0), rtol=0.0, atol=ROUNDING * scale)
    assert find_load(alpha, gap, sliding, squeeze) == pytest.approx(
        film.cut_load, abs=QUADRATURE * scale * (1.0 + alpha)
    )
    assert step.friction(alpha, gap, sliding, squeeze, 1.0) == pytest.approx(
        film.cut_plate_drag, rel=ROUNDING, abs=ROUNDING * scale
    )


@pytest.mark.parametrize(("alpha", "gap", "sliding", "squeeze"), CASES)
def test_friction_is_the_same_force_on_both_bodies(alpha: float, gap: float, sliding: float, squeeze: float) -> None:
    """And the minus sign printed in eqs 2.34 and 2.51 gives the shear on the stepped body without the face of its step."""
    film = reynolds.solve(alpha, gap, sliding, squeeze)
    printed = -0.5 * film.face_force + sliding / 6.0 * (1.0 / (gap + 1.0) + alpha / gap)  # 2.34 as printed, dh = 1
    scale = abs(film.plate_drag) + abs(film.face_force)
    assert film.plate_drag == pytest.approx(film.step_shear + film.face_force, abs=ROUNDING * scale)
    assert printed == pytest.approx(film.step_shear, abs=ROUNDING * scale)


@pytest.mark.parametrize(("alpha", "gap"), list(product(ALPHAS, GAPS)))
def test_uncut_load_is_that_of_the_print(alpha: float, gap: float) -> None:
    """Where no pressure is negative, eqs 2.46 and 2.49 (read from the damaged print) hold to rounding."""
    sliding, squeeze, wide = 1.3, -0.4 * gap**3, gap + 1.0
    c_1 = (alpha * sliding - 0.5 * squeeze * ((gap / wide) ** 3 + 2.0 * alpha + alpha**2)) / (gap**3 + alpha * wide**3)
    load = 0.5 * c_1 * (1.0 + alpha)
    load += 0.5 * squeeze * ((1.0 / 3.0 + alpha / 2.0) / wide**3 - alpha**3 / (6.0 * gap**3))
    assert find_load(alpha, gap, sliding, squeeze) == pytest.approx(load, rel=1e-12)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_load_of_a_closing_gap_tends_to_its_limit(alpha: float) -> None:
    """Eq 2.52 keeps alpha: the text after 2.29, which drops it, is wrong by the factor 1 + alpha."""
    loads = [find_load(alpha, gap, 2.0, 0.0) for gap in (1e-3, 1e-6, 1e-9)]
    limit = 0.5 * (1.0 + alpha) * 2.0
    assert np.abs(np.array(loads) / limit - 1.0).tolist() == pytest.approx([0.0, 0.0, 0.0], abs=4e-3)
    assert loads[-1] == pytest.approx(limit, rel=1e-8)
    assert step.threshold_sliding(alpha, loads[-1]) == pytest.approx(2.0, rel=1e-8)


def test_load_falls_with_gap_and_with_opening() -> None:
    gaps = np.geomspace(1e-3, 10.0, 200)
    for alpha in ALPHAS:
        assert np.all(np.diff([find_load(alpha, gap, 1.0, 0.0) for gap in gaps]) < 0.0)
        opening = np.linspace(-2.0, 2.0, 200)
        loads = np.array([find_load(alpha, 0.3, 1.0, squeeze) for squeeze in opening])
        assert np.all(np.diff(loads)[loads[1:] > 0.0] < 0.0)
        assert np.all(loads >= 0.0)
        assert loads[-1] == 0.0  # torn open: cavitated throughout


def test_widening_step_carries_nothing_until_it_is_squeezed() -> None:
    assert find_load(1.5, 0.1, -1.0, 0.0) == 0.0
    assert find_load(1.5, 0.1, -1.0, -0.1) > 0.0


@pytest.mark.parametrize("alpha", ALPHAS)
def test_gap_of_steady_sliding_carries_the_load(alpha: float) -> None:
    for excess in (1e-6, 1e-3, 1.0, 1e4):
        sliding = step.threshold_sliding(alpha, 0.7) * (1.0 + excess)
        assert find_load(alpha, step.steady_gap(alpha, sliding, 0.7), sliding, 0.0) == pytest.approx(0.7, rel=1e-9)
    assert step.steady_gap(alpha, step.threshold_sliding(alpha, 0.7), 0.7) == 0.0


@pytest.mark.parametrize(("alpha", "gap", "sliding"), list(product(ALPHAS, GAPS, SLIDINGS)))
def test_squeeze_balances_the_load(alpha: float, gap: float, sliding: float) -> None:
    for load in (1e-3, 0.7, 30.0):
        squeeze = squeeze_at_load(np.ones(1), alpha, gap, sliding, load)
        assert find_load(alpha, gap, sliding, squeeze) == pytest.approx(load, rel=1e-9)


@pytest.mark.parametrize(("alpha", "gap", "sliding", "squeeze"), CASES)
def test_rate_of_the_load_is_its_derivative(alpha: float, gap: float, sliding: float, squeeze: float) -> None:
    h, s = 0.3 * gap, 0.7 * gap**3
    loads = [find_load(alpha, gap + e * h, sliding, squeeze + e * s) for e in (-1e-5, 1e-5)]
    rate = step.load_and_rate(alpha, gap, sliding, squeeze, h, s)[1]
    assert rate == pytest.approx((loads[1] - loads[0]) / 2e-5, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("mass", [0.0, 1e-2, 2.0])
def test_back_to_back_steps_mirror(mass: float) -> None:
    """Odd friction, even load and gap: a bearing of two steps does not know left from right."""
    sliding = 2.0 * np.cos(np.linspace(0.0, 9.0, 800)) + 0.3
    bearing = StepBearing(1.5, 1e-3, 1e-3, mass, PAIR)
    there, back = bearing.motion(sliding, 1e-2, 1.0), bearing.motion(-sliding, 1e-2, 1.0)
    np.testing.assert_allclose(back.friction, -there.friction, rtol=1e-12)
    np.testing.assert_allclose(back.gap, there.gap, rtol=1e-12)
    np.testing.assert_allclose(back.load, there.load, rtol=1e-12)


def test_quasi_static_film_carries_the_load_at_every_instant() -> None:
    sliding = 2.0 * np.cos(np.linspace(0.0, 9.0, 800)) + 0.3
    assert StepBearing(1.5, 1e-3, 1e-3, 0.0, PAIR).motion(sliding, 1e-2, 0.4).load == pytest.approx(0.4, rel=1e-7)


@pytest.mark.parametrize(
    ("mass", "squeeze_number", "faces"),
    [(0.0, 1e-6, (1,)), (1e-2, 1e-6, (1,)), (1.0, 1e-3, (1,)), (1.0, 1e-3, PAIR), (1e-2, 1e-2, PAIR)],
)
def test_motion_agrees_with_scipy(mass: float, squeeze_number: float, faces: tuple[int, ...]) -> None:
    time = np.linspace(0.0, 1.0, 1001)
    sliding = 0.83 + 0.02 * np.sin(2 * np.pi * time) if faces == (1,) else 3.0 * np.cos(2 * np.pi * time)
    moved = StepBearing(1.5, 1e-3, squeeze_number, mass, faces).motion(sliding, time[1], 1.0)
    directions = np.array(faces, float)

    def rate(t: float, y: np.ndarray) -> list[float]:
        now = float(np.interp(t, time, sliding))
        if mass == 0.0:
            return [squeeze_at_load(directions, 1.5, y[0], now, 1.0) / squeeze_number]
        carried, _ = faces_load(directions, 1.5, y[0], now, squeeze_number * y[1], 0.0, 0.0)
        return [y[1], (carried - 1.0) / mass]

    start = [moved.gap[0]] if mass == 0.0 else [moved.gap[0], moved.speed[0]]
    solved = solve_ivp(rate, (0.0, 1.0), start, "Radau", t_eval=time, rtol=1e-7, atol=1e-11, max_step=1e-2)
    np.testing.assert_allclose(moved.gap, solved.y[0], rtol=5e-6)  # both are controlled to 1e-7 a step


def test_motion_does_not_depend_on_the_sampling() -> None:
    """The solver chooses its own steps: the same piecewise linear input, sampled four times finer, gives the same motion."""
    coarse = 0.83 + 0.02 * np.sin(np.linspace(0.0, 12.0, 201))
    fine = np.interp(np.arange(801) / 4, np.arange(201), coarse)
    bearing = StepBearing(1.5, 1e-3, 1e-6, 1e-2)
    np.testing.assert_allclose(
        bearing.motion(fine, 2.5e-3, 1.0).gap[::4], bearing.motion(coarse, 1e-2, 1.0).gap, rtol=3e-6
    )


def _simulate_last_cycle(squeeze_number: float, amplitude: float, frequency: float) -> tuple[Motion, np.ndarray]:
    """Motion in the 40th cycle, and Lambda [Pa]: from 0.81 up by `amplitude`, over a load of 1 Pa."""
    phase = 2 * np.pi * np.arange(40 * 400 + 1) / 400
    sliding = 0.81 + 0.5 * amplitude * (1.0 - np.cos(phase))
    moved = StepBearing(1.5, 1e-3, squeeze_number).motion(sliding, 1.0 / (400 * frequency), 1.0)
    return Motion(*(values[-401:] for values in (moved.gap, moved.speed, moved.load, moved.friction))), sliding[-401:]


def _measure_lag(squeeze_number: float, amplitude: float, frequency: float) -> float:
    """Area of the friction loop over Lambda; positive: friction is higher while accelerating."""
    moved, sliding = _simulate_last_cycle(squeeze_number, amplitude, frequency)
    return float(np.trapezoid(moved.friction, sliding))


def test_lag_grows_with_amplitude_and_frequency_and_vanishes_at_rest() -> None:
    assert np.all(np.diff([_measure_lag(1e-7, amplitude, 1.0) for amplitude in (0.005, 0.01, 0.02, 0.04)]) > 0.0)
    areas = np.array([_measure_lag(1e-7, 0.02, frequency) for frequency in (0.001, 0.01, 0.1)])
    assert areas[1:] / areas[:-1] == pytest.approx(
        [10.0, 10.0], rel=0.1
    )  # proportional to frequency: a first-order lag
    moved, sliding = _simulate_last_cycle(1e-7, 0.02, 1e-3)
    np.testing.assert_allclose(moved.friction, StepBearing(1.5, 1e-3, 1e-7).stribeck(sliding, 1.0), rtol=2e-3)


def test_film_below_the_threshold_closes_as_the_square_root_of_time() -> None:
    """Squeeze-film law of the narrow zone at Lambda = 0 and h << 1: h^-2 grows by 24 W t/(sigma (alpha^3 + ...))."""
    time = np.linspace(0.0, 1000.0, 101)
    moved = StepBearing(1.5, 1e-3, 1e-4, 0.0, PAIR).motion(np.zeros(time.size), time[1], 1.0, gap=1e-2)
    exact = (1e-2**-2 + 2 * 12.0 * time * 1.0 / (2 * 1e-4 * 1.5**3)) ** -0.5
    np.testing.assert_allclose(moved.gap, exact, rtol=1e-4)


def test_refuses_what_is_no_bearing() -> None:
    with pytest.raises(InputError, match="length ratio alpha is 0"):
        StepBearing(0.0, 1e-3, 1.0)
    with pytest.raises(InputError, match="faces of the bearing are"):
        StepBearing(1.5, 1e-3, 1.0, 0.0, (1, 0))
    with pytest.raises(InputError, match="load is -1 Pa"):
        StepBearing(1.5, 1e-3, 1.0).motion(np.ones(3), 1e-3, -1.0)
    with pytest.raises(InputError, match="gap at the start is 0"):
        StepBearing(1.5, 1e-3, 1.0).motion(np.full(3, 0.5), 1e-3, 1.0)  # 0.5 < Lambda_0 = 0.8
