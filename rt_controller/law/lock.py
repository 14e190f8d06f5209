"""Lock: the capacity that is asked for to close the clutch totally, above what it carries.

Equation        plates that slide: the capacity rises at `rate`; plates that stick: it is at least
                max((1 + margin) |M|, |M| + least), and goes down to that with `time_constant` once it is more than `margin`
                above it: noise of the torque does not move the valve
Assumptions     the friction level is right within the margin; where it is not, the plates slide, and the capacity rises
Not modelled    heat while the plates still slide: the supervisor's business
References      Janssens 2010, sec. 6.2.1: the clutch totally closed. The rule is ours
"""

from numba import njit

from rt_controller.law.estimator import coulomb_torque
from rt_controller.law.record import floats

# Names and units as in `controller.toml`, SI
LOCK_SETTINGS = floats("margin", "least", "rate", "time_constant", "pressure_limit")


@njit
def hold(capacity, settings, model, level, present, carried, moving, step):
    """Capacity to be asked for [Nm], from the one before, `held`; 0 begins with the one there is, `there`.

    `carried` [Nm]: torque of the clutch, a magnitude; `moving`: whether the plates slide; `step` [s].
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
    """Torque [Nm] that a locked clutch carries with the margin at its highest pressure: all that the motor may give."""
    return level * coulomb_torque(model, settings.pressure_limit) / (1.0 + settings.margin)
