"""How well a torque follows its demand, as section 6.5 of Janssens 2010 measures it.

Rise time       from the first demand until the torque first reaches 90 % of the desired trajectory, counted from where
                the trajectory itself has made 90 % of its first rise (on the way up any lag would pass for "reached")
Regime error    mean absolute error from that moment until the demand ends
"""

from typing import NamedTuple

import numpy as np

REACHED = 0.9  # Janssens 2010, sec. 6.5
_PLATEAU = 0.02  # s without a rise end the first rise of the demand


class Following(NamedTuple):
    """Regime error [Nm] and rise time [s]; NaN when 90 % was never reached."""

    regime_error: float
    rise_time: float


def following(time: np.ndarray, demand: np.ndarray, torque: np.ndarray) -> Following:
    """Judge `torque` against `demand` [Nm], both of shape (samples,) over `time` [s]."""
    asked = np.flatnonzero(demand > 0.0)
    if not len(asked):
        return Following(float("nan"), float("nan"))
    first, end = asked[0], asked[-1] + 1
    level = _first_level(time[first:end], demand[first:end])
    reached = np.flatnonzero(
        (demand[first:end] >= REACHED * level) & (torque[first:end] >= REACHED * demand[first:end])
    )
    if not len(reached):
        return Following(float("nan"), float("nan"))
    start = first + reached[0]
    error = float(np.mean(np.abs(torque[start:end] - demand[start:end])))
    return Following(error, float(time[start] - time[first]))


def _first_level(time: np.ndarray, demand: np.ndarray) -> float:
    """The highest demand before it first stops rising."""
    highest = np.maximum.accumulate(demand)
    rises = np.flatnonzero(np.diff(highest, prepend=-1.0) > 0.0)
    pauses = np.flatnonzero(np.diff(time[rises], append=np.inf) > _PLATEAU)
    return float(demand[rises[pauses[0]]])
