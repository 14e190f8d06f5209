"""Friction of the seal rings on the piston, with pre-sliding.

Equation        dF = k_seal dx while |F| < W, else |F| = W;  k_seal = W / x_s   (one Maxwell-slip element, thesis sec. 5.2)
Assumptions     break-away force W independent of pressure and speed
Valid range     W 0..1000 N; off at W = 0
Not modelled    pressure-dependent squeeze of the ring, Stribeck effect of the lip, stick time
References      Janssens 2010, fig 6.11: offered as the first cause of the direction-dependent torque over pressure
"""

from numba import njit


@njit(inline="always")
def force(last_force, displacement, break_away, travel):
    """Seal force on the piston [N], opposing motion, after `displacement` [m]; `break_away` W [N], `travel` x_s [m]."""
    trial = last_force + break_away / travel * displacement
    return min(max(trial, -break_away), break_away)
