"""Other clutch: runs that are of different clutches, which no calibration fits.

Equation        M = a_M (p - p_contact) at the faster half of the slips, of each run by itself (Table 6.3)
What            the torques of two such lines at one pressure, 1.4 times the contact pressure: there they are sure, as it is
                within the pressures of most runs. Slope and contact pressure alone are not, as a steeper line begins at a
                higher pressure. Runs are compared whose slips are alike: at 26 rad/s a clutch may carry 1.4 times as much as
                at 2 rad/s
Assumptions     temperature, and a slip within a factor of two, change the torque of one clutch by less than a fifth there
Not modelled    clutches that are nearer to each other; runs in which the torque does not rise with the pressure are not judged
"""

from collections.abc import Mapping
from itertools import permutations
from typing import NamedTuple

import numpy as np

from clutch_hil.fitting.model import Columns
from clutch_hil.identify.clutch_effects import estimate_line
from clutch_hil.identify.stepwise import take_samples
from clutch_hil.recordings.checks.finding import Finding
from protocols.errors import name_run

_PRESSURE = 1.4  # of the mean contact pressure
_SLIPS = 2.0  # ratio of two slips up to which they are alike
# Ratio of torques. Of 48 clutches within 30 and 40 %, with offsets and drag, up to five experiments each had at most 1.106;
# of 496 pairs of clutches within 30 % 74 % have more than 1.3
_RATIO = 1.3


class _Line(NamedTuple):
    """Slope [Nm/bar] and contact pressure [bar] of a run at its `slip` [rad/s]."""

    slope: float
    contact: float
    slip: float


def find_other_clutch(runs: Mapping[str, Columns]) -> list[Finding]:
    """A hard finding of the run whose torque is highest beside that of another run of like slip, where they differ too much."""
    lines = {name: line for name, run in runs.items() if (line := _estimate(run))}
    alike = [
        pair for pair in permutations(lines, 2) if max(slips := [lines[n].slip for n in pair]) <= _SLIPS * min(slips)
    ]
    compared = [(low, high, *_compare(lines[low], lines[high])) for low, high in alike]
    differing = [one for one in compared if one[-1] > _RATIO * one[-2]]
    if not differing:
        return []
    low, high, pressure, less, more = max(differing, key=lambda one: one[-1] - _RATIO * one[-2])
    text = (
        f"is {more:.3g} Nm at {pressure:.3g} bar, where that of {name_run(low)} is {less:.3g} Nm: they are of different"
        " clutches, or a sensor was changed in between; give runs of one clutch"
    )
    return [Finding("other_clutch", "clutch_torque_nm", (0, len(runs[high]["time_s"]) - 1), text, True, high)]


def _estimate(run: Columns) -> _Line | None:
    line = estimate_line([run])
    if line is None:
        return None
    samples = take_samples([run])
    return _Line(*line, float(np.median(np.abs(samples.slip[samples.faster]))))


def _compare(one: _Line, other: _Line) -> tuple[float, float, float]:
    """A pressure [bar], and the torques [Nm] of two lines there."""
    pressure = _PRESSURE * 0.5 * (one.contact + other.contact)
    first, second = (line.slope * max(pressure - line.contact, 0.0) for line in (one, other))
    return pressure, first, second
