"""Blind: a plant with one effect of the catalogue drawn by lot, strong enough to be seen, for an exercise or a test.

What            baseline parameters off by a share of their uncertainty, one effect, its strengths about their typical values
                and then raised until the standard experiments show a gap
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

GAP = 2.0  # floors, on the output that shows it best
_JITTER = 0.15  # standard deviation of a baseline parameter as a share of its stated uncertainty: the battery's
_SPREAD = 0.8, 1.6  # strengths as multiples of the typical ones
_RAISE = 1.5
_MOST = 12  # raises: by a factor of 130; what is not seen then is no plant to practise on
_KEPT = "friction_level.drift"  # a drift is another effect to a tester than a level: both at once are not drawn


def draw_plant(seed: int) -> ParameterSet:
    """The plant's parameters that `seed` draws. Raises InputError when there is no effect that can be seen."""
    model = WetClutch()
    random = np.random.default_rng(seed)
    for i in random.permutation(len(model.candidates)):
        candidate = model.candidates[i]
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
    """What the standard experiments show; to make it takes a second or two."""
    return Visibility(WetClutch(), WetClutchBench(), STANDARD.values(), FLOORS)


def _draw_visible(candidate: Candidate, random: np.random.Generator) -> dict[str, float] | None:
    """Values of a candidate by dotted name that show a GAP; None where none within its bounds do."""
    typical, bounds = (
        candidate.list_typical_values(),
        {f"{candidate.name}.{p.name}": p.bounds for p in candidate.parameters},
    )
    strengths = {
        name: off for name, off in candidate.list_off_values().items() if typical[name] != off and name != _KEPT
    }
    times = {name: random.uniform(*_SPREAD) for name in strengths}
    for k in range(_MOST):
        values = dict(typical) | {n: off for n, off in candidate.list_off_values().items() if n == _KEPT}
        for name, off in strengths.items():
            raised = off + times[name] * _RAISE**k * (typical[name] - off)
            values[name] = float(np.clip(raised, *bounds[name]))
        gap = max(measure_standard().compute_gaps(values).values())
        if gap >= GAP:
            return values
    return None
