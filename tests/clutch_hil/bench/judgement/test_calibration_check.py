"""Calibration check: a wrong calibration is told, a torque that is only late or turns an inertia is none."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.bench.judgement.calibration_check import (
    describe_coarse_pressure,
    describe_failed_fill,
    describe_late_piston,
    describe_mismatch,
    describe_shift_mismatch,
    describe_slow_valve,
)
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.simulate import Simulation
from clutch_hil.identify.controller_values import derive_controller_values
from plant_sim.rigs import wet_clutch
from rt_controller.law.lag import LAG, low_pass
from rt_controller.law.phases import Phase
from rt_controller.law.record import make_record
from rt_controller.loop.parameter_sets import load_controller_parameters

BANDWIDTH, INERTIA, RATIOS = 566.0, 0.05, (3.0, 2.0)  # 1/s, kg m^2: of controller.toml
PARAMETERS = {
    "slip.bandwidth": BANDWIDTH,
    "model.motor_inertia": INERTIA,
    "driveline.ratio_a": RATIOS[0],
    "driveline.ratio_b": RATIOS[1],
}
OFF, OTHER = "its calibration or the torque sensor is off", "its calibration belongs to another clutch"
# Engagements of 0.25 s that begin at 0 Nm and end under load. Told the calibration of the rig, its estimate is 0.01 Nm off
SHORT = "time_s,torque_demand_nm,motor_speed_demand_rad_s\n" + "".join(
    f"{0.5 * i + at},{torque},10.47\n"
    for i in range(8)
    for at, torque in ((0.0, 0), (0.1, 0), (0.15, 10), (0.3, 10), (0.35, 0))
)
# Clutch a alone pulls while the motor speeds up: from 5 to 25 rad/s in half a second
LAUNCH = "time_s,torque_demand_a_nm,torque_demand_b_nm,input_speed_demand_rad_s\n" + "".join(
    f"{row}\n" for row in ("0,0,0,5", "0.3,0,0,5", "0.5,0.3,0,5", "0.7,3,0,5", "1.2,3,0,25", "1.3,0,0,25", "1.5,0,0,25")
)


def lag(signal: np.ndarray, rate: int) -> np.ndarray:
    """A signal behind the lag of the law's observer, which takes that of the sample before."""
    state, q = make_record(LAG), float(np.exp(-BANDWIDTH / rate))
    return np.array([low_pass(state, float(value), q) for value in (0.0, *signal[:-1])])


def make_touches(rate: int, seconds: float, count: int, gain: float = 1.0) -> Mapping[str, np.ndarray]:
    """Slip control of some `seconds`, from 0 to 10 Nm, `count` times; the estimate is `gain` times the torque."""
    whole = round((seconds + 0.5) * rate)
    time, closed = np.arange(count * whole) / rate, np.arange(count * whole) % whole < round(seconds * rate)
    torque = np.where(closed, 10.0 * np.minimum((time % (whole / rate)) / 0.05, 1.0), 0.0)
    return {
        "time_s": time,
        "controller_phase": np.where(closed, float(Phase.SLIP_CONTROL), float(Phase.IDLE)),
        "slip_speed_rad_s": np.full(len(time), -10.0),
        "controller_observed_torque_nm": -lag(torque, rate),
        "controller_torque_estimate_nm": -gain * torque,
    }


@pytest.mark.parametrize("rate", [250, 500, 1000, 2000])
def test_a_torque_that_is_late_is_no_wrong_calibration(rate: int) -> None:
    assert describe_mismatch(make_touches(rate, 0.25, 6), PARAMETERS) is None
    sentence = describe_mismatch(make_touches(rate, 0.25, 6, gain=1.03), PARAMETERS)
    assert sentence
    assert OFF in sentence
    assert "3.0 %" in sentence
    assert OTHER in (describe_mismatch(make_touches(rate, 0.25, 6, gain=1.2), PARAMETERS) or "")


@pytest.mark.parametrize("rate", [250, 2000])
def test_a_touch_is_not_judged_whatever_the_rate(rate: int) -> None:
    assert describe_mismatch(make_touches(rate, 0.15, 1, gain=1.5), PARAMETERS) is None
    assert OTHER in (describe_mismatch(make_touches(rate, 0.25, 1, gain=1.5), PARAMETERS) or "")


def test_without_the_lag_nothing_is_said() -> None:
    assert describe_mismatch(make_touches(1000, 1.0, 1, gain=1.5), {}) is None


def test_a_run_of_short_engagements_is_not_told_as_a_wrong_calibration(tmp_path: Path) -> None:
    path = tmp_path / "short.csv"
    path.write_text(SHORT, encoding="utf-8")
    rig = {name: p.value for name, p in wet_clutch.load_nominal().items()}
    known = {
        name: value for name, (value, _) in derive_controller_values(rig, rig, load_controller_parameters()).items()
    }
    run = ch.simulate(profile=path, controller=known)
    assert describe_mismatch(run.columns, run.metadata["controller_parameters"]) is None


def test_a_fill_that_times_out_says_what_the_controller_needs_to_know(tmp_path: Path) -> None:
    """A valve with 18 bar at 10 V: the controller's own 2.5 bar/V fill its cylinder to 2.1 bar."""
    scenario = Scenario.of(RunSettings(seconds=2.5, out=tmp_path, controller={"pressure.valve_gain": 2.6}))
    weak = replace(scenario, plant=scenario.plant.with_values({"valve.gain": 1.8}))
    result = Simulation(weak).run(lambda done, of: None)
    assert "fill timeout" in result.verdict
    assert "pressure.valve_gain = 2.6 bar/V, but the rig has 1.8; give them by --controller-parameters" in result.text
    assert "the rig has" not in Simulation(scenario).run(lambda done, of: None).text
    of_real_rig = describe_failed_fill("fill timeout", scenario.settings.make_controller().parameters.as_values()) or ""
    assert "expects contact at 2.35 bar and 2.6 bar/V of the valve" in of_real_rig
    assert "model.contact_pressure, phases.fill_pressure, pressure.valve_gain by --controller-" in of_real_rig


def test_a_fill_of_one_of_two_clutches_that_times_out_says_it_too(tmp_path: Path) -> None:
    scenario = Scenario.of(RunSettings(profile="shift", seconds=3.5, rate=500, out=tmp_path), "power_shift")
    weak = replace(scenario, plant=scenario.plant.with_values({"a.valve.gain": 1.6}))
    result = Simulation(weak).run(lambda done, of: None)
    assert "fill timeout" in result.verdict
    assert "pressure.valve_gain = 2.5 bar/V, but the rig has 1.6" in result.text


@pytest.mark.parametrize(
    ("controller", "advised"),
    [({}, True), ({"pressure.valve_frequency": 10.0}, False), ({"pressure.integral_gain": 0.9}, False)],
)
def test_a_pressure_fault_with_a_slow_valve_says_how_the_gains_follow(
    controller: Mapping[str, float], advised: bool
) -> None:
    """Two lags of 100 ms, and a pressure that the guard does not allow."""
    settings = RunSettings(controller=controller)
    parameters, shipped = settings.make_controller().parameters.as_values(), Scenario.of(settings).plant
    slow = shipped.with_values({"valve.frequency": 10.0, "valve.damping": 1.0}).as_values()
    for fault, told in (("overpressure", advised), ("pressure lost", advised), ("overspeed", False), ("none", False)):
        advice = describe_slow_valve(fault, parameters, slow)
        assert (advice is not None) == told
        if advice:
            assert (
                "another valve than the rig's, which has 10 rad/s (1.59 Hz) and a damping of 1; give pressure.valve_"
                in advice
            )
    in_a = {f"a.{name}": value for name, value in slow.items()}  # of one of two clutches
    assert (describe_slow_valve("overpressure", parameters, in_a, "a.") is not None) == advised
    assert describe_slow_valve("overpressure", parameters, shipped.as_values()) is None
    assert describe_slow_valve("overpressure", parameters, {}) is None, "a rig whose valve is not known"


def test_a_run_that_swings_with_a_slow_valve_says_it(tmp_path: Path) -> None:
    scenario = Scenario.of(RunSettings(profile="lock", out=tmp_path))
    slow = scenario.plant.with_values({"valve.frequency": 6.7, "valve.damping": 1.0, "valve_delay.delay": 20.0})
    result = Simulation(replace(scenario, plant=slow)).run(lambda done, of: None)
    assert "overpressure" in result.verdict
    assert "pressure.valve_damping, pressure.valve_delay, pressure.valve_frequency by --controller-" in result.text
    scenario = Scenario.of(RunSettings(profile="lock", seconds=2.0, out=tmp_path))
    swinging = scenario.plant.with_values({"valve.damping": 0.2})
    result = Simulation(replace(scenario, plant=swinging)).run(lambda done, of: None)
    assert "torque followed poorly" in result.verdict
    assert "8 Hz) and a damping of 0.2; give pressure.valve_damping, pressure.valve_delay" in result.text


def test_a_pressure_signal_with_coarse_steps_is_told_where_it_seems_frozen(tmp_path: Path) -> None:
    """A converter of 6 bits: 0.31 bar."""
    scenario = Scenario.of(RunSettings(seconds=5.0, out=tmp_path))
    coarse = scenario.plant.with_values({"sensors.pressure_bits": 6.0})
    result = Simulation(replace(scenario, plant=coarse)).run(lambda done, of: None)
    assert "pressure lost" in result.verdict
    assert "the pressure signal has steps of 0.312 bar, and is taken for a frozen one" in result.text
    assert (
        "raise phases.frozen_change above 0.312 bar, and guard.frozen_voltage in limits.toml above 0.125 V"
        in result.text
    )
    parameters = scenario.settings.make_controller().parameters.as_values()
    for levels in ([1.0, 1.04, 1.0], [1.0]):
        assert (
            describe_coarse_pressure("pressure lost", {"cylinder_pressure_bar": np.array(levels)}, parameters) is None
        )
    far = {"cylinder_pressure_bar": np.array([1.0, 1.06])}
    assert describe_coarse_pressure("pressure lost", far, parameters) is not None
    assert describe_coarse_pressure("overspeed", far, parameters) is None
    assert describe_coarse_pressure("pressure lost", far, {}) is None


def make_late_piston(felt: float, slip_control: float) -> Mapping[str, np.ndarray]:
    """A fill of 0.5 s, slip control [s] with an estimate of 100 Nm of which the motor feels `felt` [Nm], then the fault."""
    time = np.arange(0.0, 0.6 + slip_control, 0.01)
    phase = np.select(
        [time < 0.5, time < 0.5 + slip_control], [float(Phase.FILL), float(Phase.SLIP_CONTROL)], float(Phase.FAULT)
    )
    closed = phase == Phase.SLIP_CONTROL
    return {
        "time_s": time, "controller_phase": phase, "controller_fault": np.where(phase == Phase.FAULT, 7.0, 0.0),
        "controller_observed_torque_nm": np.where(closed, -felt, 0.0),
        "controller_torque_estimate_nm": np.where(closed, -100.0, 0.0),
    }  # fmt: skip


def test_a_piston_that_arrives_late_is_told_from_another_clutch() -> None:
    sentence = describe_late_piston("torque implausible", make_late_piston(3.0, 0.5)) or ""
    assert sentence.startswith(
        "the motor felt 3 Nm where the controller estimated 100 Nm, 0.5 s after the fill: the piston has"
    )
    assert "raise phases.mismatch_dwell, phases.touch_band, phases.touch_time, or model.contact_pressure" in sentence
    for fault, felt, seconds in (
        ("overspeed", 3.0, 0.5),
        ("torque implausible", 11.0, 0.5),
        ("torque implausible", 3.0, 2.5),
    ):
        assert describe_late_piston(fault, make_late_piston(felt, seconds)) is None, (fault, felt, seconds)
    healthy = make_late_piston(3.0, 0.5) | {"controller_fault": np.zeros(110)}
    assert describe_late_piston("torque implausible", healthy) is None


def test_a_large_piston_in_thick_oil_says_what_to_raise(tmp_path: Path) -> None:
    scenario = Scenario.of(RunSettings(seconds=4.0, out=tmp_path))
    slow = scenario.plant.with_values({"piston.damping": 5e5, "piston.clearance": 3e-3})
    result = Simulation(replace(scenario, plant=slow)).run(lambda done, of: None)
    assert "torque implausible" in result.verdict
    assert "the piston has not reached the plates yet" in result.text
    told = {"phases.touch_time": 3.0, "phases.touch_band": 1.0, "phases.mismatch_dwell": 1.0}
    settings = replace(scenario.settings, controller=told)
    healthy = Simulation(replace(scenario, settings=settings, plant=slow)).run(lambda done, of: None)
    assert "fault" not in healthy.verdict


def make_launch(acceleration: float, gain: float = 1.0, rate: int = 500) -> Mapping[str, np.ndarray]:
    """Clutch a alone carries 5 Nm while the input speeds up [rad/s^2]; the vehicle stands."""
    time = np.arange(rate) / rate
    observed = lag(np.full(rate, acceleration), rate)
    return {
        "time_s": time,
        "motor_torque_nm": 5.0 + INERTIA * np.full(rate, acceleration),
        **{f"controller{b}_slip_acceleration_rad_s2": observed for b in ("", "_b")},
        **{f"slip_speed_{clutch}_rad_s": 5.0 + acceleration * time for clutch in "ab"},
        "controller_phase": np.full(rate, float(Phase.SLIP_CONTROL)),
        "controller_b_phase": np.full(rate, float(Phase.IDLE)),
        "controller_torque_estimate_nm": np.full(rate, 5.0 * gain),
        "controller_b_torque_estimate_nm": np.zeros(rate),
    }


@pytest.mark.parametrize("acceleration", [0.0, 40.0])
def test_a_torque_that_speeds_up_the_input_is_no_wrong_calibration(acceleration: float) -> None:
    assert describe_shift_mismatch(make_launch(acceleration), PARAMETERS) is None
    sentence = describe_shift_mismatch(make_launch(acceleration, gain=1.3), PARAMETERS)
    assert sentence
    assert sentence.startswith(
        "on clutch a alone motor and inertia gave 5.0 Nm on average, 1.5 Nm less than its controller"
    )
    assert OTHER in sentence
    assert describe_shift_mismatch(make_launch(acceleration, gain=1.3), {}) is None


def test_a_launch_is_not_told_as_a_wrong_calibration(tmp_path: Path) -> None:
    (tmp_path / "launch.csv").write_text(LAUNCH, encoding="utf-8")
    path = tmp_path / "launch.toml"
    path.write_text(
        'title = "launch"\nrig = "power_shift"\n[run]\nprofile = "launch.csv"\nrate = 500\n', encoding="utf-8"
    )
    run = ch.simulate(path)
    parameters = run.metadata["controller_parameters"]
    assert describe_shift_mismatch(run.columns, parameters) is None
    wrong = run.columns | {"controller_torque_estimate_nm": 1.5 * run.columns["controller_torque_estimate_nm"]}
    assert OTHER in (describe_shift_mismatch(wrong, parameters) or "")
