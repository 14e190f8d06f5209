"""Lag: the low-pass that the slip observer puts on its acceleration, for signals that are compared with it.

Equation        three first-order lags in a row, H = ((1 - q) / (1 - q z^-1))^3, q = exp(-w T);
                observe() gives the acceleration as H applied to the second difference of the angle, which is
                centred on the sample before; with M_m of that sample, H M_m - J alpha = H (M_m - J domega/dt) = H M
                to second order in T, also while the torque changes fast
Valid range     any T
References      regressor filtering: Slotine and Li 1991, Applied Nonlinear Control, sec. 8.7; filter of slip.py
"""

Lag = tuple[float, float, float]
AT_REST: Lag = (0.0, 0.0, 0.0)


def lagged(state: Lag, value: float, q: float) -> Lag:
    """State after `value`; its last entry is the output, in the unit of `value`. `q` [-] within 0..1."""
    a, b, c = state
    a = value + q * (a - value)
    b = a + q * (b - a)
    return a, b, b + q * (c - b)
