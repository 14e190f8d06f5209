"""Declared clutch: numbers that contradict each other are told, and those of clutches that exist are not."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from clutch_hil.bench.judgement.declared_clutch import list_contradictions
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.simulate import Simulation
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from rt_controller.loop.parameter_sets import load_controller_parameters

RIG, CONTROLLER = wet_clutch.load_nominal().as_values(), load_controller_parameters().as_values()
EXAMPLE = Path("docs/examples/other_clutch.toml")


def test_no_clutch_that_is_shipped_contradicts_itself() -> None:
    for values in (RIG, CONTROLLER, wet_clutch.load_nominal(EXAMPLE).as_values()):
        assert list_contradictions(values) == []
    assert list_contradictions({}) == [], "a rig of a user has other parameters"


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        (
            {"clutch.coulomb_slope": 108.0},
            "by clutch.coulomb_slope = 108 and clutch.coulomb_intercept = -25.1 the Coulomb torque is 229 Nm at"
            " piston.contact_pressure = 2.35 bar, where the plates begin to touch, and not about 0:"
            " clutch.coulomb_intercept = -253.8 would fit",
        ),
        (
            {"clutch.coulomb_slope": 5.4},
            "by clutch.coulomb_slope = 5.4 and clutch.coulomb_intercept = -25.1 the Coulomb torque is 0 up to 4.65 bar, far"
            " above piston.contact_pressure = 2.35 bar, where the plates begin to touch: clutch.coulomb_intercept = -12.69"
            " would fit",
        ),
        (
            {"clutch.viscous_slope": 5.0},
            "by clutch.viscous_slope = 5 and clutch.viscous_intercept = -6.49 the viscous torque is 5.26 Nm/(rad/s)^gamma at"
            " piston.contact_pressure = 2.35 bar, where the plates begin to touch, and not about 0:"
            " clutch.viscous_intercept = -11.75 would fit",
        ),
    ],
)
def test_a_line_that_does_not_begin_at_contact_is_told(changed: Mapping[str, float], sentence: str) -> None:
    assert list_contradictions(RIG | changed) == [sentence]
    in_a = {f"a.{name}": value for name, value in (RIG | changed).items()}
    assert list_contradictions(in_a, "a.") == [sentence.replace("clutch.", "a.clutch.").replace("piston.", "a.piston.")]
    assert list_contradictions(in_a, "b.") == []


def test_a_contact_pressure_that_was_changed_alone_is_told_for_both_lines() -> None:
    coulomb, viscous = list_contradictions(RIG | {"piston.contact_pressure": 4.0})
    assert "the Coulomb torque is 18.1 Nm at piston.contact_pressure = 4 bar" in coulomb
    assert "clutch.viscous_intercept = -10.68 would fit" in viscous


def test_the_limit_is_at_its_share_of_the_contact_pressure() -> None:
    for zero, told in ((0.885, 0), (1.115, 0), (0.875, 1), (1.125, 1)):
        line = {"clutch.coulomb_intercept": -10.8 * 2.35 * zero}
        assert len(list_contradictions(RIG | line)) == told, zero


def test_a_clutch_that_is_nearly_all_viscous_is_told() -> None:
    small = {"clutch.coulomb_slope": 0.3, "clutch.coulomb_intercept": -0.7}
    (sentence,) = list_contradictions(RIG | small)
    assert "the viscous torque at 10 rad/s is 19.2 times the Coulomb torque" in sentence
    assert list_contradictions(RIG | small | {"clutch.viscous_slope": 0.07, "clutch.viscous_intercept": -0.17}) == []
    assert list_contradictions(RIG | {"clutch.viscous_slope": 0.0}) == [], "dry plates have no viscous torque"


def test_a_controller_may_leave_the_intercept_out() -> None:
    (sentence,) = list_contradictions(CONTROLLER | {"model.coulomb_slope": 30.0})
    assert sentence.endswith("or leave it out: then it follows the contact pressure")


def test_a_run_tells_it_once_for_the_rig_and_is_judged_all_the_same(tmp_path: Path) -> None:
    scenario = Scenario.of(RunSettings(seconds=0.2, out=tmp_path))
    steep = replace(scenario, plant=scenario.plant.with_values({"clutch.coulomb_slope": 108.0}))
    result = Simulation(steep).run(lambda done, of: None)
    assert result.text.count("warning: by clutch.coulomb_slope = 108") == 1
    assert result.document["warnings"] == list_contradictions(steep.plant.as_values())
    assert "warning" not in Simulation(scenario).run(lambda done, of: None).text
    with pytest.raises(InputError):  # the rest of a rig that cannot be is refused as before
        wet_clutch.Rig(scenario.plant.with_values({"piston.contact_pressure": 1.0}))
