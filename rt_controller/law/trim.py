"""Trim: the friction level of the moment, around the adapted one.

Equation        level = (sum w x y + floor^2 l) / (sum w x^2 + floor^2),  w = exp(-age/window)/window
                x the torque of the model at level 1, y the observed one less the viscous correction, behind one lag; l the
                adapted level: least squares through the origin with forgetting, and with l as what is known before
Assumptions     what is off is off in proportion to the torque; `floor`: what the torque must exceed to say more than l does
Not modelled    what lasts: the adaptation learns it (adaptation.py), slowly, by oil temperature, in clear cases alone. This
                bridges the time until it has, in creep and after a touch, too, and forgets
References      ours
"""

from numba import njit

from rt_controller.law.record import floats

# Names and units as in `controller.toml`, SI
TRIM_SETTINGS = floats("window", "floor")
TRIM = floats("xx", "xy")  # moments [Nm^2]


@njit
def trim(state, settings, model, observed, step):
    """Take the torque of the `model` at level 1 and the `observed` one [Nm], behind one lag, `step` [s] after the last."""
    fresh = min(step / settings.window, 1.0)
    state.xx += fresh * (model * model - state.xx)
    state.xy += fresh * (model * observed - state.xy)


@njit
def compute_level(state, settings, level, low, high):
    """Level of the moment [-] within `low`..`high`; `level` is the adapted one."""
    prior_weight = settings.floor * settings.floor
    return min(max((state.xy + prior_weight * level) / (state.xx + prior_weight), low), high)


@njit
def lower(state, settings, level, share):
    """Plates that break away carry no more: the level of the moment is at most `share` [-]; `level` is the adapted one."""
    prior_weight = settings.floor * settings.floor
    state.xy = min(state.xy, share * (state.xx + prior_weight) - prior_weight * level)


@njit
def raise_to(state, settings, level, share):
    """Plates that rest carry as much: the level of the moment is at least `share` [-]; `level` is the adapted one."""
    prior_weight = settings.floor * settings.floor
    state.xy = max(state.xy, share * (state.xx + prior_weight) - prior_weight * level)


@njit
def forget(state):
    """Begin anew."""
    state.xx = state.xy = 0.0
