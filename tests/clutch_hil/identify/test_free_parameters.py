"""Steps with which the parameters of a clutch are fitted: those of a smaller clutch are smaller."""

import pytest

from clutch_hil.identify.free_parameters import as_fitted, choose_hardly_excited, free_parameter
from plant_sim.rigs import wet_clutch

KNOWN = wet_clutch.load_nominal()
DECLARED = {name: p.value for name, p in KNOWN.items()}
LINES = ("clutch.coulomb_slope", "clutch.coulomb_intercept", "clutch.viscous_slope", "clutch.viscous_intercept")


@pytest.mark.parametrize(("ratio", "size"), [(0.1, 0.1), (0.3, 0.3), (1.0, 1.0), (8.0, 1.0), (0.0, 0.01)])
@pytest.mark.parametrize("name", LINES)
def test_the_lines_of_a_smaller_clutch_have_smaller_steps(name: str, ratio: float, size: float) -> None:
    own = free_parameter(KNOWN, name, None)
    usual, fitted = (
        as_fitted(own, {**DECLARED, name: value}, DECLARED) for value in (DECLARED[name], ratio * DECLARED[name])
    )
    assert fitted.step == pytest.approx(size * usual.step)
    assert fitted.scale == pytest.approx(size * usual.scale)
    assert (fitted.low, fitted.high) == (usual.low, usual.high)


def test_other_parameters_and_a_line_declared_as_0_keep_their_steps() -> None:
    contact = free_parameter(KNOWN, "piston.contact_pressure", None)
    assert as_fitted(contact, {**DECLARED, contact.name: 0.5}, DECLARED) == contact
    slope = free_parameter(KNOWN, LINES[0], None)
    assert as_fitted(slope, {**DECLARED, LINES[0]: 1.0}, {**DECLARED, LINES[0]: 0.0}) == slope


WEAK = ("oil.heat_capacity", "oil.sump_temperature", "motor.inertia", "clutch.stribeck_speed")
HARDLY = [free_parameter(KNOWN, name, None) for name in WEAK]
ESTIMATED = {**DECLARED, "oil.heat_capacity": 39e3, "oil.sump_temperature": 71.0, "clutch.stribeck_speed": 3.0}


@pytest.mark.parametrize("size", [0.6, 1.0, 1.9])
def test_what_the_runs_hardly_excite_is_as_declared_on_a_clutch_of_the_declared_size(size: float) -> None:
    start = {**ESTIMATED, LINES[0]: size * DECLARED[LINES[0]]}
    assert choose_hardly_excited(HARDLY, start, DECLARED) == {f.name: DECLARED[f.name] for f in HARDLY}


@pytest.mark.parametrize("size", [0.1, 7.0])
def test_on_a_clutch_of_another_size_oil_and_motor_are_as_estimated_or_in_proportion(size: float) -> None:
    """Its oil with 600 J/K would be too hot, and no other parameter would be found."""
    start = {**ESTIMATED, LINES[0]: size * DECLARED[LINES[0]]}
    assert choose_hardly_excited(HARDLY, start, DECLARED) == {
        "oil.heat_capacity": 39e3,
        "oil.sump_temperature": 71.0,
        "motor.inertia": pytest.approx(size * DECLARED["motor.inertia"]),
        "clutch.stribeck_speed": DECLARED["clutch.stribeck_speed"],
    }
    cold = choose_hardly_excited(HARDLY, {**start, "oil.sump_temperature": DECLARED["oil.sump_temperature"]}, DECLARED)
    assert cold["oil.sump_temperature"] == DECLARED["oil.sump_temperature"], "a temperature has no size"
    small = choose_hardly_excited(HARDLY, {**start, LINES[0]: 1e-6}, DECLARED)
    assert small["motor.inertia"] == KNOWN["motor.inertia"].bounds[0]
