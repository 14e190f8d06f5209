"""Other rig: a fault of a healthy clutch names the numbers that its controller was not told."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.bench.judgement.other_rig import describe_hot_oil, describe_other_rig, describe_weak_motor
from clutch_hil.bench.result import Result
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.simulate import Simulation
from plant_sim.rigs import wet_clutch
from rt_controller.loop.parameter_sets import load_controller_parameters

RIG, CONTROLLER = wet_clutch.load_nominal().as_values(), load_controller_parameters().as_values()
TOLD = "the controller was told another rig than the simulated one: "
GIVE = "; give them by --controller-parameters, or a --calibration of clutch-hil identify"
SMALL = {  # a joint of a robot: 0.3 Nm/bar
    "clutch.coulomb_slope": 0.3, "clutch.coulomb_intercept": -0.7, "clutch.viscous_slope": 0.07,
    "clutch.viscous_intercept": -0.17,
}  # fmt: skip


def test_a_rig_that_the_controller_was_told_is_no_other_one() -> None:
    assert describe_other_rig(CONTROLLER, RIG) is None
    assert describe_other_rig(CONTROLLER, {}) is None, "a real rig"
    assert describe_other_rig({}, RIG) is None, "a run of another program"


@pytest.mark.parametrize(
    ("rig", "named"),
    [
        ({"piston.contact_pressure": 4.0}, "model.contact_pressure = 2.35 bar, but the rig has 4"),
        ({"valve.gain": 1.5}, "pressure.valve_gain = 2.5 bar/V, but the rig has 1.5"),
        ({"motor.torque_limit": 5.0}, "phases.motor_torque_limit = 40 Nm, but the rig has 5"),
        (
            {"clutch.coulomb_slope": 34.0, "piston.contact_pressure": 2.7, "motor.inertia": 0.15},
            "model.coulomb_slope = 10.8 Nm/bar, but the rig has 34; model.motor_inertia = 0.05 kg m^2, but the rig has 0.15;"
            " model.contact_pressure = 2.35 bar, but the rig has 2.7",
        ),
    ],
)
def test_what_is_far_is_named_farthest_first(rig: Mapping[str, float], named: str) -> None:
    assert describe_other_rig(CONTROLLER, RIG | rig) == f"{TOLD}{named}{GIVE}"


def test_of_two_clutches_each_controller_is_compared_with_its_own() -> None:
    rig = {f"a.{name}": 2.0 * value for name, value in RIG.items()}
    assert (describe_other_rig(CONTROLLER, rig, "a.") or "").count("but the rig has") == 6
    assert describe_other_rig(CONTROLLER, rig) is None, "names of another clutch"


def play(folder: Path, changed: Mapping[str, float], **settings: object) -> Result:
    scenario = Scenario.of(RunSettings(out=folder, **settings))  # type: ignore[arg-type]
    return Simulation(replace(scenario, plant=scenario.plant.with_values(changed))).run(lambda done, of: None)


def test_a_small_clutch_whose_slope_was_not_told_says_so(tmp_path: Path) -> None:
    result = play(tmp_path, SMALL, seconds=3.0)
    assert not result.good
    assert f"warning: {TOLD}" in result.text
    assert "model.coulomb_slope = 10.8 Nm/bar, but the rig has 0.3" in result.text


def test_a_motor_that_gives_less_than_is_demanded_is_told(tmp_path: Path) -> None:
    result = play(tmp_path, {"motor.torque_limit": 6.0}, seconds=3.0)
    assert "warning: the torque demand is up to 10 Nm, but the motor of the simulated rig gives 6 Nm" in result.text
    columns = {"torque_demand_nm": np.array([np.nan, 6.0])}
    assert describe_weak_motor(columns, {"motor.torque_limit": 6.0}) is None
    assert describe_weak_motor({"torque_demand_nm": np.array([np.nan])}, RIG) is None
    assert describe_weak_motor(columns, {}) is None


def test_oil_that_is_too_hot_says_which_numbers_to_give() -> None:
    columns = {"clutch_torque_nm": np.array([100.0, 1.0]), "slip_speed_rad_s": np.array([-50.0, 1.0])}
    assert describe_hot_oil("overtemperature", columns, RIG) == (
        "the plates heat with up to 5e+03 W, and the oil of the simulated rig has 600 J/K and 3 W/K; give oil.heat_capacity and"
        " oil.heat_transfer of your rig by --plant-parameters, or slip less"
    )
    assert describe_hot_oil("overspeed", columns, RIG) is None
    assert describe_hot_oil("overtemperature", columns, {}) is None
