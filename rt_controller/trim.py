"""Trim: by which share the torque observed at the motor exceeds the model's, over the last tenth of a second.

Equation        share = sum w x (y - x) / (sum w x^2 + floor^2), x and y the torque of the model and the observed one, behind
                one lag; w = exp(-age/window)/window: least squares through the origin with forgetting
Assumptions     what is off is off in proportion to the torque; `floor`: what the torque must exceed to be worth a share
Not modelled    what lasts is the adaptation's (adaptation.py): it learns slowly, by oil temperature, and only in clear cases; this
                bridges the time until it has, in creep and after a touch, too, and forgets
References      ours
"""

from numba import njit

from rt_controller.record import floats

# Names and units as in `controller.toml`, SI
TRIM_SETTINGS = floats("window", "floor")
# Moments [Nm^2]; share [-]
TRIM = floats("xx", "xy", "share")


@njit
def trim(state, settings, model, mismatch, low, high, step):
    """Move TRIM on by `step` [s]; `model` and `mismatch` [Nm] behind one lag, the share stays within `low`..`high`."""
    fresh = min(step / settings.window, 1.0)
    state.xx += fresh * (model * model - state.xx)
    state.xy += fresh * (model * mismatch - state.xy)
    state.share = min(max(state.xy / (state.xx + settings.floor * settings.floor), low), high)


@njit
def forget(state):
    """Begin anew."""
    state.xx = state.xy = state.share = 0.0
