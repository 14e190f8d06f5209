"""Feedback: PI on the estimated torque, PI on the measured pressure, both with a frozen integrator.

Equation        p_fb = k_p e + I,  I' = k_i e,  e = M_d - M_sim                                        (fig 6.16)
                u = p_d + k_p (p_d - p) + I,  I' = k_i (p_d - p),  V = u / k_v                          (docs/rig.md)
Assumptions     `frozen` is true in saturation, out of contact and without a new sample
References      Janssens 2010, sec. 6.5, fig 6.16; gains of the pressure loop from docs/rig.md
"""

import numpy as np
from numba import njit

# proportional, integral: terms of the last step; next: integral term of the next step
PI = np.dtype([("proportional", "f8"), ("integral", "f8"), ("next", "f8")])


@njit
def proportional_integral(state, error, step, k_p, k_i, frozen):
    """Advance the PI `state` by `step` [s]; return the sum of its terms, in the unit of `k_p * error`."""
    state.proportional, state.integral = k_p * error, state.next
    if not frozen:
        state.next += k_i * error * step
    return state.proportional + state.integral


@njit
def follow(state, integral):
    """Set the integral term, for the time when the loop closes; the proportional term is 0."""
    state.proportional, state.integral, state.next = 0.0, integral, integral
