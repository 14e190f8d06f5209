"""Trim: fast correction of the adapted friction level.

Equation        level = (sum w x y + floor^2 l) / (sum w x^2 + floor^2),  w = exp(-age/window)/window
                x: torque of the model at level 1; y: observed torque minus viscous correction, behind the same lag; l:
                adapted level. This is least squares through the origin with forgetting, and with l as prior
Assumptions     the error is proportional to the torque; below the torque `floor` the prior has more weight than the data
Not modelled    lasting errors: the adaptation learns them (adaptation.py), slowly, by oil temperature, in clear cases only. The
                trim corrects them until then, also in creep and after the first contact, and forgets
References      developed here
"""

from numba import njit

from rt_controller.law.record import make_float_type

# Names and units as in `controller.toml`, SI
TRIM_SETTINGS = make_float_type("window", "floor")
TRIM = make_float_type("xx", "xy")  # xx, xy: moments [Nm^2]


@njit
def trim(state, settings, model, observed, step):
    """Update the moments with the torque of the `model` at level 1 and the `observed` one [Nm], after `step` [s]."""
    fresh = min(step / settings.window, 1.0)
    state.xx += fresh * (model * model - state.xx)
    state.xy += fresh * (model * observed - state.xy)


@njit
def compute_level(state, settings, level, low, high):
    """Return the trimmed level [-], limited to `low`..`high`; `level` is the adapted level."""
    prior_weight = settings.floor * settings.floor
    return min(max((state.xy + prior_weight * level) / (state.xx + prior_weight), low), high)


@njit
def lower(state, settings, level, share):
    """Lower the trimmed level to at most `share` [-], at which the plates broke away; `level` is the adapted level."""
    prior_weight = settings.floor * settings.floor
    state.xy = min(state.xy, share * (state.xx + prior_weight) - prior_weight * level)


@njit
def raise_to(state, settings, level, share):
    """Raise the trimmed level to at least `share` [-], which plates at rest carry; `level` is the adapted level."""
    prior_weight = settings.floor * settings.floor
    state.xy = max(state.xy, share * (state.xx + prior_weight) - prior_weight * level)


@njit
def forget(state):
    """Reset the moments, so that the trimmed level equals the adapted level."""
    state.xx = state.xy = 0.0
