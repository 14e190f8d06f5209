"""How well a torque follows its demand, as section 6.5 of Janssens 2010 measures it.

Rise time       from the first demand until the torque reaches 90 % of the demand. Only samples count in which the demand has
                completed 90 % of its own first rise: during the rise, the small demand would be reached too early
Regime          from the end of the rise time until the demand ends
Regime error    mean absolute error in the regime
"""

from typing import NamedTuple

import numpy as np

REACHED_SHARE = 0.9  # Janssens 2010, sec. 6.5
_PLATEAU_TIME = 0.02  # s without a rise, after which the first rise of the demand has ended


class Following(NamedTuple):
    """Regime error [Nm] and rise time [s]; both are NaN if 90 % was never reached."""

    regime_error: float
    rise_time: float


def judge_following(time: np.ndarray, demand: np.ndarray, torque: np.ndarray) -> Following:
    """Judge `torque` against `demand` [Nm], both magnitudes of shape (samples,) over `time` [s]."""
    part = find_regime(time, demand, torque)
    if not (demand[part] > 0.0).any():
        return Following(float("nan"), float("nan"))
    error = float(np.mean(np.abs(torque[part] - demand[part])))
    first = int(np.argmax(demand > 0.0))
    return Following(error, float(time[part.start] - time[first]))


def find_regime(time: np.ndarray, demand: np.ndarray, torque: np.ndarray) -> slice:
    """Return the samples of the regime; empty if 90 % was never reached. The arguments are those of `judge_following`."""
    demanded = np.flatnonzero(demand > 0.0)
    if not len(demanded):
        return slice(0, 0)
    first, end = demanded[0], demanded[-1] + 1
    level = _find_first_level(time[first:end], demand[first:end])
    reached = np.flatnonzero(
        (demand[first:end] >= REACHED_SHARE * level) & (torque[first:end] >= REACHED_SHARE * demand[first:end])
    )
    return slice(int(first + reached[0]), int(end)) if len(reached) else slice(0, 0)


def _find_first_level(time: np.ndarray, demand: np.ndarray) -> float:
    """Return the highest demand before it first stops rising."""
    highest = np.maximum.accumulate(demand)
    rises = np.flatnonzero(np.diff(highest, prepend=-1.0) > 0.0)
    pauses = np.flatnonzero(np.diff(time[rises], append=np.inf) > _PLATEAU_TIME)
    return float(demand[rises[pauses[0]]])
