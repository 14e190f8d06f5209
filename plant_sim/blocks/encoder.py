"""Incremental encoder: angle to counts.

Equation        edges = floor(theta N / 2 pi);  counts = floor(edges 163840 / N), kept in the frame's bits  (docs/rig.md, eq. 9)
Assumptions     every edge is counted, at any speed; the counter wraps in two's complement
Valid range     any angle
Not modelled    index pulse, unequal lines, eccentricity
References      Janssens 2010, sec. 3.9.1: 163840 counts a revolution after interpolation
"""

from math import floor, pi

from numba.extending import register_jitable

FIELD_COUNTS = 163840.0  # counts/rev of ENCODER.SHAFT_ANGLE; an encoder with fewer lines steps by several


@register_jitable(inline="always")
def counts(angle, per_revolution, field_bits):
    """Return the counter value at `angle` [rad] in a signed field of `field_bits`.

    `per_revolution` N [counts/rev] of the encoder.
    """
    edges, half = floor(angle * (per_revolution / (2.0 * pi))), 1 << (field_bits - 1)
    return (floor(edges * (FIELD_COUNTS / per_revolution)) + half & 2 * half - 1) - half
