"""Effects of valve, hydraulics and piston: the longest step is short enough at every end of their ranges."""

from math import exp

import numpy as np
import pytest

from plant_sim.effects.catalogue import find_effect, load_effects
from plant_sim.effects.table import sum_added_rates
from plant_sim.rigs import wet_clutch
from tests.plant_sim.effects.fluid import BAR, SUPPLY, make_rig, run

HALVED = 5e-3  # bar, an ADC step, from a step of half the length; measured 2.1 mbar, an unstable rig differs by bars
OVERSHOOT = 1.01  # of the supply pressure: a valve of damping 0.9 overshoots by 0.2 %
HARD = [(1.36, 200), (10.0, 60), (0.0, 200), (2.0, 60)]  # fill, everything, drain on to the rest, fill again
WET = [name for name, one in load_effects().items() if one.block in ("valve", "hydraulics", "piston")]


def list_corners(name: str) -> list[dict[str, float]]:
    """Each parameter of an effect at each bound, the others typical."""
    one = find_effect(name)
    return [one.list_typical_values() | {f"{name}.{p.name}": bound} for p in one.parameters for bound in p.bounds]


@pytest.mark.parametrize("name", WET)
def test_rig_stays_stable_at_every_bound(name: str) -> None:
    for values in list_corners(name):
        extreme = make_rig(**{key.replace(".", "__"): value for key, value in values.items()})
        for celsius in (40.0, 150.0) if name == "oil_viscosity" else (70.0,):
            records = run(extreme, HARD, celsius=celsius)
            finer = run(extreme, HARD, celsius=celsius, substeps=20)
            assert records["pressure"] / BAR == pytest.approx(finer["pressure"] / BAR, abs=HALVED), values
            assert records["valve_pressure"].max() <= OVERSHOOT * SUPPLY * BAR, values
            assert records["pressure"].min() >= 0.0
            assert np.isfinite(records["clutch_torque"]).all()


@pytest.mark.parametrize(("share", "thinner"), [(0.0, 1.0), (1.0, exp(765.0 * (1 / 173.0 - 1 / 253.0)))])
def test_a_leak_adds_the_rate_at_which_it_empties_the_cylinder_with_the_thinnest_oil(
    share: float, thinner: float
) -> None:
    leaking = wet_clutch.load_nominal().with_values(
        {"internal_leakage.conductance": 1e-4, "internal_leakage.share": share}
    )  # m^3/(s bar), of 1e-6 m^3/bar; Vogel's law from 70 to 150 degC
    assert sum_added_rates(leaking, wet_clutch.list_values(leaking)) == pytest.approx(100.0 * thinner)  # 1/s
