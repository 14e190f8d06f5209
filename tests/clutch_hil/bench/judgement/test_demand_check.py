"""A set-point that the controller does not follow opens the clutch; a run of a profile that has one is refused."""

from pathlib import Path

import pytest

from clutch_hil.bench.judgement.demand_check import check_demands
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.simulate import Simulation
from clutch_hil.bench.up import Bench
from plant_sim.profiles.profile import Profile
from protocols.errors import InputError
from protocols.realtime.stopping import Stop
from rt_controller.loop.parameter_sets import load_controller_parameters

DEMANDS = """time_s,torque_demand_nm,motor_speed_demand_rad_s,pressure_demand_bar
0,0,10,0
1,16,10,0
2,16,20,0
3,0,20,3.2
4,0,20,0
"""
LIMITS = [
    ("torque.demand_limit", 12.0, "row 2, at 1 s: the torque demand of 16 Nm is above 12 Nm"),
    ("phases.speed_limit", 15.0, "row 3, at 2 s: the speed demand of 20 rad/s is above 15 rad/s"),
    ("torque.pressure_limit", 3.0, "row 4, at 3 s: the pressure demand of 3.2 bar is above 3 bar"),
]


def make_scenario(folder: Path, values: dict[str, float]) -> Scenario:
    (folder / "mine.csv").write_text(DEMANDS)
    return Scenario.of(RunSettings(profile=str(folder / "mine.csv"), out=folder, controller=values))


@pytest.mark.parametrize(("name", "limit", "sentence"), LIMITS)
def test_demand_above_a_limit_of_the_controller_is_refused(
    tmp_path: Path, name: str, limit: float, sentence: str
) -> None:
    scenario = make_scenario(tmp_path, {name: limit})
    with pytest.raises(InputError, match=sentence) as simulated:
        Simulation(scenario)
    assert f"reduce the demand, or change {name}" in str(simulated.value)
    with pytest.raises(InputError, match=sentence), Stop() as stop, Bench(scenario, "auto").start(stop, print):
        pytest.fail("the services were started")


def test_demand_at_the_limits_is_followed(tmp_path: Path) -> None:
    values = {"torque.demand_limit": 16.0, "phases.speed_limit": 20.0, "torque.pressure_limit": 3.2}
    assert Simulation(make_scenario(tmp_path, values)).profile.duration == 4.0


def test_demand_of_one_of_two_clutches_is_checked() -> None:
    scenario = Scenario.of(RunSettings(profile="shift", controller={"torque.demand_limit": 8.0}), "power_shift")
    with pytest.raises(
        InputError, match=r"profile shift of clutch a, row .*: the torque demand of .* Nm is above 8 Nm"
    ):
        scenario.make_controllers(scenario.load_profile())


def test_torque_of_a_locked_clutch_is_no_demand() -> None:
    times, torques, locks = (0.0, 1.0, 1.5, 2.0, 3.0), (0.0, 10.0, 20.0, 10.0, 0.0), (0.0, 1.0, 1.0, 0.0, 0.0)
    locked = Profile("locked", times, torques, (10.0,) * 5, lock=locks)
    parameters = load_controller_parameters().with_values({"torque.demand_limit": 15.0})
    check_demands(locked, parameters)
    with pytest.raises(InputError, match="row 3"):
        check_demands(Profile("open", times, torques, (10.0,) * 5), parameters)
