"""Lag: the low-pass of the slip observer for its acceleration, also applied to signals that are compared with it.

Equation        three first-order lags in a row, H = ((1 - q) / (1 - q z^-1))^3, q = exp(-w T);
                observe() gives the acceleration as H applied to the second difference of the angle, which is
                centred on the sample before; with M_m of that sample, H M_m - J alpha = H (M_m - J domega/dt) = H M
                to second order in T, also while the torque changes fast
Valid range     any T
References      regressor filtering: Slotine and Li 1991, Applied Nonlinear Control, sec. 8.7; filter of slip.py
"""

import numpy as np
from numba import njit

LAG = np.dtype([("first", "f8"), ("second", "f8"), ("out", "f8")])  # in the unit of the signal


@njit
def low_pass(state, value, q):
    """Advance the LAG `state` by the input `value`; return its output in the same unit. `q` [-] is within 0..1."""
    state.first = value + q * (state.first - value)
    state.second = state.first + q * (state.second - state.first)
    state.out = state.second + q * (state.out - state.second)
    return state.out
