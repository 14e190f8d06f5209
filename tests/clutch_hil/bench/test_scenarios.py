"""Every scenario that comes with the bench passes, and fails when what it looks at is broken."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from clutch_hil.bench.judgement.measures import MEASURES
from clutch_hil.bench.limits import Judgement, judge_limits
from clutch_hil.bench.rig import find_rig, list_rigs
from clutch_hil.bench.scenario import Scenario, find_shipped_scenarios, load_scenario
from clutch_hil.bench.simulate import Simulation
from protocols.files.runs import read_run

DOCS = Path(__file__).parents[3] / "docs" / "scenarios.md"
PAST_LIMIT = 0.02  # of the limit: at least so far is each value from it; noise moves the values by less than 1 %


def judge_scenario(scenario: Scenario) -> list[Judgement]:
    """Limits of a scenario, judged without a picture."""
    columns: Mapping[str, Any] = Simulation(scenario).play(scenario.plant, scenario.settings.seed).make_columns()
    return list(judge_limits(scenario.limits, columns))


@pytest.mark.parametrize("name", find_shipped_scenarios())
def test_a_scenario_passes_with_margin(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.title
    assert scenario.about
    assert len(scenario.limits) >= 2
    for judgement in judge_scenario(scenario):
        assert judgement.holds, str(judgement)
        for limit in (judgement.limit.least, judgement.limit.most):
            if limit is not None:
                assert abs(float(judgement.value) - limit) > PAST_LIMIT * abs(limit), str(judgement)


# scenario: seconds of it in which the limits hold otherwise, change of the plant, change of the controller, limits that break
BROKEN = {
    "engagement": (5.0, {}, {"model.coulomb_intercept": -21.1}, {"regime_error_nm", "max_torque_error_nm"}),
    "adaptation": (5.0, {}, {"adaptation.time_constant": 100.0}, {"friction_level"}),
    "frozen_motor_torque": (5.0, {}, {"adaptation.stuck_time": 10.0}, {"peak_torque_nm", "regime_error_nm"}),
    "hold_and_release": (None, {"friction_fade.fade": 6e-5}, {}, {"held_torque_spread_nm"}),
    "multisine": (7.0, {"slower_valve.ratio": 0.8}, {}, {"pressure_bandwidth_hz"}),
    "lock": (4.0, {}, {"lock.rate": 5.0}, {"locking_time_s"}),
    "hill_hold": (4.0, {}, {"model.coulomb_slope": 12.0}, {"breakaway_torque_nm"}),
    "free_inertia": (None, {"motor.inertia": 0.6}, {}, {"peak_torque_nm"}),
    "creep": (5.0, {}, {"model.coulomb_intercept": -21.1}, {"regime_error_nm"}),
    "fast_reversal": (4.0, {}, {"model.attraction": 20.0}, {"estimate_error_nm"}),
    "release_from_lock": (5.0, {}, {"lock.rate": 5.0}, {"locking_time_s"}),
    "seal_hysteresis_triangle": (None, {"piston_seal_friction.force": 10.0}, {}, {"torque_loop_nm"}),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_scenario_fails_when_something_breaks(name: str) -> None:
    seconds, plant, controller, measures = BROKEN[name]
    scenario = load_scenario(name, {"controller": {**load_scenario(name).settings.controller, **controller}})
    scenario = replace(scenario, settings=replace(scenario.settings, seconds=seconds))
    columns = Simulation(scenario).play(scenario.plant.with_values(plant), scenario.settings.seed).make_columns()
    broken = {judgement.limit.measure for judgement in judge_limits(scenario.limits, columns) if not judgement.holds}
    assert measures <= broken


def test_a_frozen_sensor_that_is_not_frozen_is_no_fault() -> None:
    scenario = replace(load_scenario("frozen_pressure_sensor", {"seconds": 4.0}), injections=())
    columns = Simulation(scenario).play(scenario.plant, 1).make_columns()
    assert MEASURES["fault"].of(columns) == "none"


def test_every_measure_is_in_the_documentation_and_none_else() -> None:
    text = DOCS.read_text(encoding="utf-8")
    for rig in list_rigs():
        for name, measure in find_rig(rig).measures.items():
            assert f"| `{name}` | {measure.unit or 'word'} | {measure.what} |" in text


def test_every_scenario_is_in_the_documentation() -> None:
    text = DOCS.read_text(encoding="utf-8")
    for name in find_shipped_scenarios():
        assert f"| `{name}` | {load_scenario(name).title} |" in text


def test_the_run_file_names_its_scenario(tmp_path: Path) -> None:
    scenario = load_scenario("frozen_pressure_sensor", {"out": tmp_path, "seconds": 3.4})
    result = Simulation(scenario).run(lambda done, total: None)
    metadata = read_run(Path(result.document["run"])).metadata
    assert metadata["scenario"] == "frozen_pressure_sensor"
    assert [(i["name"], i["at"], i["row"]) for i in metadata["injections"]] == [("sensor_freeze.pressure", 3.3, 3300)]
