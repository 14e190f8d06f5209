"""Incremental encoder: angle to counts.

Equation        edges = floor(theta N / 2 pi);  counts = floor(edges 163840 / N), kept in 32 bits        (docs/rig.md, eq. 9)
Assumptions     every edge is counted, at any speed; the counter wraps in two's complement
Valid range     any angle
Not modelled    index pulse, unequal lines, eccentricity
References      Janssens 2010, sec. 3.9.1: 163840 counts a revolution after interpolation
"""

from math import floor, pi

from numba.extending import register_jitable

FIELD_COUNTS = 163840.0  # counts/rev of ENCODER.SHAFT_ANGLE; an encoder with fewer lines steps by several


@register_jitable(inline="always")
def counts(angle, per_revolution):
    """Counter value of the frame, -2^31..2^31 - 1, at `angle` [rad]; `per_revolution` N [counts/rev] of the encoder."""
    edges = floor(angle * (per_revolution / (2.0 * pi)))
    return (floor(edges * (FIELD_COUNTS / per_revolution)) + 0x80000000 & 0xFFFFFFFF) - 0x80000000
