"""Needs: what runs must show of a clutch, also those in which nothing moves, and several runs one after the other."""

from collections.abc import Sequence

import numpy as np
import pytest

from clutch_hil.fitting.model import Columns
from clutch_hil.identify.clutch_parameters import NEEDS
from clutch_hil.identify.stepwise import take_samples
from plant_sim.rigs import wet_clutch

DECLARED = {name: p.value for name, p in wet_clutch.load_nominal().items()}
CONTACT = DECLARED["piston.contact_pressure"]  # bar
EMPTY, PRESSED = 0.0, CONTACT + 1.0  # bar
LOADED = 8.0  # Nm, of plates in contact


def hold(pressure: float | np.ndarray, slip: float | np.ndarray, torque: float, seconds: float = 1.0) -> Columns:
    """Make a run at 1 kHz in which all other channels rest."""
    time = np.arange(round(1000 * seconds)) / 1000.0
    rest = {
        "time_s": time, "valve_voltage_v": pressure, "cylinder_pressure_bar": pressure, "slip_speed_rad_s": slip,
        "motor_speed_demand_rad_s": slip, "clutch_torque_nm": torque, "motor_torque_nm": torque, "oil_temperature_degc": 70.0,
    }  # fmt: skip
    return {name: np.broadcast_to(np.asarray(value, float), time.shape).copy() for name, value in rest.items()}


def list_unmet(runs: Sequence[Columns]) -> set[str]:
    samples = take_samples(runs)
    return {name for need in NEEDS if need.warn(samples, DECLARED) for name in need.parameters}


def test_a_full_cylinder_after_a_run_with_an_empty_one_is_no_fill() -> None:
    empty, pressed = hold(EMPTY, 10.0, 0.0), hold(PRESSED, 10.0, LOADED)
    assert "hydraulics.capacity" in list_unmet([empty, pressed])
    filled = {name: np.concatenate([empty[name], pressed[name]]) for name in empty} | {
        "time_s": np.arange(2000) / 1000.0
    }
    assert "hydraulics.capacity" not in list_unmet([filled])


@pytest.mark.parametrize("noise", [0.0, 0.02])  # rad/s, of a shaft at rest
def test_locked_plates_show_no_friction_curve(noise: float) -> None:
    """Their torque is the one that is asked for, whatever pressure and temperature are."""
    slip = noise * np.random.default_rng(1).standard_normal(1000)
    unmet = list_unmet([hold(np.linspace(CONTACT, PRESSED, 1000), slip, LOADED)])
    assert {"clutch.stribeck_speed", "clutch.viscous_exponent", "clutch.coulomb_slope", "clutch.beta_onset"} <= unmet


def test_runs_without_any_torque_excite_nothing_of_the_clutch() -> None:
    unmet = list_unmet([hold(EMPTY, 0.0, 0.0)])
    assert {name for need in NEEDS for name in need.parameters} == unmet
