"""Slip speed and acceleration from encoder angles: critically damped fading-memory filter of second order.

Equation        predict  x += v T + a T^2/2, v += a T;   r = z - x
                correct  x += (1 - q^3) r,  v += 3/2 (1 - q)^2 (1 + q) r/T,  a += (1 - q)^3 r/T^2;   q = exp(-w T)
Assumptions     jerk is small over 1/w
Valid range     any T: all three poles are at q, inside the unit circle
References      Morrison 1969, Introduction to Sequential Smoothing and Prediction, sec. 13 (fading-memory polynomial filter)
"""

from math import exp

from numba import njit


@njit
def observe(state, angle, step, bandwidth):
    """Return the next (angle [rad], speed [rad/s], acceleration [rad/s^2]).

    `state` is that of the step before, `angle` [rad] the measured one, `step` [s] > 0.
    """
    x, v, a = state
    x += (v + 0.5 * a * step) * step
    v += a * step
    q = exp(-bandwidth * step)
    residual = angle - x
    p = 1.0 - q
    return (
        x + (1.0 - q * q * q) * residual,
        v + 1.5 * p * p * (1.0 + q) * residual / step,
        a + p * p * p * residual / (step * step),
    )
