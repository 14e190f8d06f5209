"""Steps with which the parameters of a clutch are fitted: those of a smaller clutch are smaller."""

import pytest

from clutch_hil.identify.free_parameters import as_fitted, free_parameter
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
