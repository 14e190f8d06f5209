"""The normal degree of freedom of XGMS (appendix E): lift-up force, film, contact and what they do to the friction."""

from math import pi, sqrt

import numpy as np
import pytest

from plant_sim.friction.lift_up import LiftingXGMS, LiftUp
from plant_sim.friction.load_law import Amontons, LoadLaw
from plant_sim.friction.xgms import XGMS
from protocols.errors import InputError

LOAD = 58.0  # N, own weight of the tribometer's upper disk
MASS = LOAD / 9.81  # kg
STIFFNESS = MASS * (2.0 * pi * 186.0) ** 2  # N/m: 186 Hz at that load
APPROACH = 1.5 * LOAD / STIFFNESS  # m, Hertz
FORCE = 8.0  # N, highest lift-up force: about 1 um
SPEED = 0.1  # m/s
AMPLITUDE, FREQUENCY = 4.5e-3, 9.0  # m, Hz: 0.06 rad at 0.075 m, fig 4.18
DT = 1e-5  # s


def make_tangential_model(**changes: object) -> XGMS:
    values = {"beta": 0.6, "stribeck_velocity": 0.02, "viscous": 0.2, "attraction": 60.0} | changes
    return XGMS(LoadLaw(0.25, 2.0, 300.0), np.full(5, 2e5), np.full(5, 0.2), **values)


def make_model(highest: float = FORCE, damping: float = 0.5, **changes: float) -> LiftingXGMS:
    values = {
        "mass": MASS,
        "stiffness": LOAD / APPROACH**1.5,
        "attraction": highest / 3e-3 if highest else 1.0,
    } | changes
    critical = 2.0 * sqrt(STIFFNESS * MASS)
    return LiftingXGMS(make_tangential_model(), LiftUp(highest, SPEED, damping=damping * critical, **values))


def make_sine(cycles: int = 4, dt: float = DT, frequency: float = FREQUENCY) -> tuple[np.ndarray, int]:
    """Position over some cycles and samples a cycle."""
    samples = 2 * round(0.5 / (frequency * dt))
    return AMPLITUDE * np.sin(2.0 * pi * np.arange(cycles * samples + 1) / samples), samples


class TestLiftUpForce:
    @pytest.mark.parametrize("speed", [0.01, 0.1, 1.0])
    def test_is_even_in_the_velocity_and_steady_at_its_curve(self, speed: float) -> None:
        m = make_model()
        forces = [m.lift_force(m.trace(v * np.arange(5001) * 1e-4, 1e-4, LOAD).state[-1]) for v in (speed, -speed)]
        assert forces[0] == forces[1]
        assert forces[0] == pytest.approx(FORCE * (1.0 - np.exp(-speed / SPEED)), rel=1e-9)

    def test_as_printed_with_the_sign_of_v_it_runs_away_backwards(self) -> None:
        """dF/dt = sign(v) C (1 - F/F_N(v)) with F_N even: stable forwards, unstable backwards."""

        def after(velocity: float, seconds: float) -> float:
            end, force, dt = FORCE * (1.0 - np.exp(-abs(velocity) / SPEED)), 0.0, 1e-5
            for _ in range(round(seconds / dt)):
                force += dt * np.sign(velocity) * FORCE / 3e-3 * (1.0 - force / end)
            return force

        assert after(0.3, 0.1) == pytest.approx(FORCE * (1.0 - np.exp(-3.0)), rel=1e-6)
        assert after(-0.3, 0.1) < -1e6 * FORCE

    def test_over_position_is_a_butterfly(self) -> None:
        position, samples = make_sine()
        m = make_model()
        state = m.trace(position, DT, LOAD).state[-samples:]
        for values in (m.lift_force(state), m.lift(state)):
            half, quarter = samples // 2, samples // 4
            np.testing.assert_allclose(values, np.roll(values, half), rtol=1e-6, atol=1e-9 * values.max())
            rising, falling = values[-quarter:], values[:quarter][::-1]  # to the middle and from it, at equal |v|
            assert rising[: quarter // 2].mean() < falling[: quarter // 2].mean()

    def test_at_rest_there_is_no_lift_and_after_stopping_the_film_squeezes_out(self) -> None:
        m = make_model()
        still = m.trace(np.zeros(1000), 1e-4, LOAD)
        assert np.all(m.lift_force(still.state) == 0.0)
        assert np.abs(m.lift(still.state)).max() < 1e-18
        moved = 0.3 * np.minimum(np.arange(6000), 2000) * 1e-4
        lift = m.lift(m.trace(moved, 1e-4, LOAD).state)
        assert lift[2000] > 0.5e-6
        assert abs(lift[-1]) < 1e-15


class TestContact:
    @pytest.mark.parametrize("load", [58.0, 280.0, 1400.0])
    def test_steady_height_is_the_balance_of_lift_contact_and_load(self, load: float) -> None:
        m = make_model()
        state = m.trace(0.2 * np.arange(5001) * 1e-4, 1e-4, load).state[-1]
        lift_force = m.steady_lift_force(0.2)
        stiffness, approach = LOAD / APPROACH**1.5, (load / (LOAD / APPROACH**1.5)) ** (2.0 / 3.0)
        assert stiffness * (approach - m.lift(state)) ** 1.5 == pytest.approx(load - lift_force, rel=1e-9)
        assert m.contact_load(state) == pytest.approx(load - lift_force, rel=1e-9)

    @pytest.mark.parametrize("load", [58.0, 1400.0])
    def test_rings_at_the_resonance_of_the_contact(self, load: float) -> None:
        """186 Hz at 58 N; of Hertz's law it grows with load^(1/6)."""
        m = make_model(damping=0.005)
        lift = m.lift(m.trace(0.001 + 0.5 * np.arange(40001) * DT, DT, load).state)
        ringing = lift[20000:] - lift[20000:].mean()
        crossings = np.flatnonzero((ringing[1:] > 0.0) & (ringing[:-1] <= 0.0))
        frequency = (len(crossings) - 1) / ((crossings[-1] - crossings[0]) * DT)
        left = load - FORCE  # the mean load of the contact
        assert frequency == pytest.approx(186.0 * (left / LOAD) ** (1.0 / 6.0), rel=0.005)

    def test_steady_friction_is_that_of_the_lighter_contact(self) -> None:
        m = make_model()
        for velocity in (0.2, -0.2):
            force = m.trace(velocity * np.arange(10001) * 1e-4, 1e-4, LOAD).force[-1]
            lighter = m.tangential.steady_state(velocity, LOAD - float(m.steady_lift_force(velocity)))
            assert force == pytest.approx(float(lighter), rel=1e-9)
            assert force == pytest.approx(float(m.steady_state(np.array([velocity]), LOAD)[0]), rel=1e-9)

    def test_without_lift_force_it_is_xgms(self) -> None:
        position, _ = make_sine(2)
        np.testing.assert_allclose(
            make_model(highest=0.0).trace(position, DT, LOAD).force[1:],
            make_tangential_model().trace(position, DT, LOAD).force[1:],
            rtol=1e-9,
        )

    @pytest.mark.parametrize("change", [{"stiffness": 1e6 * LOAD / APPROACH**1.5}, {"mass": 1e-6}])
    def test_a_stiff_contact_stays_down_and_a_massless_body_follows_the_balance_at_once(self, change: dict) -> None:
        position, samples = make_sine(2)
        m = make_model(damping=0.0 if "mass" in change else 0.5, **change)
        state = m.trace(position, DT, LOAD).state[samples:]
        if "stiffness" in change:
            assert np.abs(m.lift(state)).max() < 1e-9
        np.testing.assert_allclose(m.contact_load(state), LOAD - m.lift_force(state), atol=5e-3 * FORCE)


class TestIntegration:
    @pytest.mark.parametrize("dt", [1e-5, 1e-4, 1e-3, 1e-2])
    @pytest.mark.parametrize("highest", [8.0, 58.0, 200.0])
    def test_every_step_solves_the_motion_also_when_the_contact_is_lost(self, highest: float, dt: float) -> None:
        m = make_model(highest)
        position, _ = make_sine(6, dt, 3.0)
        state = m.trace(position, dt, LOAD).state
        lift, rate, up = m.lift(state), state[..., -2], m.normal
        tau = up.damping / STIFFNESS
        contact = up.stiffness * np.maximum(APPROACH - lift - tau * rate, 0.0) ** up.power
        push = m.lift_force(state[1:]) - LOAD + 0.5 * (contact[1:] + contact[:-1])
        np.testing.assert_allclose(MASS * np.diff(rate) / dt, push, atol=1e-9 * contact.max())
        np.testing.assert_allclose(
            np.diff(lift), 0.5 * dt * (rate[1:] + rate[:-1]), atol=1e-12 * (np.abs(lift).max() + 1e-6)
        )
        np.testing.assert_allclose(m.contact_load(state[1:]), contact[1:], atol=1e-9 * contact.max())
        if highest > LOAD * 1.5:
            assert (m.contact_load(state[1:]) == 0.0).any()

    def test_a_lost_contact_has_no_friction(self) -> None:
        m = make_model(200.0)
        trace = m.trace(0.3 * np.arange(2000) * 1e-4, 1e-4, LOAD)
        lost = m.contact_load(trace.state) == 0.0
        assert lost[1000:].all()
        assert np.all(trace.force[lost] == 0.0)

    def test_is_of_first_order_in_the_step(self) -> None:
        """The lift-up force of a step acts over the whole of it."""

        def at_end(dt: float) -> float:
            time = dt * np.arange(round(0.04 / dt) + 1)
            m = LiftingXGMS(make_tangential_model(), LiftUp(FORCE, SPEED, np.inf, MASS, LOAD / APPROACH**1.5))
            return float(m.lift(m.trace(0.02 * time + 0.5 * time**2, dt, LOAD).state)[-1])

        coarse, middle, fine = np.diff([at_end(dt) for dt in (5e-5, 2.5e-5, 1.25e-5, 6.25e-6)])
        assert coarse / middle == pytest.approx(2.0, abs=0.4)
        assert middle / fine == pytest.approx(2.0, abs=0.2)


class TestEnergy:
    def test_friction_work_always_covers_what_springs_mass_and_contact_store(self) -> None:
        """Passive in sum: from rest, no motion takes more out than it put in, with all energies counted."""
        random = np.random.default_rng(3)
        m = make_model()
        knots = np.cumsum(random.normal(0.0, 1e-3, 60))
        position = np.interp(np.arange(30000), np.linspace(0, 30000, 60), knots - knots[0])
        trace = m.trace(position, 1e-4, LOAD)
        work = np.cumsum(trace.force * np.diff(position, prepend=position[0]))
        lift, rate, stiffness = m.lift(trace.state), trace.state[..., -2], m.normal.stiffness
        contact = stiffness * np.maximum(APPROACH - lift, 0.0) ** 2.5 / 2.5 - stiffness * APPROACH**2.5 / 2.5
        stored = m.tangential.energy(trace.state) + 0.5 * MASS * rate**2 + contact + LOAD * lift
        assert stored.max() > 1e-6
        assert (work - stored).min() > -1e-12

    def test_the_damper_takes_what_the_lift_force_does_in_a_cycle(self) -> None:
        position, samples = make_sine()
        m = make_model()
        state = m.trace(position, DT, LOAD).state[-samples - 1 :]
        force, lift = m.lift_force(state), m.lift(state)
        work = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(lift))
        assert work == pytest.approx(m.normal.damping * np.sum((np.diff(lift) / DT) ** 2) * DT, rel=0.05)


@pytest.mark.parametrize(
    ("name", "value"), [("highest", -1.0), ("speed_scale", 0.0), ("mass", 0.0), ("stiffness", 0.0), ("damping", -1.0)]
)
def test_parameters_that_make_no_film_are_refused(name: str, value: float) -> None:
    values = {"highest": 8.0, "speed_scale": 0.1, "attraction": 1e3, "mass": 6.0, "stiffness": 1e9, "damping": 0.0}
    with pytest.raises(InputError, match=f"{value:g}"):
        LiftUp(**values | {name: value})


def test_amontons_friction_over_a_film_lags_by_the_film_alone() -> None:
    """Thinner film accelerating, so more friction (appendix E), without any Stribeck curve."""
    position, samples = make_sine()
    m = LiftingXGMS(XGMS(Amontons(0.25), [1e6], [1.0]), make_model().normal)
    force = m.trace(position, DT, LOAD).force[-samples:]
    quarter = samples // 4
    slowing, faster = force[quarter // 10 : quarter // 2][::-1], force[-quarter // 2 : -quarter // 10]
    assert faster.mean() > slowing.mean() > 0.0
