"""The experiments of chapter 4 measure what is in the contact, and the contacts are what their parameters say."""

import numpy as np
import pytest

from plant_sim.friction.dahl import Dahl
from plant_sim.rigs.tribometer import Tribometer
from plant_sim.rigs.tribometer_contacts import Contacts, load_contacts
from plant_sim.rigs.tribometer_experiments import (
    Coupling,
    corner_times,
    find_critical_speed,
    has_stick_slip,
    map_stick_slip,
    measure_branches,
    measure_break_away,
    measure_stribeck,
    play_oscillation,
    play_pre_sliding,
    play_reciprocation,
    play_stick_slip,
    saw_tooth,
)
from protocols.errors import InputError

CONTACTS = Contacts(seed=11)
NOISE = 4e-3  # Nm, rms of the difference of two filtered torque signals: 9 mNm of three rings, 2 kHz to 100 Hz, twice
SOFT = Coupling(100.0, 5.8)
LOOP = 2e-4 * np.array([0.0, 1.0, -1.0, 1.0])  # rad


def change_contacts(**values: float) -> Contacts:
    return Contacts(
        load_contacts().with_values({name.replace("__", "."): value for name, value in values.items()}), seed=11
    )


class TestContacts:
    @pytest.mark.parametrize("load", [58.0, 560.0, 1400.0])
    def test_oil_lowers_the_friction_at_low_speed(self, load: float) -> None:
        dry, wet = CONTACTS.make_dry_rig(load), CONTACTS.make_lubricated_rig(load)
        speed = 0.2 * dry.radius
        assert wet.friction.steady_state(speed, load) < 0.9 * dry.friction.steady_state(speed, load)

    @pytest.mark.parametrize("load", [58.0, 560.0, 1400.0])
    def test_gross_sliding_begins_after_the_travel_under_any_load(self, load: float) -> None:
        rig = CONTACTS.make_dry_rig(load)
        static = float(CONTACTS.load_law("dry")(load))
        travel = load_contacts()["dry.travel"].si * rig.radius
        force = rig.friction.trace(np.array([0.0, 0.5, 0.99, 1.0, 1.5]) * travel, 10.0, load).force
        assert force[2] < static * (1.0 - 1e-6)
        np.testing.assert_allclose(force[3:], static, rtol=1e-4)  # viscous friction of 1e-6 rad/s

    def test_without_a_share_of_the_load_the_film_changes_no_friction(self) -> None:
        rig = change_contacts(film__share=0.0).make_lubricated_rig(58.0)
        model = rig.friction
        speeds = np.array([0.01, 1.0, 6.0]) * rig.radius
        np.testing.assert_allclose(
            model.steady_state(speeds, 58.0), model.tangential.steady_state(speeds, 58.0), rtol=1e-12
        )

    def test_the_creeping_asperities_slide_at_beta_of_the_static_friction(self) -> None:
        rig = CONTACTS.make_creeping_rig(280.0)
        static = CONTACTS.static_coefficient("dry", 280.0) * 280.0
        assert rig.friction.steady_state(1e-3, 280.0) == pytest.approx(
            load_contacts()["dry.beta"].si * static, rel=1e-9
        )

    def test_a_load_beyond_the_rig_is_refused(self) -> None:
        with pytest.raises(InputError, match="load is 2000 N"):
            CONTACTS.make_dry_rig(2000.0)


class TestBreakAway:
    def test_it_falls_with_the_acceleration_by_creep(self) -> None:
        rig = CONTACTS.make_creeping_rig(280.0)
        slow, fast = (measure_break_away(rig, 280.0, acceleration)[0] for acceleration in (0.2, 2.0))
        assert slow > fast + 10.0 * NOISE

    def test_without_creep_it_does_not(self) -> None:
        rig = change_contacts(dry__beta=1.0).make_creeping_rig(280.0)
        slow, fast = (measure_break_away(rig, 280.0, acceleration)[0] for acceleration in (0.2, 2.0))
        assert abs(slow - fast) < 5.0 * NOISE

    def test_slowly_it_is_the_static_friction(self) -> None:
        peak, motion = measure_break_away(CONTACTS.make_dry_rig(560.0), 560.0, 0.2)
        static = CONTACTS.static_coefficient("dry", 560.0) * 560.0 * 0.075
        assert peak == pytest.approx(static, abs=5.0 * NOISE)
        assert motion.velocity[-1] > 0.1


class TestPreSliding:
    def test_the_saw_tooth_reaches_its_corners_at_its_speed(self) -> None:
        times = corner_times(LOOP, 1e-4)
        np.testing.assert_allclose(saw_tooth(LOOP, 1e-4, times), LOOP, atol=1e-18)
        time = np.linspace(0.0, times[-1], 1001)
        assert np.abs(np.diff(saw_tooth(LOOP, 1e-4, time))).max() <= 1e-4 * time[1] * (1.0 + 1e-9)

    def test_the_dry_loop_does_not_depend_on_the_speed(self) -> None:
        rig = CONTACTS.make_dry_rig(80.0)
        slow, fast = (play_pre_sliding(rig, 80.0, LOOP, speed) for speed in (4e-4, 16e-4))
        last = [motion.time > corner_times(LOOP, speed)[2] for motion, speed in ((slow, 4e-4), (fast, 16e-4))]
        angle = np.linspace(-0.4e-4, 0.4e-4, 50)
        torque = [
            np.interp(angle, motion.record.angle_rad[part], motion.torque[part])
            for motion, part in zip((slow, fast), last, strict=True)
        ]
        assert np.sqrt(np.mean((torque[0] - torque[1]) ** 2)) < 1.5 * NOISE

    def test_it_dissipates(self) -> None:
        motion = play_pre_sliding(CONTACTS.make_dry_rig(80.0), 80.0, LOOP, 8e-4)
        cycle = motion.time > corner_times(LOOP, 8e-4)[1]
        work = np.trapezoid(motion.torque[cycle], motion.record.slip_angle_rad[cycle])
        assert work > 0.02 * np.ptp(motion.torque[cycle]) * np.ptp(motion.record.slip_angle_rad[cycle])


class TestFrictionLag:
    SPEEDS = np.linspace(0.13, 0.34, 6)

    def measure_lag(self, rig: Tribometer, frequency: float) -> float:
        up, down = measure_branches(play_reciprocation(rig, 58.0, 0.06, frequency, periods=3), self.SPEEDS)
        return float((up - down).mean())

    def test_dry_friction_is_higher_accelerating_and_more_so_the_faster(self) -> None:
        rig = CONTACTS.make_dry_rig(58.0)
        assert 0.0 < self.measure_lag(rig, 1.0) < self.measure_lag(rig, 2.0) < self.measure_lag(rig, 3.0)

    def test_a_contact_without_memory_of_its_speed_has_none(self) -> None:
        rig = Tribometer(Dahl(12.0, 5e6), seed=3)
        assert abs(self.measure_lag(rig, 2.0)) < NOISE

    def test_a_swing_that_would_reverse_is_refused(self) -> None:
        with pytest.raises(InputError, match=r"swing is 0\.5 rad/s"):
            play_oscillation(CONTACTS.make_lubricated_rig(58.0), 58.0, 0.4, 0.5, 9.0, periods=1)


class TestStribeck:
    @pytest.mark.parametrize(
        ("speeds", "message"),
        [([], "speed .* has shape"), ([0.1, 0.0], "element 2 is 0"), (["a"], "allowed are numbers")],
    )
    def test_what_are_no_speeds_is_refused(self, speeds: list, message: str) -> None:
        with pytest.raises(InputError, match=message):
            measure_stribeck(CONTACTS.make_dry_rig(280.0), 280.0, speeds)

    @pytest.mark.parametrize("name", ["dry", "lubricated"])
    def test_it_measures_the_steady_curve_of_the_contact(self, name: str) -> None:
        rig = getattr(CONTACTS, f"make_{name}_rig")(280.0)
        curve = measure_stribeck(rig, 280.0, (0.08, 0.3, 2.0))
        np.testing.assert_allclose(curve.speed, (0.08, 0.3, 2.0), rtol=0.01)
        expected = rig.friction.steady_state(curve.speed * rig.radius, 280.0) * rig.radius
        np.testing.assert_allclose(curve.torque, expected, atol=NOISE)
        np.testing.assert_allclose(curve.load, 280.0, rtol=1e-3)
        np.testing.assert_allclose(curve.coefficient(rig.radius), expected / (280.0 * 0.075), rtol=5e-3)


class TestStickSlip:
    def test_it_ceases_at_high_speed(self) -> None:
        rig = CONTACTS.make_dry_rig(75.0)
        assert has_stick_slip(play_stick_slip(rig, 75.0, 4e-3, SOFT, 4.0), 4e-3)
        assert not has_stick_slip(play_stick_slip(rig, 75.0, 40e-3, SOFT, 2.0), 40e-3)

    def test_it_needs_friction_that_falls_with_speed(self) -> None:
        rig = change_contacts(dry__beta=1.0).make_dry_rig(75.0)
        assert not has_stick_slip(play_stick_slip(rig, 75.0, 4e-3, SOFT, 4.0), 4e-3)

    def test_damping_ends_it(self) -> None:
        rig = CONTACTS.make_dry_rig(75.0)
        assert not has_stick_slip(play_stick_slip(rig, 75.0, 9.44e-3, Coupling(100.0, 50.0), 4.0), 9.44e-3)

    def test_the_critical_speed_grows_with_the_load(self) -> None:
        low, high = (
            find_critical_speed(CONTACTS.make_dry_rig(w), w, SOFT, (6e-3, 60e-3), steps=4) for w in (65.0, 140.0)
        )
        assert low < high

    def test_bounds_without_the_critical_speed_are_refused(self) -> None:
        with pytest.raises(InputError, match="does not end between"):
            find_critical_speed(CONTACTS.make_dry_rig(75.0), 75.0, SOFT, (40e-3, 60e-3), steps=1)


class TestLiftUp:
    @pytest.mark.parametrize("periods", [-1, 0, 1.5])
    def test_what_is_no_number_of_periods_is_refused(self, periods: int) -> None:
        rig = CONTACTS.make_dry_rig(58.0)
        with pytest.raises(InputError, match=f"number of periods is {periods}; allowed is a whole number of 1 or more"):
            play_reciprocation(rig, 58.0, 0.06, 9.0, periods)
        with pytest.raises(InputError, match=f"number of periods is {periods}"):
            play_oscillation(rig, 58.0, 0.4, 0.2, 9.0, periods)

    def test_the_gap_is_wider_in_deceleration(self) -> None:
        motion = play_reciprocation(CONTACTS.make_lubricated_rig(58.0), 58.0, 0.06, 9.0, periods=8)
        beyond = (motion.angle > 0.02) & (motion.angle < 0.05)
        slows, speeds_up = (motion.gap[beyond & (sign * motion.velocity > 0.0)].mean() for sign in (1.0, -1.0))
        assert slows > speeds_up + 0.05e-6

    def test_dry_disks_do_not_lift(self) -> None:
        motion = play_reciprocation(CONTACTS.make_dry_rig(58.0), 58.0, 0.06, 9.0, periods=8)
        beyond = (motion.angle > 0.02) & (motion.angle < 0.05)
        slows, speeds_up = (motion.gap[beyond & (sign * motion.velocity > 0.0)].mean() for sign in (1.0, -1.0))
        assert abs(slows - speeds_up) < 0.01e-6


def test_a_load_beyond_the_dynamometers_is_refused_where_it_is_read() -> None:
    with pytest.raises(InputError, match=r"load, which the normal dynamometers must read, is 1400 N; .* at most 1293"):
        measure_stribeck(Contacts().make_dry_rig(1400.0), 1400.0, [0.5])


def test_the_stick_slip_map_has_loads_by_speeds() -> None:
    """As in figure 4.7: at 75 N there is none at the highest speed, at 87 N there is."""
    result = map_stick_slip(Contacts().make_dry_rig, (75.0, 87.0), (13.74e-3, 20e-3), Coupling(100.0, 5.8))
    np.testing.assert_array_equal(result, [[True, False], [True, True]])


def test_a_slow_drive_is_given_the_time_to_break_away() -> None:
    assert map_stick_slip(Contacts().make_dry_rig, (87.0,), (4e-3,), Coupling(100.0, 5.8)).all()
