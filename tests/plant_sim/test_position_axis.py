"""The position axis of section 5.9: mass, friction, PID, and feedforwards identified from its own runs."""

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.counter_surface import FlatSurface
from plant_sim.friction.generic import DynamicGenericModel, GenericModel
from plant_sim.friction.gms import GMS
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import FrictionModel
from plant_sim.friction.stribeck import Stribeck
from plant_sim.rigs import position_identification as identification
from plant_sim.rigs.position_axis import PositionAxis, Run, load_nominal, load_nominal_friction
from plant_sim.rigs.position_feedforward import (
    Feedforward,
    Frictionless,
    join_trajectories,
    multisine,
    sine,
    trapezoidal_strokes,
)
from plant_sim.rigs.position_identification import IdentifiedFeedforward
from protocols.errors import InputError

MASS = 15.0  # kg, of the table
LOAD = 150.0  # N
SLOW = sine(2e-3, 0.5), 5.0
SETTLED = 2.0  # s
TIMES = 1e-3 * np.arange(5)  # s

QUIET = {"motor.force_noise": 0.0, "sensors.force_noise": 0.0, "sensors.load_noise": 0.0, "sensors.resolution": 1e-10}


@cache
def make_experiment() -> Run:
    return identification.run_experiment(PositionAxis())


@cache
def identify_gms() -> IdentifiedFeedforward:
    return identification.identify_gms(make_experiment(), 13.0)


def make_quiet_axis(friction: FrictionModel | None = None, **changes: float) -> PositionAxis:
    """The axis without noise; `controller__rate` stands for `controller.rate`."""
    values = QUIET | {name.replace("__", "."): value for name, value in changes.items()}
    return PositionAxis(friction, load_nominal().with_values(values))


def measure_tracking_error(axis: PositionAxis, feedforward: Feedforward, load: np.ndarray | float = LOAD) -> float:
    """Rms tracking error [m] of the slow sine."""
    trajectory, seconds = SLOW
    run = axis.simulate(trajectory, seconds, feedforward.force(trajectory, axis.times(seconds), load), load)
    return float(np.sqrt(np.mean(run.error[run.time_s > SETTLED] ** 2)))


class TestPlant:
    def test_a_contact_with_a_body_of_its_own_begins_in_equilibrium_with_the_first_load(self) -> None:
        """It moves the axis as the same contact without mass does, whose asperities bear the load at every instant."""
        tips = Asperities.draw(50, np.random.default_rng(1))
        contact = Asperities(tips.position, 1e-6 * tips.height, 1e7 * tips.stiffness), FlatSurface()
        friction = StickTimeFriction(0.1, 0.2, 1.0)
        force = 20.0 * np.sin(0.05 * np.arange(400))  # N, beyond the friction of 15 N
        models = GenericModel(*contact, friction), DynamicGenericModel(*contact, friction, 5.0, 100.0)
        light, heavy = (make_quiet_axis(model).respond(force, LOAD) for model in models)
        # z_b is near 1 m, rounded to 1e-16 m: on 5 kg that is 2e-7 N in a step of 5e-5 s
        np.testing.assert_allclose(heavy.friction, light.friction, atol=1e-5)
        assert np.abs(light.friction).max() > 14.0

    def test_without_friction_and_control_a_force_gives_its_acceleration(self) -> None:
        axis = make_quiet_axis(Frictionless())
        run = axis.respond(np.full(2001, 3.0))
        half_step = 0.5 * 5e-5  # s, of backward Euler
        np.testing.assert_allclose(
            run.true_position, 0.5 * 3.0 / MASS * run.time_s * (run.time_s + 2.0 * half_step), rtol=1e-9, atol=1e-15
        )
        np.testing.assert_allclose(run.true_velocity, 3.0 / MASS * run.time_s, rtol=1e-9, atol=1e-15)

    def test_friction_holds_a_force_below_its_limit_for_ever(self) -> None:
        axis = make_quiet_axis()
        limit = float(axis.friction.friction(LOAD))
        ramp = np.minimum(np.arange(6001) / 2000.0, 1.0)
        held, slid = (axis.respond(share * limit * ramp).true_position for share in (0.9, 1.1))
        assert np.ptp(held[-1000:]) < 1e-9
        assert slid[-1] > 1e-3

    def test_motor_force_minus_friction_is_mass_times_acceleration(self) -> None:
        run = PositionAxis().simulate(*SLOW)
        impulse = np.diff(run.true_velocity) * MASS
        given = run.motor_force[:-1] * 5e-4
        friction = np.cumsum(given - impulse)  # of all periods, from the balance of momentum
        sampled = np.cumsum(run.friction[1:]) * 5e-4
        assert np.abs(friction - sampled).max() < 0.002 * np.abs(sampled).max()

    def test_is_of_first_order_in_the_step(self) -> None:
        axis = make_quiet_axis(LuGre(Stribeck(20.0, 0.7, 4e-3, 40.0), 2e6, 100.0))
        time = axis.times(0.5)
        motions = []
        for substeps in (10, 20, 40, 80):
            axis._substeps = substeps
            motions.append(axis.respond(40.0 * np.sin(2.0 * np.pi * 4.0 * time)).true_position)
        changes = [np.abs(b - a).max() for a, b in pairwise(motions)]
        assert changes[1] / changes[0] == pytest.approx(0.5, abs=0.05)
        assert changes[2] / changes[1] == pytest.approx(0.5, abs=0.05)

    def test_encoder_tells_multiples_of_its_resolution(self) -> None:
        run = PositionAxis().simulate(*SLOW)
        np.testing.assert_allclose(run.position / 1e-7, np.round(run.position / 1e-7), atol=1e-6)
        assert np.abs(run.position - run.true_position).max() <= 0.5001e-7

    def test_a_run_repeats_with_its_seed_and_differs_with_another(self) -> None:
        axis = PositionAxis()
        first, same, other = (axis.simulate(*SLOW, seed=seed) for seed in (1, 1, 2))
        np.testing.assert_array_equal(first.motor_force, same.motor_force)
        np.testing.assert_array_equal(first.true_position, same.true_position)
        assert not np.array_equal(first.true_position, other.true_position)

    def test_replayed_motor_force_gives_the_same_motion_without_control(self) -> None:
        axis = make_quiet_axis()
        run = axis.simulate(*SLOW)
        np.testing.assert_allclose(axis.respond(run.motor_force).true_position, run.true_position, atol=1e-9)


class TestControl:
    def test_bandwidth_is_the_highest_with_a_peak_sensitivity_below_two(self) -> None:
        """Sampled loop of the sliding table with hold and delay, in steps of 10 Hz."""

        def peak(bandwidth: float) -> float:
            axis = make_quiet_axis(controller__bandwidth=bandwidth)
            proportional, integral, derivative, filter_time = axis.gains
            t = axis.period
            z = np.exp(1j * np.geomspace(1.0, np.pi / t, 20000) * t)
            mass = t**2 * (z + 1.0) / (2.0 * MASS * (z - 1.0) ** 2)
            rate = derivative * (z - 1.0) / ((filter_time + t) * z - filter_time)
            control = (proportional + integral * t / (z - 1.0) + rate) / z
            return float(np.abs(1.0 / (1.0 + mass * control)).max())

        used = load_nominal()["controller.bandwidth"].value
        assert peak(used) < 2.0 < peak(used + 10.0)

    def test_stands_still_without_humming(self) -> None:
        run = PositionAxis().simulate(lambda time: 0.0 * time, 2.0)
        assert run.true_position[2000:].std() < 0.5e-7

    def test_the_integral_does_not_wind_up_at_the_force_limit(self) -> None:
        axis = make_quiet_axis(Frictionless(), motor__force_limit=5.0)
        run = axis.simulate(trapezoidal_strokes(20e-3, 50e-3, 1.0, 0.1, 1), 5.0)
        assert np.abs(run.motor_force).max() == 5.0
        assert run.true_position.max() < 1.25 * 20e-3
        assert abs(run.error[-1]) < 1e-6


class TestFeedforward:
    def test_of_the_inertia_makes_a_frictionless_axis_follow(self) -> None:
        axis = make_quiet_axis(Frictionless())
        with_it, without = (measure_tracking_error(axis, Feedforward(mass, Frictionless())) for mass in (MASS, 0.0))
        assert with_it < 0.01 * without
        assert with_it < 1e-10  # m, the step of this encoder

    @pytest.mark.parametrize(
        "friction",
        [
            Coulomb(Stribeck(25.0, 0.8, 4e-3, 40.0)),
            LuGre(Stribeck(25.0, 0.8, 4e-3, 40.0), 2e6, 100.0),
            MaxwellSlip([2e6, 1e6, 5e5], [10.0, 8.0, 7.0]),
            GMS(Stribeck(25.0, 0.8, 4e-3, 40.0), [2e6, 1e6], [0.5, 0.5], 2e3),
            load_nominal_friction(load_nominal()),
        ],
        ids=lambda friction: type(friction).__name__,
    )
    def test_with_the_true_friction_divides_the_error_by_more_than_twenty(self, friction: FrictionModel) -> None:
        """All models in the plant and in the feedforward, through one compiled run."""
        axis = make_quiet_axis(friction)
        assert (
            measure_tracking_error(axis, Feedforward(MASS, friction))
            < measure_tracking_error(axis, Feedforward(MASS, Frictionless())) / 20.0
        )

    def test_with_the_load_follows_a_load_step(self) -> None:
        axis = make_quiet_axis()
        time = axis.times(SLOW[1])
        load = LOAD * np.where(time < 3.1, 1.0, 1.75)
        trajectory = SLOW[0]
        errors = []
        for known in (load, LOAD):
            force = Feedforward(MASS, axis.friction).force(trajectory, time, known)
            run = axis.simulate(trajectory, SLOW[1], force, load)
            errors.append(np.abs(run.error[run.time_s > 3.3]).max())
        assert errors[0] < 0.1 * errors[1]

    def test_trajectories_begin_and_part_at_rest(self) -> None:
        time = np.linspace(0.0, 8.0, 80001)
        parts = join_trajectories((sine(1e-3, 0.5), 4.0), (multisine(1e-3, 0.5, 5.0, 2.0, seed=0), 4.0))
        for trajectory in (
            sine(1e-3, 2.0),
            multisine(1e-3, 0.5, 5.0, 2.0, seed=0),
            trapezoidal_strokes(0.02, 0.05, 1.0, 0.3, 4),
            parts,
        ):
            position = trajectory(time)
            assert position[0] == 0.0
            assert abs(position[1]) < 1e-12
        velocity = np.gradient(parts(time), time)
        assert abs(parts(np.array([4.0]))[0]) < 1e-12
        assert np.abs(velocity[39999:40002]).max() < 1e-7

    def test_moves_there_and_back_end_where_they_began(self) -> None:
        trajectory = trapezoidal_strokes(0.02, 0.05, 1.0, 0.3, 4)
        np.testing.assert_allclose(
            trajectory(np.array([0.0, 0.3, 0.75, 0.9, 10.0])), [0.0, 0.0, 0.02, 0.02, 0.0], atol=1e-12
        )
        time = np.linspace(0.0, 4.0, 40001)
        assert np.abs(np.diff(trajectory(time))).max() / 1e-4 == pytest.approx(0.05, rel=1e-6)


class TestIdentification:
    """From one noisy run: encoder steps, force noise, no velocity sensor."""

    def test_finds_the_mass_and_the_stribeck_curve(self) -> None:
        result = identify_gms().feedforward
        assert result.mass == pytest.approx(MASS, rel=0.02)
        curve = result.friction.stribeck
        for velocity in (2e-3, 1e-2, 5e-2):
            true = float(load_nominal_friction(load_nominal()).steady_state(velocity, LOAD))
            assert float(curve(velocity)) == pytest.approx(true, rel=0.04)

    def test_finds_the_static_friction_at_every_load(self) -> None:
        result = identification.identify_xgms(make_experiment(), identify_gms(), LOAD).feedforward.friction
        loads = LOAD * np.array([0.5, 0.75, 1.0, 1.4, 1.75])
        np.testing.assert_allclose(
            result.friction(loads), load_nominal_friction(load_nominal()).friction(loads), rtol=0.02
        )

    def test_the_better_the_model_the_smaller_the_error(self) -> None:
        mass = identify_gms().feedforward.mass
        coulomb = identification.identify_coulomb(make_experiment(), mass).feedforward
        lugre = identification.identify_lugre(make_experiment(), mass).feedforward
        errors = [
            measure_tracking_error(PositionAxis(), ff)
            for ff in (Feedforward(mass, Frictionless()), coulomb, lugre, identify_gms().feedforward)
        ]
        assert errors == sorted(errors, reverse=True)
        assert errors[-1] < 0.02 * errors[0]


class TestInput:
    def test_a_reference_that_does_not_begin_at_zero_is_refused(self) -> None:
        with pytest.raises(InputError, match="start of the reference"):
            PositionAxis().simulate(lambda time: 1e-3 + 0.0 * time, 1.0)

    def test_samples_that_do_not_fit_the_run_are_refused(self) -> None:
        with pytest.raises(InputError, match=r"feedforward force \[N\] has shape \(7,\)"):
            PositionAxis().simulate(sine(1e-3, 1.0), 1.0, np.zeros(7))
        with pytest.raises(InputError, match="least normal load"):
            PositionAxis().simulate(sine(1e-3, 1.0), 1.0, load=-1.0)

    def test_break_points_out_of_order_are_refused(self) -> None:
        with pytest.raises(InputError, match="first_break"):
            PositionAxis(parameters=load_nominal().with_values({"friction.first_break": 1e-3}))

    @pytest.mark.parametrize(
        ("ask", "message"),
        [
            (lambda: PositionAxis("x"), "friction of the axis is 'x'"),  # type: ignore[arg-type]
            (
                lambda: PositionAxis().respond([]),
                "motor force has shape (0,); one value for each of 2 periods",
            ),
            (lambda: PositionAxis().respond([1.0]), "motor force has shape (1,)"),
            (lambda: PositionAxis().respond([0.0, np.nan]), "motor force [N] holds nan"),
            (lambda: Feedforward(1.0, None), "friction of the feedforward is None"),  # type: ignore[arg-type]
            (lambda: Feedforward(1.0, Frictionless()).force(SLOW[0], np.zeros(1)), "time has shape (1,)"),
            (lambda: Feedforward(1.0, Frictionless()).force(SLOW[0], np.zeros(2)), "control period is 0 s"),
            (lambda: Feedforward(1.0, Frictionless()).force(SLOW[0], TIMES, np.ones(3)), "load has shape (3,)"),
            (lambda: sine(np.nan, 1.0), "amplitude is nan m"),
            (lambda: sine(1.0, np.nan), "frequency is nan Hz"),
            (lambda: multisine(np.nan, 0.5, 5.0, 2.0, 0), "rms of the multisine is nan m"),
            (lambda: multisine(1e-3, np.nan, 5.0, 2.0, 0), "lowest frequency is nan Hz"),
            (lambda: multisine(1e-3, 0.5, np.nan, 2.0, 0), "highest frequency is nan Hz"),
            (lambda: multisine(1e-3, 5.0, 0.5, 2.0, 0), "highest frequency is 0.5 Hz; allowed is a number at least 5"),
            (lambda: multisine(1e-3, 0.5, 5.0, np.nan, 0), "period of the multisine is nan s"),
            (lambda: multisine(1e-3, 0.5, 1e300, 2.0, 0), "number of its lines is 2e+300; allowed is"),
            (lambda: multisine(1e-3, 0.0, 5.0, 2.0, 0), "frequencies that rise from above 0 are needed"),
            (
                lambda: join_trajectories((sine(1e-3, 1.0), 0.4)),
                "time of a trajectory is 0.4 s; allowed is a number above 0.5",
            ),
            (lambda: trapezoidal_strokes(0.02, 0.05, 1.0, 0.3, 1.5), "number of strokes is 1.5"),  # type: ignore[arg-type]
        ],
    )
    def test_what_is_no_motion_is_told_in_one_sentence(self, ask: Callable[[], object], message: str) -> None:
        with pytest.raises(InputError) as refused:
            ask()
        assert message in str(refused.value)
