"""The virtual tribometer: its contacts obey the laws given, its integration converges."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lsim

from clutch_hil.thesis.tribometer.tribometer_identification import make_contact as dry_contact
from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.counter_surface import FlatSurface
from plant_sim.friction.dahl import Dahl
from plant_sim.friction.generic import DynamicGenericModel
from plant_sim.friction.gms import GMS
from plant_sim.friction.load_law import Amontons
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import FrictionModel
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.xgms import XGMS
from plant_sim.rigs.multisine import Multisine, estimate_response
from plant_sim.rigs.tribometer import Record, Tribometer, load_nominal, make_chains
from plant_sim.rigs.tribometer_integration import advance
from plant_sim.rigs.tribometer_structure import compute_response
from protocols.errors import InputError

TANGENTIAL, NORMAL = make_chains(load_nominal())
STIFFNESS = 3.0e4  # Nm/rad, of a contact
DT = 1e-4  # s
LEVEL = 12.0  # N, friction: 0.9 Nm at the mean radius
SLIP = MaxwellSlip(np.full(8, 1e6), np.linspace(0.5, 2.5, 8) * LEVEL / 12.0)
CURVE = Stribeck(LEVEL, beta=0.7, stribeck_velocity=0.01)
MODELS: list[FrictionModel] = [
    SLIP,
    Coulomb(CURVE),
    Dahl(LEVEL, 5e6),
    LuGre(CURVE, 5e6, 100.0),
    GMS(CURVE, np.full(4, 2e6), np.full(4, 0.25), attraction=500.0),
]


def make_rig(friction: FrictionModel = SLIP, sensors: bool = False, **changed: float) -> Tribometer:
    values = {name.replace("__", "."): value for name, value in changed.items()}
    return Tribometer(friction, load_nominal().with_values(values), sensors=sensors)


class TestContacts:
    def test_a_torque_below_break_away_is_carried_and_nothing_moves_on(self) -> None:
        r = make_rig()
        record = r.run(r.make_torque_drive(0.6), 58.0, 2.0, DT)
        late = record.time_s > 1.0
        np.testing.assert_allclose(record.friction_torque[late], 0.6, rtol=1e-6)
        np.testing.assert_allclose(record.torque_measured[late], 0.6, rtol=1e-6)
        assert np.ptp(record.slip_angle_rad[late]) < 1e-9

    @pytest.mark.parametrize("friction", MODELS, ids=lambda model: type(model).__name__)
    def test_steady_sliding_has_the_friction_of_the_model(self, friction: FrictionModel) -> None:
        r = make_rig(friction, disks__runout=0.0)
        record = r.run(r.make_velocity_drive(1.0), 58.0, 2.0, DT)
        speed = record.slip_velocity_rad_s[-1]
        expected = r.radius * float(friction.steady_state(r.radius * speed, 58.0))
        assert speed == pytest.approx(1.0 - expected / 20.0, rel=1e-3)  # P control: 20 Nm s/rad
        assert record.friction_torque[-1] == pytest.approx(expected, rel=1e-6)
        assert np.mean(record.torque_measured[-5000:]) == pytest.approx(expected, rel=1e-3)

    def test_a_contact_with_a_body_of_its_own_begins_in_equilibrium_with_the_first_load(self) -> None:
        """Nothing moves in the normal direction: its asperities bear the load from the first sample on."""
        tips = Asperities.draw(50, np.random.default_rng(1))
        stiff = Asperities(tips.position, 1e-6 * tips.height, 1e7 * tips.stiffness)  # N/m
        friction = DynamicGenericModel(stiff, FlatSurface(), StickTimeFriction(0.1, 0.2, 1.0), 5.0, 100.0)
        r = make_rig(friction, disks__runout=0.0)
        record = r.run(r.make_torque_drive(0.5), 280.0, 0.02, DT)
        begin = friction.rest(280.0)
        assert begin[-2] == pytest.approx(friction.rest(1.0)[-2] - 279.0 / stiff.normal_stiffness.sum(), abs=1e-7)
        assert record.end.friction[-2] == pytest.approx(begin[-2], abs=1e-13)
        np.testing.assert_allclose(record.normal_load, 280.0, rtol=1e-12)

    def test_all_models_run_through_one_compiled_rig(self) -> None:
        assert len(advance.signatures) == 1

    @pytest.mark.parametrize("friction", MODELS, ids=lambda model: type(model).__name__)
    def test_stick_does_not_chatter(self, friction: FrictionModel) -> None:
        r = make_rig(friction)
        record = r.run(r.make_torque_drive(lambda t: 0.5 * np.minimum(t, 1.0)), 58.0, 3.0, DT)
        late = record.time_s > 2.0
        assert np.ptp(record.friction_torque[late]) < 1e-3
        assert np.abs(record.slip_velocity_rad_s[late]).max() < 1e-4

    @pytest.mark.parametrize("dt", [1e-5, 5e-5])
    def test_an_elastic_contact_is_the_linear_structure_with_a_damper_of_half_a_step(self, dt: float) -> None:
        stiffness = STIFFNESS / make_rig().radius ** 2
        r = make_rig(MaxwellSlip(np.array([stiffness]), np.array([np.inf])))
        wanted = 0.1 * np.sin(2.0 * np.pi * 60.0 * np.arange(0, 0.5, dt))
        record = r.run(r.make_torque_drive(wanted), 58.0, (wanted.size - 1) * dt, dt)
        a, b = TANGENTIAL.make_state_space(STIFFNESS, contact_damping=0.5 * STIFFNESS * dt)
        _, y, _ = lsim((a, b[:, 1:], np.eye(6)[2:3], 0.0), wanted, record.time_s)
        assert np.abs(record.angle_rad - y).max() < 0.005 * np.abs(y).max()

    def play_multisine(self, friction: FrictionModel, amplitude: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Frequency [Hz] and theta/T of the motor [rad/Nm], and the relative distortion, by three realisations."""
        r = make_rig(friction)
        source = Multisine(np.arange(2, 100), amplitude, 5000)
        random = np.random.default_rng(5)
        periods = [source.draw_period(random) for _ in range(3)]
        torque, angle = [], []
        for period in periods:
            record = r.run(r.make_torque_drive(np.append(np.tile(period, 4), period[0])), 58.0, 2.0, DT)
            torque.append(np.tile(period, (2, 1)))
            angle.append(record.angle_rad[10_000:-1].reshape(2, -1))
        result = estimate_response(source, DT, np.array(torque), np.array(angle))
        return result.frequency, result.response, float(np.median(result.distortion / np.abs(result.response)))

    def test_the_multisine_finds_the_linear_structure_when_the_contact_is_elastic(self) -> None:
        frequency, result, spread = self.play_multisine(
            MaxwellSlip([STIFFNESS / make_rig().radius ** 2], [np.inf]), 0.01
        )
        a, b = TANGENTIAL.make_state_space(STIFFNESS, contact_damping=0.5 * STIFFNESS * DT)
        np.testing.assert_allclose(result, compute_response(a, b[:, 1], np.eye(6)[2], frequency), rtol=0.02)
        assert spread < 0.01

    def test_slip_makes_the_response_larger_and_distorts_it(self) -> None:
        (frequency, little, clean), (_, much, distorted) = (
            self.play_multisine(dry_contact(58.0), a) for a in (0.002, 0.1)
        )
        low = frequency < 40.0  # below the resonance, where the spring of the contact rules
        assert np.all(np.abs(much[low]) > 2.0 * np.abs(little[low]))
        assert distorted > 5.0 * clean

    def test_the_measured_load_is_the_load_applied_and_the_gap_is_that_of_hertz(self) -> None:
        r = make_rig(disks__runout=0.0)
        loads = (58.0, 280.0, 1120.0)
        records = [r.run(r.make_torque_drive(0.0), load, 0.05, DT) for load in loads]
        np.testing.assert_allclose([one.normal_measured[-1] for one in records], loads, rtol=1e-9)
        np.testing.assert_allclose([one.normal_load[-1] for one in records], loads, rtol=1e-9)
        gaps = np.array([one.gap[0, -1] for one in records])
        np.testing.assert_allclose(-gaps, 2.2e-6 * (np.array(loads) / 50.0) ** (2.0 / 3.0), rtol=1e-9)

    @pytest.mark.parametrize("load", [58.0, 1120.0])
    def test_a_small_force_of_the_shaker_finds_the_linear_structure(self, load: float) -> None:
        r, dt = make_rig(), 2e-5
        time = dt * np.arange(5001)
        force = 0.02 * np.sin(2.0 * np.pi * 190.0 * time)
        record = r.run(r.make_torque_drive(0.0), load + force, time[-1], dt)
        stiffness = float(r.contact_stiffness(load))
        damping = stiffness * (r.parameters["normal.contact_time"].si + 0.5 * dt)
        a, b = NORMAL.make_state_space(stiffness, damping)
        output = NORMAL.table_stiffness * np.eye(6)[:1]
        _, y, _ = lsim((a, b[:, 1:], output, 0.0), force, time)
        assert np.abs(record.normal_measured - load - y).max() < 0.02 * np.abs(y).max()

    def test_a_slow_load_of_the_shaker_arrives_and_one_at_the_resonance_is_amplified(self) -> None:
        def swing(frequency: float) -> float:
            r = make_rig()
            record = r.run(r.make_torque_drive(0.0), lambda t: 58.0 + np.sin(2.0 * np.pi * frequency * t), 0.5, 2e-5)
            return float(np.ptp(record.normal_measured[record.time_s > 0.3])) / 2.0

        assert swing(5.0) == pytest.approx(1.0, rel=0.02)
        assert swing(186.0) > 3.0 * swing(120.0) > 3.0

    def test_friction_of_a_load_proportional_contact_follows_the_shaker(self) -> None:
        r = make_rig(XGMS(Amontons(0.2), np.array([2e6]), np.array([1.0])), disks__runout=0.0)
        record = r.run(r.make_velocity_drive(1.0), lambda t: 100.0 + 20.0 * np.sin(4.0 * np.pi * t), 1.5, DT)
        late = record.time_s > 0.5
        np.testing.assert_allclose(record.friction_torque[late], 0.2 * r.radius * record.normal_load[late], rtol=1e-9)
        assert np.ptp(record.friction_torque[late]) == pytest.approx(0.2 * r.radius * 40.0, rel=0.01)

    def test_runout_shows_in_the_mean_gap_and_tilt_only_in_each_sensor(self) -> None:
        r = make_rig(sensors=True, sensors__gap_noise=0.0)
        record = r.run(r.make_velocity_drive(2.0 * np.pi), 280.0, 2.0, DT)
        late = record.slip_angle_rad > 2.0 * np.pi
        assert np.ptp(record.gap.mean(axis=0)[late]) == pytest.approx(3.5e-6, rel=0.02)
        assert np.ptp(record.gap[0, late]) > 5e-6

    @pytest.mark.parametrize("load", [58.0, 1120.0])
    def test_lift_up_opens_the_gap_by_its_height_at_speed_and_leaves_the_load(self, load: float) -> None:
        r = make_rig(disks__runout=0.0, lift__height=1e-6)
        record = r.run(r.make_velocity_drive(lambda t: np.where(t < 0.5, 0.0, 15.0)), load, 1.5, DT)
        assert record.gap[0, -1] - record.gap[0, 0] == pytest.approx(1e-6, rel=0.01)
        assert record.normal_load[-1] == pytest.approx(load, rel=1e-6)

    def test_lift_up_against_angle_is_a_butterfly_that_opens_with_frequency(self) -> None:
        def opening(frequency: float) -> float:
            r = make_rig(disks__runout=0.0, lift__height=1e-6)
            record = r.run(
                r.make_position_drive(lambda t: 0.06 * np.sin(2.0 * np.pi * frequency * t)), 58.0, 3.0 / frequency, DT
            )
            middle = (np.abs(record.slip_angle_rad) < 0.03) & (record.time_s > 1.0 / frequency)
            gaining = record.slip_angle_rad * record.slip_velocity_rad_s < 0.0  # towards the middle
            return float(record.gap[0, middle & ~gaining].mean() - record.gap[0, middle & gaining].mean())

        assert opening(9.0) > 2.0 * opening(1.0) > 0.0


class TestIntegration:
    @pytest.mark.parametrize(
        "drive",
        [
            lambda r: r.make_position_drive(lambda t: 2e-3 * (1.0 - np.cos(10.0 * np.pi * t))),
            lambda r: r.make_spring_drive(lambda t: 0.2 * t, 100.0),
        ],
        ids=["position", "spring"],
    )
    def test_halving_the_step_halves_the_error(self, drive: Callable[[Tribometer], object]) -> None:
        r = make_rig()

        def load(t: np.ndarray) -> np.ndarray:
            return 100.0 + 20.0 * np.sin(40.0 * np.pi * t)

        runs = [r.run(drive(r), load, 0.3, DT / 2**k, every=2**k) for k in (0, 1, 2, 7)]  # type: ignore[arg-type]
        for channel in ("friction_torque", "normal_load", "angle_rad"):
            *coarse, exact = (getattr(run, channel) for run in runs)
            errors = np.array([np.sqrt(np.mean((one - exact) ** 2)) for one in coarse])
            assert (errors[:-1] / errors[1:]).min() > 1.7, channel
            assert (errors[:-1] / errors[1:]).max() < 2.3, channel

    def test_a_run_in_two_parts_is_the_run_in_one(self) -> None:
        r = make_rig(MODELS[-1])
        signal = 0.9 * np.sin(0.01 * np.arange(2001))
        whole = r.run(r.make_torque_drive(signal), 100.0, 0.2, DT)
        first = r.run(r.make_torque_drive(signal[:1001]), 100.0, 0.1, DT)
        second = r.run(r.make_torque_drive(signal[1000:]), 100.0, 0.1, DT, start=first.end)
        np.testing.assert_array_equal(second.angle_rad, whole.angle_rad[1000:])
        np.testing.assert_array_equal(second.friction_torque, whole.friction_torque[1000:])
        np.testing.assert_array_equal(second.normal_load, whole.normal_load[1000:])

    def test_without_drive_the_energy_only_falls(self) -> None:
        r = make_rig(Coulomb(Stribeck(LEVEL)), disks__runout=0.0)
        start = r.run(r.make_velocity_drive(3.0), 58.0, 0.5, DT).end
        stiffness = np.array([[1.0, -1.0], [-1.0, 1.0]]) * TANGENTIAL.coupling_stiffness
        energy, state = [], start
        for _ in range(60):
            state = r.run(r.make_torque_drive(0.0), 58.0, 2e-3, DT, start=state).end
            q, v = state.tangential[:3], state.tangential[3:6]
            energy.append(
                0.5 * np.dot(TANGENTIAL.inertia, v**2)
                + 0.5 * TANGENTIAL.table_stiffness * q[0] ** 2
                + 0.5 * q[1:] @ stiffness @ q[1:]
            )
        assert np.all(np.diff(energy) <= 0.0)
        assert energy[-1] < 0.05 * energy[0]

    def test_kept_samples_are_those_of_the_whole_run(self) -> None:
        r = make_rig()
        all_of_them, some = (r.run(r.make_torque_drive(0.5), 58.0, 0.1, DT, every=n) for n in (1, 7))
        np.testing.assert_array_equal(all_of_them.angle_rad[::7], some.angle_rad)
        np.testing.assert_array_equal(all_of_them.time_s[::7], some.time_s)


class TestDrivesAndSensors:
    def test_position_control_follows_the_sine_of_the_friction_lag_experiment(self) -> None:
        r = make_rig()
        record = r.run(r.make_position_drive(lambda t: 0.06 * np.sin(2.0 * np.pi * t)), 280.0, 2.0, DT)
        error = record.angle_rad - 0.06 * np.sin(2.0 * np.pi * record.time_s)
        assert np.abs(error).max() < 0.05 * 0.06

    def test_the_motor_gives_no_more_than_its_limit(self) -> None:
        r = make_rig()
        record = r.run(r.make_position_drive(1.0), 58.0, 0.2, DT)
        assert np.abs(record.motor_torque).max() == 15.0
        # at the limit the inertias accelerate as free bodies with the friction against them
        early = (record.time_s > 0.02) & (record.time_s < 0.05)
        pull = np.polyfit(record.time_s[early], record.velocity_rad_s[early], 1)[0]
        assert pull == pytest.approx((15.0 - 0.9) / 0.0253, rel=0.03)

    def test_velocity_control_without_stiffness_stands_still_below_break_away(self) -> None:
        r = make_rig()
        record = r.run(r.make_velocity_drive(0.004), 58.0, 1.0, DT)
        assert np.abs(record.velocity_rad_s[-1]) < 1e-6

    def run_with_sensors(self, seed: int) -> tuple[Record, Record]:
        runs = []
        for sensors in (True, False):
            r = Tribometer(SLIP, sensors=sensors, seed=seed)
            runs.append(r.run(r.make_velocity_drive(0.5), 280.0, 0.5, DT))
        return runs[0], runs[1]

    def test_sensors_have_the_resolution_of_section_3_9(self) -> None:
        noisy, true = self.run_with_sensors(1)
        torque_step, load_step = 5.0 / 1000.0, 431.0 / 3675.0
        np.testing.assert_allclose(
            noisy.torque_measured / torque_step, np.round(noisy.torque_measured / torque_step), atol=1e-6
        )
        np.testing.assert_allclose(
            noisy.normal_measured / load_step, np.round(noisy.normal_measured / load_step), atol=1e-6
        )
        error = noisy.torque_measured - true.torque_measured
        assert np.std(error) == pytest.approx(torque_step * np.sqrt(3.0 * (1.0 + 1.0 / 12.0)), rel=0.05)
        assert abs(np.mean(error)) < 5.0 * np.std(error) / np.sqrt(error.size)
        lag = true.angle_rad - noisy.angle_measured
        assert 0.0 <= lag.min() < lag.max() <= 2.0 * np.pi / 163840 * (1 + 1e-9)
        np.testing.assert_array_equal(noisy.angle_rad, true.angle_rad)

    def test_the_seed_repeats_the_noise(self) -> None:
        one, again, other = (self.run_with_sensors(seed)[0].torque_measured for seed in (1, 1, 2))
        np.testing.assert_array_equal(one, again)
        assert np.any(one != other)

    @pytest.mark.parametrize(
        ("load", "message"),
        [
            (1500.0, "1400 N"),
            (0.0, "above 0"),
            (lambda t: 100.0 + 50.0 * np.sin(9.0 * t), "35.7 N"),
            (np.ones(7), "shape"),
        ],
    )
    def test_loads_that_the_rig_does_not_give_are_refused(self, load: object, message: str) -> None:
        r = make_rig()
        with pytest.raises(InputError, match=message):
            r.run(r.make_torque_drive(0.0), load, 1.0, DT)  # type: ignore[arg-type]

    def test_speeds_steps_and_parameters_that_are_no_rig_are_refused(self) -> None:
        r = make_rig()
        with pytest.raises(InputError, match=r"at most 15\.08 rad/s"):
            r.run(r.make_velocity_drive(lambda t: 20.0 * t), 58.0, 1.0, DT)
        with pytest.raises(InputError, match="time step"):
            r.run(r.make_torque_drive(0.0), 58.0, 1.0, 1e-3)
        with pytest.raises(InputError, match="drive torque holds nan; allowed are finite numbers"):
            r.run(r.make_torque_drive(np.nan), 58.0, 1.0, DT)
        with pytest.raises(InputError, match="inner_diameter"):
            make_rig(disks__inner_diameter=0.2)
        other = make_rig(Coulomb(CURVE))
        with pytest.raises(InputError, match="friction states"):
            other.run(
                other.make_torque_drive(0.0), 58.0, 0.1, DT, start=r.run(r.make_torque_drive(0.0), 58.0, 0.1, DT).end
            )

    @pytest.mark.parametrize(
        ("ask", "message"),
        [
            (lambda: Tribometer(None), "friction between the disks is None"),  # type: ignore[arg-type]
            (
                lambda: make_rig().run(make_rig().make_torque_drive(0.0), 58.0, 0.1, DT, every=1.5),
                "two kept ones is 1.5; allowed is a whole",
            ),
            (lambda: make_rig().run(make_rig().make_torque_drive(0.0), 58.0, 0.1, DT, every=0), "two kept ones is 0"),
            (lambda: make_rig().run(make_rig().make_torque_drive("a"), 58.0, 0.1, DT), "drive torque is 'a'"),
            (
                lambda: make_rig().run(make_rig().make_torque_drive(0.0), 58.0, 0.1, DT, start="x"),
                "start of the run is 'x'",
            ),
        ],
    )
    def test_what_is_no_rig_and_no_run_is_told_in_one_sentence(self, ask: Callable[[], object], message: str) -> None:
        with pytest.raises(InputError, match=message):
            ask()
