"""Other clutch: find runs of different clutches, which no calibration fits.

Equation        M = a_M (p - p_contact) at the faster half of the slips, of each run by itself (Table 6.3)
What            compares the torques of two such lines at one pressure, 1.4 times the mean contact pressure: this is within the
                pressures of most runs, so the torques are well known there. Slope and contact pressure are not, because their
                errors are correlated: a steeper line begins at a higher pressure. Only runs with similar slips are compared: at
                26 rad/s a clutch may transmit 1.4 times as much as at 2 rad/s
Assumptions     temperature, and a slip within a factor of two, change the torque of one clutch by less than a fifth there
Not modelled    clutches that differ less; runs in which the torque does not rise with the pressure are not compared
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

_PRESSURE = 1.4  # ratio to the mean contact pressure
_SLIPS = 2.0  # largest ratio of similar slips
# Ratio of torques. For 48 clutches within 30 and 40 %, with offsets and drag, it was at most 1.106 between up to five
# experiments each; of 496 pairs of clutches within 30 %, 74 % have more than 1.3
_RATIO = 1.3


class _Line(NamedTuple):
    """Slope [Nm/bar] and contact pressure [bar] of a run at its `slip` [rad/s]."""

    slope: float
    contact: float
    slip: float


def find_other_clutch(runs: Mapping[str, Columns]) -> list[Finding]:
    """Return a hard finding for the pair of runs with similar slips whose torques differ most, if by more than _RATIO."""
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
        f"is {more:.3g} Nm at {pressure:.3g} bar, but that of {name_run(low)} is {less:.3g} Nm: the runs are of different"
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
    """Return a pressure [bar], and the torques [Nm] of two lines at it."""
    pressure = _PRESSURE * 0.5 * (one.contact + other.contact)
    first, second = (line.slope * max(pressure - line.contact, 0.0) for line in (one, other))
    return pressure, first, second
