"""Incremental encoder: angle to counts.

Equation        counts = floor(theta N / 2 pi), kept in 32 bits                                          (rig.md, 9)
Assumptions     every edge is counted, at any speed; the counter wraps in two's complement
Valid range     any angle
Not modelled    index pulse, unequal lines, eccentricity
References      Janssens 2010, sec. 3.9.1: 163840 counts a revolution after interpolation
"""

from math import floor, pi

from numba import njit


@njit(inline="always")
def counts(angle, per_revolution):
    """Counter value, -2^31..2^31 - 1, at `angle` [rad]; `per_revolution` N [counts/rev]."""
    return (floor(angle * (per_revolution / (2.0 * pi))) + 0x80000000 & 0xFFFFFFFF) - 0x80000000
