"""A controller for every state of a clutch: slipping, sticking, locking, reversing, saturated. Nothing here is a fault."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil import simulate
from clutch_hil.bench.in_process import Played, play
from clutch_hil.discrepancy.models.wet_clutch_experiments import LIBRARY
from clutch_hil.identify.controller_values import derive_controller_values
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import Profile, load_profile
from plant_sim.rigs import wet_clutch
from rt_controller.law.clutch_state import ClutchState
from rt_controller.loop.node import ControllerNode
from rt_controller.loop.parameter_sets import load_controller_parameters
from tests.every_state import draw_life, judge_life, play_life

# Of lives 0 to 299 these have the greatest excess and the greatest step of the voltage; tests.every_state plays more
LIVES = range(50, 150)
# Asked for is none. Of the samples of these lives 1.6e-5 are off by more than 0.5 Nm and 5 %, and 2.0e-6, one, above what the
# plates carry; of lives 0 to 299 2.0e-5 and 1.3e-6 (more lives: docs/states.md)
OFF, ABOVE = 2e-5, 2.5e-6
OTHER_LIVES = (15, 134, 214, 237, 252, 269, *range(10))  # the first six: of lives 0 to 299 those that were a fault
OTHERS_OFF = 5e-4  # of their samples: 9.3e-5 measured in lives 0 to 299
EXCESS = 1.8  # Nm beyond what is allowed, for a sample in which plates catch: 1.68 measured
BENT = 15  # lives of plates that bend
BENT_OFF = 0.015  # of their samples: 0.0037 measured at 2e-3 rad, 0.0072 at 2e-2 rad
# V between two samples in stick: 0.18 measured where the torque turns on the way out of lock; noise is 3 mV
VALVE = 0.2
SINE = 0.065  # Nm rms about the mean: 0.057 measured; the issue asks for 0.1
TURN = {
    1000: 1.0,
    250: 1.5,
}  # Nm in the crossing, by rate [Hz]: below 1.0 and 0.8 measured at 10 Nm and level 1; the issue asks for 1.5
LOCKED = 0.3  # Nm: 0.23 measured
PEAK = 0.5  # Nm above what was carried or is asked for: 0.46 measured, of a clutch of level 0.75


def make_run(*rows: tuple[float, ...], level: float = 1.0, rate: int = 1000, seed: int = 1) -> Played:
    """A run of rows of time [s], torque [Nm], speed [rad/s] and, where given, lock."""
    columns = list(zip(*rows, strict=True))
    profile = Profile("states", *columns[:3], (), columns[3] if len(columns) > 3 else ())
    parameters = wet_clutch.load_nominal().with_values({"friction_level.level": level})
    return play(PlantNode(rate=rate, parameters=parameters, profile=profile, seed=seed), ControllerNode(rate=rate))


def compute_error(run: Played, begin: float, end: float) -> np.ndarray:
    """Estimate less true torque between two times."""
    part = (run["time_s"] >= begin) & (run["time_s"] < end)
    return (run["controller_torque_estimate_nm"] - run["truth_clutch_torque_nm"])[part]


def test_no_random_life_of_a_healthy_clutch_is_a_fault_and_the_estimate_is_right() -> None:
    verdicts = {seed: judge_life(life := draw_life(seed), play_life(life)) for seed in LIVES}
    assert [seed for seed, verdict in verdicts.items() if verdict.fault] == []
    samples = sum(verdict.samples for verdict in verdicts.values())
    assert sum(verdict.off for verdict in verdicts.values()) < OFF * samples
    assert sum(verdict.above for verdict in verdicts.values()) < ABOVE * samples
    assert max(verdict.excess for verdict in verdicts.values()) < EXCESS
    assert max(verdict.voltage for verdict in verdicts.values()) < VALVE


def test_no_random_life_of_another_clutch_is_a_fault_to_a_controller_that_is_calibrated_to_it() -> None:
    """Clutches up to 30 % off the shipped one; most of these lives ended in an overpressure fault once."""
    lives = [draw_life(seed, spread=0.3) for seed in OTHER_LIVES]
    verdicts = [judge_life(life, play_life(life)) for life in lives]
    assert not any(verdict.fault for verdict in verdicts)
    assert sum(v.off for v in verdicts) < OTHERS_OFF * sum(v.samples for v in verdicts)


@pytest.mark.parametrize("torque", [10.0, 15.0, 20.0])
@pytest.mark.parametrize("level", [0.8, 1.0, 1.2])
def test_a_clutch_whose_motor_stops_sticks_and_carries_what_is_applied(torque: float, level: float) -> None:
    run = make_run(
        (0, 0, 10),
        (0.5, 0, 10),
        (1, torque, 10),
        (3, torque, 5),
        (6, torque, 0),
        (8, torque, 0),
        (9, 0, 0),
        level=level,
    )
    assert run["controller_fault"].max() == 0
    part = (run["time_s"] > 7.0) & (run["time_s"] < 7.8)
    assert ClutchState.STICKING in run["controller_clutch_state"][part]
    assert np.abs(compute_error(run, 7.0, 7.8)).max() < LOCKED


@pytest.mark.parametrize("seconds", [0.2, 0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("speed", [5.0, 10.0])
@pytest.mark.parametrize("rate", [250, 1000])
def test_a_reversal_is_no_fault_and_the_estimate_follows_it_with_its_sign(
    seconds: float, speed: float, rate: int
) -> None:
    turn, end = 3.0 + seconds, 5.0 + seconds
    run = make_run(
        (0, 0, speed), (0.5, 0, speed), (1, 10, speed), (3, 10, speed), (turn, 10, -speed), (end, 10, -speed), rate=rate
    )
    assert run["controller_fault"].max() == 0
    assert np.abs(compute_error(run, 2.9, end)).max() < TURN[rate]
    assert run["controller_torque_estimate_nm"][-1] == pytest.approx(-10.0, abs=LOCKED)


@pytest.mark.parametrize("angle", [2e-3, 2e-2])
def test_plates_that_bend_before_they_slide_are_no_fault_to_a_controller_that_is_calibrated_to_it(angle: float) -> None:
    verdicts = {seed: judge_life(life := draw_life(seed), play_life(life, angle)) for seed in range(BENT)}
    assert [seed for seed, verdict in verdicts.items() if verdict.fault] == []
    assert sum(v.off for v in verdicts.values()) < BENT_OFF * sum(v.samples for v in verdicts.values())


def test_a_ramp_to_24_nm_in_creep_is_no_fault() -> None:
    run = make_run((0, 0, 1), (0.5, 0, 1), (4, 24, 1), (6, 24, 1), (7, 0, 1))
    assert run["controller_fault"].max() == 0
    assert np.abs(compute_error(run, 1.0, 6.0)).max() < LOCKED


# Other clutches: the valve less damped, by up to three stated uncertainties; plates that touch at other pressures
OTHERS = {
    "damping 0.8": {"valve.damping": 0.8},
    "damping 0.7": {"valve.damping": 0.7},
    "damping 0.6": {"valve.damping": 0.6},
    "contact 2.05": {"piston.contact_pressure": 2.05, "piston.preload_pressure": 1.48},
    "contact 2.5": {"piston.contact_pressure": 2.5, "piston.preload_pressure": 1.81},
    "contact 2.85, damping 0.7": {
        "piston.contact_pressure": 2.85, "piston.preload_pressure": 2.06, "valve.damping": 0.7, "clutch.beta_onset": 3.21,
        "clutch.coulomb_intercept": -30.5, "clutch.viscous_intercept": -7.825,
    },
}  # fmt: skip


def write_profile(folder: Path, speed: float, *rows: tuple[float, float]) -> str:
    """Write a profile of rows of time [s] and torque [Nm] at one speed [rad/s]; return its path."""
    profile = folder / "profile.csv"
    header = "time_s,torque_demand_nm,motor_speed_demand_rad_s\n"
    profile.write_text(header + "".join(f"{time},{demand},{speed}\n" for time, demand in rows), encoding="utf-8")
    return str(profile)


@pytest.mark.parametrize("torque", [25.0, 30.0])
@pytest.mark.parametrize("rate", [250, 1000])
@pytest.mark.parametrize("clutch", OTHERS)
def test_the_most_that_may_be_asked_for_at_standstill_is_no_fault_on_another_clutch(
    tmp_path: Path, clutch: str, rate: int, torque: float
) -> None:
    """The controller is calibrated to it. Its pressure demand goes from filled to the highest, and must not end in a fault."""
    profile = write_profile(
        tmp_path, 0.0, (0.0, 0.0), (0.3, 0.0), (0.35, torque), (1.5, torque), (1.7, 0.0), (2.0, 0.0)
    )
    nominal = {name: parameter.value for name, parameter in wet_clutch.load_nominal().items()}
    values = derive_controller_values(nominal | OTHERS[clutch], nominal, load_controller_parameters())
    controller = {name: value for name, (value, _) in values.items()}
    run = simulate(profile=profile, plant=OTHERS[clutch], controller=controller, rate=rate)
    assert not run["controller_fault"].any()
    assert run["truth_cylinder_pressure_bar"].max() < 4.95  # 5 bar is the guard's limit; 4.93 measured


@pytest.mark.parametrize("rate", [500, 1000, 2000])
@pytest.mark.parametrize("speed", [0.0, 10.0])
def test_a_piston_that_flies_fast_is_not_taken_for_a_torque(tmp_path: Path, rate: int, speed: float) -> None:
    """Its damping takes 0.36 bar, of the shipped clutch's 0.13; before the plates touch they carry nothing."""
    plant = {"piston.damping": 2.6e4, "piston.clearance": 1.3e-3, "hydraulics.conductance": 2.6e-4}
    nominal = {name: parameter.value for name, parameter in wet_clutch.load_nominal().items()}
    values = derive_controller_values(nominal | plant, nominal, load_controller_parameters())
    profile = write_profile(tmp_path, speed, (0.0, 0.0), (0.3, 0.0), (0.301, 10.0), (1.2, 10.0))

    def find_most(controller: dict[str, float]) -> float:
        run = simulate(profile=profile, plant=plant, controller=controller, rate=rate)
        touch = np.flatnonzero(run["truth_normal_force_n"] > 0.0)[0]
        return float(np.abs(run["controller_torque_estimate_nm"][:touch]).max())

    known = {name: value for name, (value, _) in values.items()}
    assert find_most(known) < 0.3
    if speed:  # the band of the shipped clutch does not do
        assert find_most({**known, "phases.touch_band": 0.16}) > 1.0


@pytest.mark.parametrize("zero", [-0.8, 0.8])
def test_a_zero_of_the_motor_s_torque_that_is_known_changes_no_estimate(tmp_path: Path, zero: float) -> None:
    """2 % of the motor's 40 Nm. Not known, it is taken for friction: 5 % of the estimate at 15 Nm."""
    plant = {"motor_torque_sensor_offset.offset": zero}
    nominal = {name: parameter.value for name, parameter in wet_clutch.load_nominal().items()}
    values = derive_controller_values(nominal | plant, nominal, load_controller_parameters())
    profile = write_profile(tmp_path, 10.0, (0.0, 0.0), (0.3, 0.0), (0.5, 15.0), (4.0, 15.0))

    def compute_gap(controller: dict[str, float]) -> float:
        run = simulate(profile=profile, plant=plant, controller=controller)
        return float(compute_error(run, 3.0, 4.0).mean())

    known = {name: value for name, (value, _) in values.items()}
    assert abs(compute_gap(known)) < 0.05
    assert abs(compute_gap({**known, "model.motor_torque_zero": 0.0})) > 0.6


@pytest.mark.parametrize("frequency", [1.0, 2.0, 5.0, 9.0])
def test_the_lag_of_the_friction_is_in_the_estimate(frequency: float) -> None:
    """Fig 6.14: slip of 100 rpm with a sine of 60 rpm."""
    times = np.arange(0.0, 3.0, 0.004)
    speeds = 10.47 + 6.28 * np.sin(2.0 * np.pi * frequency * times)
    sine = [(1.0 + float(t), 10.0, float(w)) for t, w in zip(times, speeds, strict=True)]
    run = make_run((0, 0, 10.47), (0.5, 0, 10.47), *sine)
    assert compute_error(run, 2.0, 4.0).std() < SINE


@pytest.mark.parametrize("torque", [10.0, 15.0, 20.0, 24.0])
def test_a_clutch_that_is_to_be_locked_holds_a_running_motor_and_lets_it_go(torque: float) -> None:
    run = make_run(
        (0, 0, 10, 0), (0.5, 0, 10, 0), (0.8, torque, 10, 0), (2, torque, 10, 1), (62, torque, 10, 0), (62.3, torque, 10, 0),
        (63.5, 0, 10, 0), (64, 0, 10, 0),
    )  # fmt: skip
    assert run["controller_fault"].max() == 0
    held = (run["time_s"] > 4.0) & (run["time_s"] < 62.0)
    assert set(run["controller_clutch_state"][held]) == {ClutchState.LOCKED}
    assert (run["truth_slip_speed_rad_s"][held] == 0.0).all()
    assert np.abs(compute_error(run, 4.0, 62.0)).max() < LOCKED
    assert (run["controller_capacity_nm"][held] > 1.06 * np.abs(run["truth_clutch_torque_nm"][held])).all()
    assert np.ptp(run["valve_voltage_v"][held]) < 0.01  # V; 8 mV measured


@pytest.mark.parametrize("speed", [3.0, 10.0, 20.0, -10.0])
@pytest.mark.parametrize("level", [0.75, 1.0, 1.25])
def test_plates_that_are_released_from_lock_at_a_motor_that_pushes_have_no_torque_peak(
    speed: float, level: float
) -> None:
    """To 0, 5, 10, 15 and 24 Nm, and to idle: two rows without a torque ask for idle."""
    for after, end in ((0.0, 0.01), (5.0, 5.0), (10.0, 10.0), (15.0, 15.0), (24.0, 24.0), (0.0, 0.0)):
        run = make_run(
            (0, 0, speed, 0), (0.5, 0, speed, 0), (0.8, 24, speed, 0), (2, 24, speed, 1), (5, after, speed, 0),
            (7, end, speed, 0), level=level,
        )  # fmt: skip
        torque = np.abs(run["truth_clutch_torque_nm"])
        released = run["time_s"] >= 5.0
        assert run["controller_fault"].max() == 0
        assert run["controller_clutch_state"][~released][-1] == ClutchState.LOCKED
        assert torque[released].max() < max(torque[~released][-1], after) + PEAK, after


@pytest.mark.parametrize("speed", [3.0, 10.0, 20.0, -10.0])
def test_the_motor_is_held_until_the_clutch_has_come_down_to_what_is_asked_for(speed: float) -> None:
    """A motor that has been held in lock and may push harder while the plates still carry much would tear them apart."""
    limit = (10.8 * 4.72 - 25.1) / 1.08  # Nm: the capacity at the highest pressure of lock, less the margin
    for after in (0.0, 5.0, 10.0, 15.0):
        run = make_run(
            (0, 0, speed, 0), (0.5, 0, speed, 0), (0.8, 24, speed, 0), (2, 24, speed, 1), (5, after, speed, 0),
            (7, after, speed, 0),
        )  # fmt: skip
        motor, clutch = np.abs(run["truth_motor_torque_nm"]), np.abs(run["truth_clutch_torque_nm"])
        carries = (run["time_s"] >= 4.0) & (clutch > after + 2.0)  # 1.5 Nm above it the pressure is down
        assert motor[carries & (run["time_s"] < 5.0)].min() > 0.95 * limit, "it pushes with all it may"
        assert motor[carries].max() < limit + 0.1, after


@pytest.mark.parametrize("speed", [3.0, -3.0])
@pytest.mark.parametrize("level", [0.75, 0.85, 1.25])
def test_plates_that_rest_and_break_away_show_their_level(level: float, speed: float) -> None:
    """They are closed at rest, then the motor winds up: a strong clutch shows itself before it gives way, a weak one when."""
    run = make_run((0, 0, 0), (0.5, 0, 0), (1.5, 10, 0), (3, 10, 0), (3.2, 10, speed), (4, 10, speed), level=level)
    away = int(np.argmax(run["truth_slip_speed_rad_s"] != 0.0))
    shown = run["controller_trimmed_level"]
    assert run["controller_fault"].max() == 0
    assert run["time_s"][away] > 3.0
    assert shown[away - 1] == 1.0 if level < 1.0 else shown[away - 1] > 1.07
    left = (shown[away + 20] - level) / (1.0 - level)
    assert abs(left) < 0.5, "20 ms after break-away; the torque balance alone would leave 0.6"


def test_each_loop_has_its_own_limit() -> None:
    """30 Nm of a clutch that has 80 % of its friction are too much: the pressure settles at its limit all the same."""
    run = make_run((0, 0, 10), (0.5, 0, 10), (1.5, 30, 10), (5, 30, 10), level=0.6)
    part = run["time_s"] > 4.0
    assert run["controller_fault"].max() == 0
    assert run["controller_saturated"][part].all()
    assert run["truth_cylinder_pressure_bar"][part].mean() == pytest.approx(4.5, abs=0.01)


FOREIGN = {
    "clutch.coulomb_slope": 17.0, "clutch.coulomb_intercept": -45.05, "clutch.viscous_exponent": 0.4,
    "clutch.stribeck_speed": 6.0, "clutch.attraction": 40.0, "piston.contact_pressure": 2.65,
}  # fmt: skip


def test_every_experiment_plays_to_its_end_on_a_clutch_that_nobody_has_calibrated() -> None:
    parameters = wet_clutch.load_nominal().with_values(FOREIGN)
    for experiment in LIBRARY:
        plant = PlantNode(
            parameters=parameters, profile=load_profile(experiment.profile), temperature=experiment.temperature
        )
        run = play(plant, ControllerNode())
        assert run["controller_fault"].max() == 0, experiment.name
