"""Runs of different clutches that are given together."""

from functools import cache

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.bench.in_memory import simulate
from clutch_hil.identify.recorded_runs.other_clutch import find_other_clutch
from clutch_hil.identify.thesis_quantities import compute_torque
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.run import Run

LINES = ("coulomb", "viscous")


@cache
def play(profile: str, contact: float = 0.0, slope: float = 1.0) -> Run:
    """A run of the clutch whose contact pressure is `contact` [bar] higher, and whose friction is `slope` times the shipped."""
    nominal = wet_clutch.load_nominal()
    moved = ("piston.contact_pressure", "piston.preload_pressure", "clutch.beta_onset")
    plant = {name: nominal[name].value + contact for name in moved}
    for line in LINES:
        rise = slope * nominal[f"clutch.{line}_slope"].value
        plant[f"clutch.{line}_slope"] = rise
        plant[f"clutch.{line}_intercept"] = slope * nominal[f"clutch.{line}_intercept"].value - contact * rise
    return simulate(profile=profile, seconds=12.0, seed=3, rate=500, plant=plant)


def find(**runs: Run) -> list[str]:
    return [str(f) for f in find_other_clutch({name: run.columns for name, run in runs.items()})]


def test_runs_of_one_clutch_are_of_one() -> None:
    profiles = ("engagement", "pressure_steps", "multisine", "creep", "slip_sine")  # of the last two none shows a line
    assert find(**{profile: play(profile) for profile in profiles}) == []


def test_a_higher_contact_pressure_is_told_of_the_run_with_more_torque() -> None:
    (text,) = find(ours=play("pressure_steps"), theirs=play("pressure_steps", contact=0.4))
    assert text.startswith("run ours: clutch_torque_nm, rows 0 to 5999, is 1")
    assert "that of run theirs is 1" in text


def test_more_friction_is_told() -> None:
    (text,) = find(ours=play("pressure_steps"), too=play("multisine"), theirs=play("pressure_steps", slope=1.5))
    assert text.startswith("run theirs: clutch_torque_nm, rows 0 to 5999, is 2")


@pytest.mark.parametrize("contact", [-0.05, 0.05])
def test_a_pressure_sensor_that_was_zeroed_again_is_no_other_clutch(contact: float) -> None:
    assert find(ours=play("pressure_steps"), theirs=play("multisine", contact=contact)) == []


def slide(slip: float, celsius: float, friction: float = 1.0) -> dict[str, np.ndarray]:
    """A ramp of the pressure at a steady `slip` [rad/s] of a clutch whose torque grows by half from 2 to 26 rad/s."""
    values = {name: p.value for name, p in wet_clutch.load_nominal().items()} | {
        "piston.contact_pressure": 1.75, "clutch.coulomb_slope": 11.1, "clutch.coulomb_intercept": -19.4,
        "clutch.viscous_slope": 3.41, "clutch.viscous_intercept": -6.23, "clutch.beta_onset": 2.19,
        "clutch.viscous_exponent": 0.416, "oil.viscous_gain": 3.0,
    }  # fmt: skip
    time = np.arange(4000) / 500.0
    pressure = np.interp(time, [0.0, 1.0, 8.0], [0.0, 0.0, 3.2])
    speed = np.full(len(time), slip)
    torque = friction * compute_torque(values, pressure, slip, celsius)
    noise = np.random.default_rng(7).normal(0.0, 0.05, len(time))
    return {
        "time_s": time, "cylinder_pressure_bar": pressure, "clutch_torque_nm": torque + noise, "slip_speed_rad_s": speed,
        "motor_speed_demand_rad_s": speed, "motor_torque_nm": torque, "valve_voltage_v": 0.4 * pressure,
        "oil_temperature_degc": np.full(len(time), celsius),
    }  # fmt: skip


def test_a_fast_slip_in_cold_oil_is_no_other_clutch() -> None:
    assert find_other_clutch({"slow": slide(3.2, 93.0), "middle": slide(8.0, 80.0), "fast": slide(26.6, 60.0)}) == []


def test_more_friction_is_told_of_runs_of_like_slip() -> None:
    (finding,) = find_other_clutch({"slow": slide(3.2, 70.0), "fast": slide(26.6, 70.0), "too": slide(4.0, 70.0, 1.5)})
    assert (finding.run, finding.hard) == ("too", True)
    assert "that of run slow is" in str(finding)


def test_identify_refuses_them_before_it_fits() -> None:
    steps: list[str] = []
    with pytest.raises(InputError, match=r"different clutches.*--force-checks, force=True"):
        ch.identify_clutch(
            [play("pressure_steps"), play("pressure_steps", contact=0.4)],
            progress=lambda what, share: steps.append(what),
        )
    assert steps == []


def test_runs_without_samples_in_contact_say_nothing() -> None:
    still = {name: np.zeros(6000) for name in play("pressure_steps").columns} | {"time_s": np.arange(6000) / 500.0}
    assert find(ours=play("pressure_steps"), still=Run(still, {})) == []
