"""Ties: a parameter keeps its declared ratio to another one, also where the fit has a parameter in other units."""

import pytest

from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.identify.clutch_parameters import from_fit, tie, to_fit
from clutch_hil.identify.fit_plan import Subject, Wishes, plan_fit
from plant_sim.rigs import wet_clutch

KNOWN = wet_clutch.load_nominal()
DECLARED = {name: p.value for name, p in KNOWN.items()}
PAIRS = [
    ("clutch.viscous_slope", "clutch.coulomb_slope"),
    ("clutch.coulomb_intercept", "clutch.viscous_intercept"),
    ("clutch.viscous_slope", "clutch.viscous_intercept"),
    ("clutch.viscous_exponent", "clutch.beta_inf"),
    ("valve.gain", "valve.damping"),
]


@pytest.mark.parametrize(("tied", "other"), PAIRS)
def test_the_rig_of_a_fit_has_the_declared_ratio_wherever_the_fit_ends(tied: str, other: str) -> None:
    """C_v is fitted as a torque, which is 10^gamma times as large."""
    ties = plan_fit(Subject("wet_clutch", KNOWN, WetClutch), WetClutch(KNOWN), Wishes(ties={tied: other})).ratios
    start = to_fit(tie(DECLARED, ties))
    assert from_fit(start, ties) == pytest.approx(DECLARED)
    moved = from_fit({**start, other: 1.3 * start[other]}, ties)
    assert moved[tied] / moved[other] == pytest.approx(DECLARED[tied] / DECLARED[other])
