"""Maps follow a contact pressure that a file gives without them, so that a clutch of a guess is not taken for a faulty one."""

from pathlib import Path

import pytest

from clutch_hil.bench.in_process import play
from clutch_hil.identify.clutch_parameters import shift_pressures
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch
from rt_controller.law.contact_maps import shift_maps
from rt_controller.loop.node import ControllerNode
from rt_controller.loop.parameter_sets import load_controller_parameters

SHIPPED = load_controller_parameters()
STRONG_SPRINGS = {  # contact at 3.6 bar
    "piston.preload_pressure": 3.0, "piston.contact_pressure": 3.6, "clutch.coulomb_intercept": -38.9,
    "clutch.viscous_intercept": -9.6, "clutch.beta_onset": 3.95,
}  # fmt: skip


def test_maps_move_with_the_contact_pressure_as_those_of_the_rig_do() -> None:
    nominal = {name: p.value for name, p in wet_clutch.load_nominal().items()}
    for contact in (0.5, 1.2, 3.5, 9.0):
        own = SHIPPED.with_values({"model.contact_pressure": contact})
        moved = shift_pressures(nominal, contact - nominal["piston.contact_pressure"])
        expected = {
            f"model.{n}": moved[f"clutch.{n}"] for n in ("coulomb_intercept", "viscous_intercept", "beta_onset")
        }
        assert shift_maps(own, SHIPPED, ()) == pytest.approx(expected, rel=1e-12)


def test_a_slope_that_is_given_begins_at_the_contact_pressure_too() -> None:
    own = SHIPPED.with_values({"model.contact_pressure": 3.0, "model.coulomb_slope": 110.0})
    intercept = shift_maps(own, SHIPPED, ())["model.coulomb_intercept"]
    assert -intercept / 110.0 == pytest.approx(3.0 - 2.35 + 25.1 / 10.8, rel=1e-12)


def test_a_slope_alone_turns_its_line_about_its_zero() -> None:
    """Else ten times the slope gives 229 Nm at the first touch."""
    steeper = SHIPPED.with_values({"model.coulomb_slope": 108.0})
    kept = {"model.viscous_slope", "model.viscous_intercept"}
    assert shift_maps(steeper, SHIPPED, kept) == pytest.approx({"model.coulomb_intercept": -251.0}, rel=1e-12)
    assert shift_maps(steeper, SHIPPED, {"model.coulomb_intercept", *kept}) == {}


def test_viscous_torque_keeps_its_share_with_a_slope() -> None:
    """Else the torque of a robot's clutch, a hundredth as steep, would be nearly all viscous."""
    own = SHIPPED.with_values({"model.coulomb_slope": 0.108})
    followed = own.with_values(shift_maps(own, SHIPPED, {"model.coulomb_slope"}))
    for part in ("slope", "intercept"):
        shares = [p[f"model.viscous_{part}"].value / p[f"model.coulomb_{part}"].value for p in (followed, SHIPPED)]
        assert shares[0] == pytest.approx(shares[1], rel=1e-12)
    assert shift_maps(followed, SHIPPED, {"model.coulomb_slope"}).keys() == {
        "model.coulomb_intercept",
        "model.viscous_intercept",
    }
    assert "model.viscous_slope" not in shift_maps(own, SHIPPED, {"model.viscous_slope"})


def test_maps_that_are_given_and_those_of_the_shipped_parameters_stay() -> None:
    own = SHIPPED.with_values({"model.contact_pressure": 3.0})
    assert shift_maps(own, SHIPPED, {"model.coulomb_intercept"}).keys() == {
        "model.viscous_intercept",
        "model.beta_onset",
    }
    assert shift_maps(SHIPPED, SHIPPED, ()) == {}


def test_a_clutch_of_which_the_contact_pressure_is_guessed_ends_in_no_fault(tmp_path: Path) -> None:
    guess = tmp_path / "guess.toml"
    guess.write_text("[model]\ncontact_pressure = 3.5\n")
    rig = wet_clutch.load_nominal().with_values(STRONG_SPRINGS)
    controller = ControllerNode(parameters_file=guess)
    run = play(PlantNode(rate=1000, parameters=rig, profile=load_profile("engagement")), controller)
    assert controller.watch_faults().count == 0
    assert run.judge_following().regime_error < 0.5  # Nm of 16: 0.40 measured with a guess that is 0.1 bar too low
