"""Generic model: what many asperities must do together, and what one must do alone."""

from dataclasses import replace
from timeit import repeat

import numpy as np
import pytest
from scipy.optimize import brentq

from plant_sim.friction import asperity_contact as contact
from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.counter_surface import CounterSurface, FlatSurface, segment_at
from plant_sim.friction.generic import DynamicGenericModel, FixedSeparationModel, GenericModel

LOAD, DT = 0.05, 1e-3
AGEING, CONSTANT = StickTimeFriction(0.2, 0.4, 0.5), StickTimeFriction(0.2, 0.2, 0.5)
TIME = np.arange(0.0, 2.0 * np.pi, DT)
SINE = 0.5 * np.sin(TIME)
ROUNDING = 1e-12  # of forces of order LOAD, summed over some hundred asperities
BALANCE = 1e-9  # of the load; rounding of the sum over the asperities
RATIO = 1.7 / 1.4  # k_n/k_t at nu 0.3


def make_asperities(count: int = 250, mass: float = 0.0, roughness: float = 0.05) -> Asperities:
    return Asperities.draw(count, np.random.default_rng(1), mass=mass, roughness=roughness)


def make_surface(fill: float = 0.5) -> CounterSurface:
    return CounterSurface.draw(100, np.random.default_rng(2), fill)


def make_stepped_model(friction: StickTimeFriction = AGEING, mass: float = 0.0, count: int = 250) -> GenericModel:
    return GenericModel(make_asperities(count, mass), make_surface(), friction)


def make_flat_model(friction: StickTimeFriction = AGEING, count: int = 250) -> GenericModel:
    return GenericModel(make_asperities(count), FlatSurface(), friction)


def make_random_path(seed: int, samples: int = 3000) -> np.ndarray:
    """A random path with many reversals, through many steps of the surface; at most 0.003 in a sample."""
    steps = np.random.default_rng(seed).standard_normal(samples // 30)
    path = np.concatenate(([0.0], np.cumsum(np.repeat(steps, 30)))) * 1e-3
    return path[: samples + 1]


# Many asperities


def test_loop_closes_when_only_adhesion_acts() -> None:
    force = make_flat_model(CONSTANT).observe(np.concatenate((SINE, SINE, SINE)), DT, LOAD).force.reshape(3, -1)
    assert force[2] == pytest.approx(force[1], abs=ROUNDING)


def test_loop_over_steps_repeats_from_the_second_period_on() -> None:
    force = make_stepped_model().observe(np.concatenate((SINE, SINE, SINE)), DT, LOAD).force.reshape(3, -1)
    assert force[2] == pytest.approx(force[1], abs=ROUNDING)


def test_friction_is_odd() -> None:
    """The mirror image of surface and asperities, moved the other way, gives exactly the opposite force."""
    model, s, path = make_stepped_model(mass=0.01), make_surface(), make_random_path(3)
    axis = s.edges[-1]  # the end of the last step
    image = CounterSurface(s.width[::-1], np.roll(s.gap[::-1], -1))
    mirrored = replace(
        model, asperities=replace(model.asperities, position=axis - model.asperities.position), surface=image
    )
    forward, backward = model.observe(path, DT, LOAD), mirrored.observe(-path, DT, LOAD)
    assert np.ptp(forward.force) > LOAD * 0.2
    assert backward.force == pytest.approx(-forward.force, abs=ROUNDING)
    assert backward.separation == pytest.approx(forward.separation, abs=ROUNDING)


def test_order_of_the_asperities_does_not_matter() -> None:
    model = make_stepped_model(mass=0.01)
    a, order = model.asperities, np.random.default_rng(5).permutation(250)
    shuffled = Asperities(a.position[order], a.height[order], a.stiffness[order], a.mass[order])
    force = replace(model, asperities=shuffled).observe(make_random_path(4), DT, LOAD).force
    assert force == pytest.approx(model.observe(make_random_path(4), DT, LOAD).force, abs=ROUNDING)


@pytest.mark.parametrize("moving_load", [False, True])
def test_every_asperity_is_passive(moving_load: bool) -> None:
    """Work put into each asperity is never less than the rise of the energy of its spring."""
    path = make_random_path(6)
    load = LOAD * (1.0 + 0.8 * np.sin(np.arange(path.size) / 50.0) * moving_load)
    model = make_stepped_model()
    force = model.split(model.trace(path, DT, load).state)[0]
    work = force[1:] * np.diff(path)[:, None]  # of the force at the end of each step, as a rig's solver takes it
    stored = np.diff(force**2, axis=0) / (2.0 * model.asperities.stiffness)
    assert (work - stored).min() >= -1e-18
    assert work.sum() > 0.0


@pytest.mark.parametrize("amplitude", [0.002, 0.02, 0.5])
def test_a_closed_cycle_dissipates(amplitude: float) -> None:
    path = amplitude * np.sin(TIME)
    force = make_stepped_model(mass=0.01).observe(np.concatenate((path, path)), DT, LOAD).force[path.size :]
    assert np.trapezoid(force, path) > 0.0


def test_without_reach_there_is_no_friction() -> None:
    model = FixedSeparationModel(make_asperities(mass=0.01), make_surface(), AGEING, 5.0)
    assert np.all(model.observe(SINE, DT).force == 0.0)


def test_sliding_friction_is_the_load_times_the_coefficient_on_a_flat_surface() -> None:
    for load in (0.001, 0.05, 1.0):
        assert make_flat_model().steady_state(np.array([0.1, -0.1, 0.0]), load) == pytest.approx(
            [0.2 * load, -0.2 * load, 0.0], rel=1e-9
        )


def test_amontons_over_steps() -> None:
    """Friction over load falls by 7.1 % over a decade of load: the way in stick, c mu zeta, grows against the step width."""
    model = make_stepped_model(CONSTANT, count=2000)
    level = np.array([float(model.steady_state(0.2, load)) / load for load in (0.01, 0.02, 0.05, 0.1)])
    assert np.all(np.diff(level) < 0.0)
    assert level[-1] / level[0] == pytest.approx(1.0 - 0.071, abs=0.005)
    assert level[0] == pytest.approx(0.2, rel=0.07)


def test_impacts_take_half_m_v_squared_at_every_step() -> None:
    """The mean force of the impacts is m v^2/2 per passage, from each asperity that reaches the steps (eq 2.9)."""
    speed = np.array([0.2, -0.4])
    separation = 0.9
    heavy = FixedSeparationModel(make_asperities(mass=0.01), make_surface(), CONSTANT, separation)
    light = FixedSeparationModel(make_asperities(), make_surface(), CONSTANT, separation)
    reaching = np.mean(1.0 - heavy.asperities.height > separation)
    expected = np.sign(speed) * reaching * 0.01 * speed**2 / 2.0 * 100 / make_surface().period
    # the mean over one period of the surface is taken at 5000 samples, the pitches differ: 1/5000 of the jumps between them
    assert heavy.steady_state(speed) - light.steady_state(speed) == pytest.approx(expected, rel=2e-3)


# Load balance


@pytest.mark.parametrize("load", [0.0, 1e-6, 0.05, 10.0])
@pytest.mark.parametrize("guess", [-5.0, 0.95, 50.0])
@pytest.mark.parametrize("slope", [0.0, 3.0])
def test_balance_is_found_from_any_guess(load: float, guess: float, slope: float) -> None:
    a = make_asperities()
    reach = np.where(np.arange(250) % 3 == 0, -np.inf, 1.0 - a.height)

    def excess(z: float) -> float:
        return float((a.normal_stiffness * np.maximum(0.0, reach - z)).sum()) - load - slope * z

    result = contact.balanced_separation(reach, a.normal_stiffness, load, slope, guess)
    assert abs(excess(result)) <= BALANCE * max(load, 1.0)
    if load > 0.0:
        assert result == pytest.approx(brentq(excess, -50.0, 50.0, xtol=1e-14), abs=1e-11)


def test_asperities_bear_the_load_at_every_sample() -> None:
    load = LOAD * (1.0 + 0.9 * np.sin(7.0 * TIME))
    seen = make_stepped_model().observe(SINE, DT, load)
    assert np.abs(seen.normal_force / load - 1.0).max() < BALANCE
    assert seen.touching.min() > 0


def test_a_body_without_asperities_over_steps_stays() -> None:
    assert contact.balanced_separation(np.full(3, -np.inf), np.ones(3), 1.0, 0.0, 0.7) == 0.7


def test_nothing_exceeds_its_limit_when_the_load_falls() -> None:
    path = 0.03 * np.sin(3.0 * TIME)
    load = LOAD * np.exp(-0.5 * TIME)
    model = make_stepped_model()
    states = model.trace(path, DT, load).state
    force, stick_time, mode, _ = model.split(states)
    normal = model.asperities.normal_stiffness * (1.0 - model.asperities.height - states[:, -2:-1])
    limit = np.where(mode == contact.FREE, 0.0, AGEING(stick_time) * normal)
    assert np.all(np.abs(force) <= limit * (1.0 + 1e-12) + 1e-18)


def test_body_with_mass_vibrates_at_its_contact_frequency() -> None:
    """All asperities at one height: k_n of all and M make a linear oscillator; damping ratio C/(2 M omega) + omega dt/2."""
    body, mass, dt = make_asperities(roughness=0.0), 1.0, 1e-3
    omega = np.sqrt(RATIO / mass)
    model = DynamicGenericModel(body, FlatSurface(), CONSTANT, mass, 0.02)
    t = np.arange(0.0, 30.0, dt)
    start = model.rest(0.05)
    z = model.observe(np.zeros(t.size), dt, 0.051, start).separation
    zeta = 0.02 / (2.0 * mass * omega) + omega * dt / 2.0
    still = start[-2] - 0.001 / RATIO
    expected = still + 0.001 / RATIO * np.exp(-zeta * omega * t) * np.cos(omega * np.sqrt(1.0 - zeta**2) * t)
    # the missing part of first order is zeta sin, and the phase drifts by (omega dt)^2 t/3
    assert np.abs(z - expected).max() < 0.02 * 0.001 / RATIO


def test_a_body_without_mass_is_the_quasi_static_one() -> None:
    dynamic = DynamicGenericModel(make_asperities(), make_surface(), AGEING, 0.0, 0.0)
    assert np.array_equal(dynamic.observe(SINE, DT, LOAD).force, make_stepped_model().observe(SINE, DT, LOAD).force)


def test_a_heavy_body_lifts_off_and_lands() -> None:
    model = DynamicGenericModel(make_asperities(), FlatSurface(), AGEING, 1.0, 0.5)
    load = np.full(40000, LOAD)
    start = model.rest(LOAD)
    start[-1] = 0.5  # thrown upwards: it flies for 2 v M/W = 20
    seen = model.observe(np.zeros(load.size), DT, load, start)
    assert np.any(seen.touching == 0)
    assert seen.normal_force[-1] == pytest.approx(LOAD, rel=0.01)


# Stick time


def measure_breakaway(model: GenericModel, rest: float, speed: float = 0.2) -> float:
    state = model.step(model.rest(LOAD), 0.0, rest, LOAD)[1]
    path = np.linspace(0.0, 0.1, 1001)
    return float(model.observe(path, path[1] / speed, LOAD, state).force.max()) / LOAD


def test_breakaway_grows_with_rest_time_and_saturates() -> None:
    model = replace(make_flat_model(), friction=StickTimeFriction(0.2, 0.4, 50.0))
    level = np.array([measure_breakaway(model, rest) for rest in (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)])
    assert np.all(np.diff(level) > 0.0)
    assert level[-1] - level[-2] < 0.01 * (level[-1] - level[0])
    assert 0.2 < level[0] < level[-1] < 0.4


def test_one_asperity_breaks_away_at_its_aged_coefficient() -> None:
    single = GenericModel(
        Asperities(np.zeros(1), np.zeros(1), np.ones(1)), FlatSurface(), StickTimeFriction(0.2, 0.4, 50.0)
    )
    assert measure_breakaway(single, 50.0, speed=1e3) == pytest.approx(
        0.2 + 0.2 * (1.0 - np.exp(-1.0)), rel=0.01
    )  # 1 % = one sample


def test_one_asperity_drops_to_the_coefficient_of_slip_at_once() -> None:
    single = GenericModel(Asperities(np.zeros(1), np.zeros(1), np.ones(1)), FlatSurface(), AGEING)
    force = single.observe(np.linspace(0.0, 0.1, 1001), 0.01, LOAD).force
    first = int(np.argmax(np.diff(force) < 0.0)) + 1
    assert force[first - 1] > 1.5 * 0.2 * LOAD
    assert force[first:] == pytest.approx(np.full(1001 - first, 0.2 * LOAD), rel=1e-9)


def test_equal_coefficients_leave_no_overshoot_and_no_rate() -> None:
    model = make_flat_model(CONSTANT)
    assert np.abs(model.observe(SINE, DT, LOAD).force).max() <= 0.2 * LOAD * (1.0 + ROUNDING)
    slow, fast = (
        make_stepped_model(CONSTANT).observe(SINE, 10.0, LOAD).force,
        make_stepped_model(CONSTANT).observe(SINE, 1e-4, LOAD).force,
    )
    assert np.array_equal(slow, fast)
    assert measure_breakaway(model, 1.0) == measure_breakaway(model, 1000.0)


def test_breakaway_falls_with_the_rate() -> None:
    level = [measure_breakaway(make_flat_model(), 1e-9, speed) for speed in (0.01, 0.03, 0.1, 0.3, 1.0)]
    assert np.all(np.diff(level) < 0.0)


def test_stick_begins_at_reversal_and_at_standstill() -> None:
    model = make_flat_model()
    sliding = model.observe(np.linspace(0.0, 0.3, 301), DT, LOAD)
    assert sliding.sticking[-1] == 0
    for displacement in (0.0, -1e-6):
        _, _, mode, _ = model.split(model.step(sliding.state, displacement, DT, LOAD)[1])
        assert np.all(mode[mode != contact.FREE] == contact.STICK)


def test_no_chatter() -> None:
    """On a flat surface each asperity changes between stick and slip twice in a period, whatever the time step."""
    for dt in (1e-2, 1e-3):
        t = np.arange(0.0, 4.0 * np.pi, dt)
        model = make_flat_model()
        _, _, mode, _ = model.split(model.trace(0.5 * np.sin(t), dt, LOAD).state)
        assert np.count_nonzero(np.diff(mode, axis=0), axis=0).max() <= 1 + 4 * 2


# Time steps


def test_one_asperity_lives_through_its_contact() -> None:
    """Free over the recess, stick from the edge on, slip, loss at the far edge with all force: at any sampling."""
    zeta, k = 0.5, 2.0
    one = Asperities(np.array([-0.3]), np.zeros(1), np.array([k]))
    model = FixedSeparationModel(one, CounterSurface(np.ones(1), np.ones(1)), CONSTANT, 1.0 - zeta)
    slip = 0.2 * RATIO * zeta  # deflection
    x = np.linspace(0.0, 1.9, 38)  # base at -0.3 .. 1.6, every 0.05
    base = x - 0.3
    expected = np.where((base > 0.0) & (base < 1.0 + slip), k * np.minimum(base, slip), 0.0)
    assert model.trace(x, DT).force == pytest.approx(expected, abs=1e-12)
    state = model.observe(x, DT).state
    back = model.observe(x[::-1], DT, state=state)  # lands on the far edge, drags the other way, leaves at the near one
    base = base[::-1]
    expected = np.where((base < 1.0) & (base > -slip), -k * np.minimum(1.0 - base, slip), 0.0)
    assert back.force == pytest.approx(expected, abs=1e-12)


def test_a_contact_that_begins_within_a_step_has_stuck_for_the_rest_of_it() -> None:
    one = Asperities(np.array([-0.3]), np.zeros(1), np.array([2.0]))
    model = FixedSeparationModel(one, CounterSurface(np.ones(1), np.ones(1)), AGEING, 0.5)
    state = model.rest()
    for moved, time in ((0.29, 0.0), (0.04, 0.75 * DT), (0.0, 1.75 * DT)):  # to 0.01 before the edge, 0.03 beyond, on
        _, state = model.step(state, moved, DT)
        assert model.split(state)[1][0] == pytest.approx(time, rel=1e-9)


def test_a_long_step_is_divided() -> None:
    """One step over some ten pitches is the same as short ones over the same way: no contact is passed unseen."""
    model = make_stepped_model(mass=0.01)
    narrowest = model.surface.narrowest
    pieces = 200
    travel = 0.999 * pieces * narrowest
    force, state = model.step(model.rest(LOAD), travel, 1.0, LOAD)
    seen = model.observe(np.linspace(0.0, travel, pieces + 1), 1.0 / pieces, LOAD)
    assert travel > 2.0
    assert force == pytest.approx(seen.force[-1], abs=ROUNDING)
    assert model.split(state)[2] == pytest.approx(model.split(seen.state)[2])


def test_no_tip_is_beyond_its_step() -> None:
    """At travel of 90 % of the narrowest segment per sample, all tips in contact are over the step they are held to be on."""
    model = make_stepped_model()
    x = 0.9 * model.surface.narrowest * np.arange(2000)
    states = model.trace(x, DT, LOAD).state
    force, _, mode, place = model.split(states[1:])
    tip = model.asperities.position + states[1:, -3:-2] - force / model.asperities.stiffness
    edges, period = model.surface.edges, model.surface.period
    held = mode == contact.STICK
    low = edges[(place % edges.size).astype(int)] + place // edges.size * period
    upper = place + 1
    high = edges[(upper % edges.size).astype(int)] + upper // edges.size * period
    assert np.all(place[held] % 2 == 0)
    assert np.all((tip >= low - 1e-9)[held] & (tip <= high + 1e-9)[held])


def test_refinement_of_the_time_step_converges() -> None:
    """Mean difference to steps 16 times finer: less than 1 % of the friction at 1 ms, and falling."""
    error = []
    for dt in (4e-3, 2e-3, 1e-3):
        fine = np.arange(0.0, 6.0, dt / 16.0)
        reference = make_stepped_model().observe(0.5 * np.sin(fine), dt / 16.0, LOAD).force[::16]
        coarse = make_stepped_model().observe(0.5 * np.sin(fine[::16]), dt, LOAD).force
        error.append(np.abs(coarse - reference).mean() / (0.2 * LOAD))
    assert np.all(np.diff(error) < 0.0)
    assert error[-1] < 0.01


def test_law_may_write_over_its_state() -> None:
    model = make_stepped_model(mass=0.01)
    state = model.rest(LOAD)
    force, new = model.step(state, 0.01, DT, LOAD)
    assert model.law(model.parameters, state, 0.01, DT, LOAD, state) == force
    assert np.array_equal(state, new)


def test_5000_asperities_run_at_interactive_speed(record_property: pytest.FixtureRequest) -> None:
    """Measured 0.13 ms a step on one core of a 2-core Xeon; ten times that is allowed.

    The fastest of ten: a host that takes the CPU away does not do so every time.
    """
    model = make_stepped_model(mass=0.01, count=5000)
    each = min(repeat(lambda: model.observe(SINE[:500], DT, LOAD), number=1, repeat=10)) / 499
    record_property("ms_per_step", 1e3 * each)  # type: ignore[operator]
    assert each < 1.3e-3


# Surface and parameters


def test_surface_has_the_fill_degree_asked_for() -> None:
    drawn = CounterSurface.draw(100, np.random.default_rng(0), fill=0.7, pitch=0.5)
    assert drawn.width.sum() / drawn.period == pytest.approx(0.7)
    assert drawn.period == pytest.approx(50.0)
    at = np.random.default_rng(1).uniform(-200.0, 200.0, 20000)
    over = np.mean([segment_at(p, 0, drawn.edges, drawn.period) % 2 == 0 for p in at])
    assert over == pytest.approx(0.7, abs=0.01)  # 3 standard deviations of 20000 draws


def test_a_seed_gives_one_model() -> None:
    assert np.array_equal(make_stepped_model().parameters, make_stepped_model().parameters)
    first, second = (Asperities.draw(5, np.random.default_rng(seed)).height for seed in (1, 2))
    assert not np.array_equal(first, second)


def test_a_second_observation_begins_with_the_force_that_is_held() -> None:
    model, there = make_stepped_model(), np.linspace(0.0, 0.3, 301)
    first = model.observe(there, DT, LOAD)
    rest = model.observe(there[-1:], DT, LOAD, first.state)
    assert rest.force[0] == model.trace(there[-1:], DT, LOAD, first.state).force[0] != 0.0
    assert rest.force[0] == pytest.approx(first.force[-1], rel=1e-3)


def test_models_are_equal_only_to_themselves() -> None:
    first, second = make_stepped_model(count=5), make_stepped_model(count=5)
    assert first == first
    assert first != second
    assert len({first, second, first.asperities, second.asperities, first.surface, second.surface}) == 6
