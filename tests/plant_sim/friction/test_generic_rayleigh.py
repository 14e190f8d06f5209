"""The Generic-Rayleigh model: the Generic model below the threshold, the Rayleigh step above it, continuous between."""

from timeit import repeat

import numpy as np
import pytest

from plant_sim.friction import asperity_contact as contact
from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.counter_surface import CounterSurface, FlatSurface
from plant_sim.friction.generic import FixedSeparationModel, GenericModel
from plant_sim.friction.generic_rayleigh import GenericRayleighModel
from plant_sim.friction.rayleigh_step import steady_gap
from plant_sim.friction.step_bearing import StepBearing
from plant_sim.friction.tip_film import GapThreshold, SlidingThreshold, TipFilm
from protocols.errors import InputError

MU_0, MU_INF, TAU = 0.15, 0.2, 0.05
ALPHA, LENGTH, STEP, AREA = 1.5, 2e-4, 4e-6, 1e-6  # of a tip; dh/L = 0.02
LOAD = 0.03
FRICTION = StickTimeFriction(MU_0, MU_INF, TAU)
THRESHOLDS = (SlidingThreshold, GapThreshold)


def _make_film(tips: float) -> TipFilm:
    """A film under which a tip that bears LOAD/tips begins to ride at velocity 1 (length unit/s)."""
    unit = TipFilm(ALPHA, LENGTH, STEP, AREA, 1.0)
    needed = unit.ratio(unit.gap_at(MU_0)) * LOAD / tips / AREA
    return TipFilm(ALPHA, LENGTH, STEP, AREA, needed / unit.sliding_per_velocity)


def _make_single(threshold: type[SlidingThreshold] = SlidingThreshold) -> GenericRayleighModel:
    """One tip on a flat surface; it begins to ride at velocity 1."""
    film = _make_film(1.0)
    dry = GenericModel(Asperities(np.zeros(1), np.zeros(1), np.ones(1)), FlatSurface(), FRICTION)
    return GenericRayleighModel(dry, film, threshold.at_friction(film, MU_0))


def _make_rough(count: int = 100, seed: int = 3, roughness: float = 0.05, flat: bool = False) -> GenericRayleighModel:
    """Tips over steps, on half of the length; the mean one begins to ride at velocity 1."""
    rng = np.random.default_rng(seed)
    asperities = Asperities.draw(count, rng, roughness=roughness)
    surface = FlatSurface() if flat else CounterSurface.draw(30, rng)
    film = _make_film(0.5 * count)
    dry = GenericModel(asperities, surface, FRICTION)
    return GenericRayleighModel(dry, film, SlidingThreshold.at_friction(film, MU_0))


def _make_accelerating_path(peak: float, samples: int) -> tuple[np.ndarray, float]:
    """Position, up to velocity `peak` and back to 0 along a half sine in one unit of time; and the time step."""
    time = np.linspace(0.0, 1.0, samples)
    return peak / np.pi * (1.0 - np.cos(np.pi * time)), time[1]


def test_below_the_threshold_it_is_the_generic_model_to_the_bit() -> None:
    model = _make_rough(roughness=0.0)
    position = 0.5 * np.sin(np.linspace(0.0, 8.0, 1500))
    dt = 0.5 * (8.0 / 1500) / 0.05  # velocity up to 0.05, the threshold of the least loaded tip is above it
    run = model.observe(position, dt, LOAD)
    assert run.wet.max() == 0.0
    assert run.dry.max() > 0.0
    np.testing.assert_array_equal(run.force, model.dry.trace(position, dt, LOAD).force)


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_force_is_continuous_at_every_transition_but_break_away(threshold: type[SlidingThreshold]) -> None:
    """Steps of the force shrink in proportion to the time step, through dry to wet slip and back to dry."""
    model, steps = _make_single(threshold), []
    for samples in (20001, 40001):
        position, dt = _make_accelerating_path(4.0, samples)
        played = model.trace(position, dt, LOAD)
        mode, wet = played.state[:, 2], model.gaps(played.state)[:, 0] > 0.0
        assert wet.any()
        assert np.flatnonzero(np.diff(wet.astype(int))).size == 2  # once lifted, once put down
        after_break_away = np.flatnonzero(mode == contact.SLIP_UP)[0] + 1
        steps.append(np.abs(np.diff(played.force[after_break_away:])).max() / (MU_0 * LOAD))
    assert steps[1] < 0.6 * steps[0] < 0.05


def test_life_cycle_is_stick_dry_slip_wet_slip() -> None:
    model = _make_single()
    position, dt = _make_accelerating_path(10.0, 20001)
    state = model.trace(position[:10001], dt, LOAD).state
    stage = np.where(state[:, 2] == contact.STICK, 0, np.where(model.gaps(state)[:, 0] > 0.0, 2, 1))
    assert np.array_equal(np.unique(stage), [0, 1, 2])
    assert np.all(np.diff(stage) >= 0)


def test_peak_is_the_break_away_force_of_dry_contact() -> None:
    position, dt = _make_accelerating_path(4.0, 40001)
    force = _make_single().trace(position, dt, LOAD).force[:20001] / LOAD
    assert MU_0 < force.max() <= MU_INF
    assert force[-1] < 0.7 * MU_0  # riding


@pytest.mark.parametrize("velocity", [1.5, 4.0, 30.0, -4.0])
def test_long_sliding_is_the_steady_rayleigh_step(velocity: float) -> None:
    model = _make_single()
    gap = steady_gap(ALPHA, model.film.sliding_per_velocity * abs(velocity), LOAD / AREA)
    exact = np.sign(velocity) * LOAD * model.film.coefficient(gap)
    assert model.steady_state(velocity, LOAD) == pytest.approx(exact, rel=1e-6)


def test_wet_tip_moves_as_the_bearing_does() -> None:
    """One tip under constant load is the quasi-static bearing of two steps: two programs, one motion."""
    model = _make_single(GapThreshold)
    start = model.observe(np.linspace(0.0, 10.0, 20001), 10.0 / 20000 / 4.0, LOAD).state  # riding at velocity 4
    time = np.linspace(0.0, 0.02, 4001)
    velocity = 4.0 + 2.0 * np.sin(2 * np.pi * time / 0.01)
    position = 10.0 + np.concatenate(([0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * time[1])))
    played = model.trace(position, time[1], LOAD, start)
    bearing = StepBearing(ALPHA, STEP / LENGTH, model.film.squeeze_number, 0.0, (1, -1))
    gap = float(model.gaps(start)[0])
    moved = bearing.motion(model.film.sliding_per_velocity * velocity, time[1], LOAD / AREA, gap)
    np.testing.assert_allclose(model.gaps(played.state)[:, 0], moved.gap, rtol=2e-3)  # backward Euler, 4000 steps
    np.testing.assert_allclose(played.force[1:], AREA * moved.friction[1:], rtol=2e-2)


def test_all_regimes_follow_each_other_with_speed() -> None:
    """Boundary: dry friction. Mixed: some tips ride, friction falls. Hydrodynamic: nearly all ride, friction rises."""
    model = _make_rough()
    position = np.linspace(0.0, 3.0, 3001)
    force, wet = [], []
    for velocity in (1e-3, 0.3, 1.0, 3.0, 30.0):
        run = model.observe(position, 1e-3 / velocity, LOAD)
        slipping = run.dry[1000:] + run.wet[1000:]
        force.append(run.force[1000:].mean() / LOAD)
        wet.append(float(np.mean(run.wet[1000:] / slipping)))
    dry = model.dry.observe(position, 1.0, LOAD).force[1000:].mean() / LOAD
    assert force[0] == pytest.approx(dry, rel=1e-2)
    assert wet[0] < 0.02
    assert 0.1 < wet[2] < 0.9
    assert wet[4] > 0.99
    assert force[0] > force[1] > force[2] > force[3]
    assert force[4] > 1.5 * force[3]


def test_riding_lifts_the_body() -> None:
    """Under the same load the body rides higher at speed, by part of the thickness of the films."""
    model = _make_rough(flat=True)
    position = np.linspace(0.0, 1.0, 2001)
    slow, fast = (model.observe(position, 5e-4 / velocity, LOAD) for velocity in (1e-3, 10.0))
    lift = fast.separation[-1] - slow.separation[-1]
    assert 0.1 * STEP < lift < STEP * model.gaps(fast.state).max()


def test_static_friction_grows_with_rest_once_the_film_is_squeezed_out() -> None:
    peaks = []
    for rest in (0.001, 0.03, 0.1, 1.0):  # the film falls to h_thr in 0.02
        model, dt = _make_single(GapThreshold), 1e-4
        state = model.observe(np.linspace(0.0, 1.0, 2001), dt, LOAD).state  # riding at velocity 5
        state = model.observe(np.full(round(rest / dt) + 1, 1.0), dt, LOAD, state).state
        start = model.observe(np.linspace(1.0, 1.1, 2001), dt, LOAD, state)
        peaks.append(start.force.max() / LOAD)
    assert peaks[0] == pytest.approx(MU_0)  # it has no more than dry slip
    assert np.all(np.diff(peaks) > 0.0)
    assert peaks[-1] <= MU_INF


def test_mirrored_surface_mirrors_the_force() -> None:
    model, period = _make_rough(), 0.0
    surface, a = model.dry.surface, model.dry.asperities
    assert isinstance(surface, CounterSurface)
    period = surface.period
    mirrored = CounterSurface(surface.width[::-1], np.roll(surface.gap[::-1], -1))
    other = Asperities(period - surface.gap[-1] - a.position, a.height, a.stiffness, a.mass, a.poisson)
    twin = GenericRayleighModel(GenericModel(other, mirrored, FRICTION), model.film, model.threshold)
    position = 0.3 * np.sin(np.linspace(0.0, 8.0, 1500))
    dt = 0.3 * (8.0 / 1500) / 2.0
    run, back = model.observe(position, dt, LOAD), twin.observe(-position, dt, LOAD)
    assert run.wet.max() > 10.0
    np.testing.assert_allclose(back.force, -run.force, rtol=0.0, atol=1e-9 * LOAD)


def test_force_converges_with_the_time_step() -> None:
    """Continuous speed through all regimes: halving the step halves the error."""
    model = _make_rough(flat=True)
    forces = []
    for samples in (1001, 2001, 4001, 16001):
        position, dt = _make_accelerating_path(6.0, samples)
        forces.append(model.observe(position, dt, LOAD).force[:: (samples - 1) // 1000])
    errors = [float(np.sqrt(np.mean((force - forces[-1]) ** 2))) / LOAD for force in forces[:-1]]
    assert errors[1] < 0.65 * errors[0]
    assert errors[2] < 0.65 * errors[1]
    assert errors[2] < 2e-3


def test_no_tip_is_above_dry_friction_where_it_begins_to_slip_wet() -> None:
    """Break-away at ten times the threshold speed: the film starts as thick as the force of dry slip needs, without a peak."""
    model = _make_single()
    force = model.observe(np.linspace(0.0, 2.0, 4001), 2.0 / 4000 / 10.0, LOAD).force / LOAD
    assert force.max() <= MU_INF
    slipping = force[np.argmax(force) + 1 :]
    assert slipping.max() <= MU_0 * (1.0 + 1e-9)


def test_threshold_at_the_largest_dry_coefficient_is_never_above_it() -> None:
    """The choice of sec. 2.4.2: the steady curve jumps from mu_0 to mu_inf at the threshold, and no more."""
    model = _make_single()
    high = GenericRayleighModel(model.dry, model.film, SlidingThreshold.at_friction(model.film, MU_INF))
    speeds = np.array([0.5, 0.9, 0.95, 0.97, 1.0, 1.1, 2.0])
    friction = high.steady_state(speeds, LOAD) / LOAD
    assert MU_0 < friction.max() <= MU_INF * (1.0 + 1e-9)
    assert friction[0] == pytest.approx(MU_0)
    assert friction[-1] == pytest.approx(float(model.steady_state(2.0, LOAD)) / LOAD, rel=1e-6)


def test_any_motion_under_any_load_stays_finite() -> None:
    """Jumps of load and velocity, loss of all load, standstill: no tip pulls, and no film is left without a tip in slip."""
    rng, model = np.random.default_rng(5), _make_rough(40)
    velocity = rng.choice([0.0, 0.1, 1.0, 10.0, 100.0], 3000) * rng.standard_normal(3000)
    load = LOAD * rng.choice([0.0, 0.01, 1.0, 3.0], 3000) * rng.random(3000)
    played = model.trace(np.cumsum(velocity) * 1e-3, 1e-3, load)
    assert np.isfinite(played.force).all()
    mode, gap = model.dry.split(played.state[:, : -model.gaps(played.state).shape[1]])[2], model.gaps(played.state)
    assert (gap >= 0.0).all()
    assert (gap > 0.0).any()
    assert not (gap[np.isin(mode, (contact.FREE, contact.STICK))] > 0.0).any()


def test_five_thousand_asperities_run_at_interactive_speed() -> None:
    model = _make_rough(count=5000)
    position = np.linspace(0.0, 0.03, 31)  # velocity 1: dry and wet tips
    each = min(repeat(lambda: model.observe(position, 1e-3, LOAD), number=1, repeat=10)) / 30  # s
    assert each < 20e-3  # 1 to 2 ms measured


def test_refuses_a_threshold_that_makes_a_jump() -> None:
    film = _make_film(1.0)
    dry = GenericModel(Asperities(np.zeros(1), np.zeros(1), np.ones(1)), FlatSurface(), FRICTION)
    with pytest.raises(InputError, match=r"film at the threshold is 0\.3; allowed is mu_0 to mu_inf"):
        GenericRayleighModel(dry, film, SlidingThreshold.at_friction(film, 0.3))
    with pytest.raises(InputError, match="gap of the threshold is 2"):
        GenericRayleighModel(dry, film, SlidingThreshold(2.0))
    with pytest.raises(InputError, match="friction coefficient where the film begins is"):
        SlidingThreshold.at_friction(film, 0.01)
    fixed = FixedSeparationModel(dry.asperities, dry.surface, FRICTION, 0.9)
    with pytest.raises(InputError, match="fixed separation"):
        GenericRayleighModel(fixed, film, SlidingThreshold.at_friction(film, MU_0))


def test_what_is_no_motion_is_refused() -> None:
    """By `observe` as by `trace`."""
    model = _make_rough(5)
    for ask in (model.observe, model.trace):
        for position, sentence in (
            ([], "position has shape"),
            ([[0.0, 1.0]], "position has shape"),
            ([0.0, np.nan], "holds nan"),
            ([0.0, 1e18], "displacement of one sample is 1e"),
        ):
            with pytest.raises(InputError, match=sentence):
                ask(position, 1e-3, LOAD)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="displacement is 1e"):
        model.step(model.rest(LOAD), 1e18, 1e-3, LOAD)
    with pytest.raises(InputError, match="dry model is 'x'"):
        GenericRayleighModel("x", model.film, model.threshold)  # type: ignore[arg-type]


def test_models_are_equal_only_to_themselves() -> None:
    first, second = _make_rough(5), _make_rough(5)
    assert first == first
    assert first != second
    assert len({first, second}) == 2
