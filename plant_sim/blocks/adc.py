"""Converter of the data acquisition: voltage to counts.

Equation        counts = clip(round(V / (2 V_range) 2^n), -2^(n-1), 2^(n-1) - 1)                        (docs/rig.md, eq. 9)
Assumptions     ideal converter, two's complement; a converter with fewer bits than its frame field is left-justified
Valid range     4..16 bit
Not modelled    non-linearity; anti-alias filter, sampling instant, channel skew, fewer bits are effects (plant_sim/effects)
References      dSPACE 1103 of Janssens 2010, sec. 3.9.4: +-10 V, 16 bit on torque channels, 12 bit on the others
"""

from math import floor

from numba.extending import register_jitable


@register_jitable(inline="always")
def counts(voltage, input_range, bits, field_bits):
    """Return the counts of `voltage` [V] for a converter of +-`input_range` [V] and `bits`, left-justified in `field_bits`."""
    half = 1 << (bits - 1)
    code = floor(min(max(voltage / input_range, -2.0), 2.0) * half + 0.5)
    return min(max(int(code), -half), half - 1) << (field_bits - bits)
