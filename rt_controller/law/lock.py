"""Lock: torque capacity with which the clutch is totally closed, above the torque that it carries.

Equation        plates that slide: the capacity rises at `rate`. Plates that stick: it is at least
                max((1 + margin) |M|, |M| + least); when it exceeds this by more than `margin`, it decays to it with
                `time_constant`. So noise of the torque does not move the valve
Assumptions     the friction level is correct within the margin; otherwise the plates slide, and the capacity rises
Not modelled    heat while the plates still slide: the supervisor must limit it
References      Janssens 2010, sec. 6.2.1: the clutch totally closed. The rule is of this project
"""

from numba import njit

from rt_controller.law.estimator import coulomb_torque
from rt_controller.law.record import make_float_type

# Names and units as in `controller.toml`, SI
LOCK_SETTINGS = make_float_type("margin", "least", "rate", "time_constant", "pressure_limit")


@njit
def hold(capacity, settings, model, level, present, carried, moving, step):
    """Return the demanded capacity [Nm] after `step` [s].

    `capacity` [Nm] is that of the step before; with 0 the lock begins at the `present` capacity [Nm]. `level` [-] of friction;
    `carried` [Nm]: magnitude of the clutch torque; `moving`: the plates slide.
    """
    if capacity <= 0.0:
        capacity = present
    required = max((1.0 + settings.margin) * carried, carried + settings.least)
    rise = settings.rate * step
    if moving:
        capacity += rise
    elif required > capacity:
        capacity = min(required, capacity + rise)
    elif capacity > (1.0 + settings.margin) * required:
        capacity += (required - capacity) * min(step / settings.time_constant, 1.0)
    return min(capacity, level * coulomb_torque(model, settings.pressure_limit))


@njit
def motor_limit(settings, model, level):
    """Return the highest motor torque [Nm] that a locked clutch carries with the margin at its highest pressure."""
    return level * coulomb_torque(model, settings.pressure_limit) / (1.0 + settings.margin)
