"""Blind: draw a plant with one randomly chosen effect of the catalogue, strong enough to be visible, for exercises and tests.

Method          draw the baseline parameters within a share of their uncertainty, one effect, and its strengths around their
                typical values; increase the strengths until the standard experiments show a gap
"""

from functools import cache

import numpy as np

from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.models.wet_clutch_experiments import FLOORS, STANDARD, WetClutchBench
from clutch_hil.discrepancy.visibility import Visibility
from clutch_hil.fitting.model import Candidate
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet

GAP = 2.0  # floors: least gap, in the output that shows it best
_JITTER = 0.15  # standard deviation of a baseline parameter as a share of its stated uncertainty: as in the battery
_SPREAD = 0.8, 1.6  # range of the strengths as multiples of the typical ones
_RAISE = 1.5
_MOST = 12  # largest number of increases: a factor of 130 in total; an effect still not visible is unsuitable for an exercise
# Candidates since 2026-11-30: with them, a seed would draw another plant than before
_NOT_DRAWN = (
    "anti_alias_filter", "motor_torque_sensor_gain", "motor_torque_sensor_lag", "motor_torque_sensor_offset",
)  # fmt: skip
# These strengths stay off. A drift and a wrong level count as two effects, and one is drawn. The drift of the valve's gain
# and the damping are of 2026-11-30: with them, a seed would draw another plant than before
_KEPT = ("friction_level.drift", "valve_gain.drift", "slower_valve.damping")


def draw_plant(seed: int) -> ParameterSet:
    """Return the plant parameters that `seed` draws. Raises InputError when no effect is visible."""
    model = WetClutch()
    candidates = [candidate for candidate in model.candidates if candidate.name not in _NOT_DRAWN]
    random = np.random.default_rng(seed)
    for i in random.permutation(len(candidates)):
        candidate = candidates[i]
        if (values := _draw_visible(candidate, random)) is not None:
            baseline = {
                name: float(np.clip(p.value + _JITTER * p.uncertainty * random.standard_normal(), *p.bounds))
                for name, p in model.parameters.items()
                if p.uncertainty > 0.0
            }
            return wet_clutch.load_nominal().with_values(baseline | values)
    raise InputError("no effect of the catalogue can be seen in the standard experiments")


@cache
def measure_standard() -> Visibility:
    """Return the visibility of effects in the standard experiments. It takes one or two seconds to compute."""
    return Visibility(WetClutch(), WetClutchBench(), STANDARD.values(), FLOORS)


def _draw_visible(candidate: Candidate, random: np.random.Generator) -> dict[str, float] | None:
    """Return values of a candidate by dotted name that show a GAP; None where no values within its bounds do."""
    typical, bounds = (
        candidate.list_typical_values(),
        {f"{candidate.name}.{p.name}": p.bounds for p in candidate.parameters},
    )
    strengths = {
        name: off for name, off in candidate.list_off_values().items() if typical[name] != off and name not in _KEPT
    }
    times = {name: random.uniform(*_SPREAD) for name in strengths}
    for k in range(_MOST):
        values = dict(typical) | {n: off for n, off in candidate.list_off_values().items() if n in _KEPT}
        for name, off in strengths.items():
            raised = off + times[name] * _RAISE**k * (typical[name] - off)
            values[name] = float(np.clip(raised, *bounds[name]))
        if candidate.list_at_bounds(values):
            return None  # such as a pressure channel that saturates at 0.1 V: the controller ends the run in a fault
        gap = max(measure_standard().compute_gaps(values).values())
        if gap >= GAP:
            return values
    return None
