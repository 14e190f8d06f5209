"""Trim: by which share the torque observed at the motor exceeds the model's, over the last tenth of a second.

Equation        share = sum w x (y - x) / (sum w x^2 + floor^2), x and y the torque of the model and the observed one, behind
                one lag; w = exp(-age/window)/window: least squares through the origin with forgetting
Assumptions     what is off is off in proportion to the torque; `floor`: what the torque must exceed to be worth a share
Not modelled    what lasts is the adaptation's (adaptation.py): it learns slowly, by oil temperature, and only in clear cases; this
                bridges the time until it has, in creep and after a touch, too, and forgets
References      ours
"""

import numpy as np
from numba import njit

from rt_controller.record import floats

# Names and units as in `controller.toml`, SI
TRIM_SETTINGS = floats("window", "floor", "slew_limit", "calm_time")
# Moments [Nm^2]; share [-]; speed demand of the step before [rad/s], and time [s] for which it has changed slowly
TRIM = np.dtype([("xx", "f8"), ("xy", "f8"), ("share", "f8"), ("calm", "f8"), ("speed_demand", "f8")])


@njit
def trim(state, settings, model, mismatch, speed_demand, sees, low, high, step):
    """Move TRIM on by `step` [s]; `model` and `mismatch` [Nm] behind one lag, the share stays within `low`..`high`.

    `sees`: whether the two say anything of the friction. While the motor's `speed_demand` [rad/s] changes faster than `slew_limit`,
    and `calm_time` after it, its torque jumps with every new demand, by more between two samples than what is looked for.
    """
    calm = abs(speed_demand - state.speed_demand) <= settings.slew_limit * step
    if step > 0.0:
        state.speed_demand = speed_demand
    state.calm = state.calm + step if calm else 0.0
    if sees and state.calm >= settings.calm_time:
        fresh = min(step / settings.window, 1.0)
        state.xx += fresh * (model * model - state.xx)
        state.xy += fresh * (model * mismatch - state.xy)
        state.share = state.xy / (state.xx + settings.floor * settings.floor)
    state.share = min(max(state.share, low), high)


@njit
def forget(state):
    """Begin anew."""
    state.xx = state.xy = state.share = 0.0
