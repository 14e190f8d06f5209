"""Converter of the valve's output: counts to voltage.

Equation        V = floor(V_c / V_full 2^n) V_range / 2^n, V_c the commanded voltage, held until the next(docs/rig.md, eq. 9)
Assumptions     ideal converter, no settling; a converter with fewer bits than the frame's field drops the lowest
Valid range     4..16 bit
Not modelled    settling, glitches, offset and gain error
References      dSPACE 1103 of Janssens 2010, sec. 3.9.4: 16 bit, 0..10 V
"""

from math import floor

FULL_SCALE = 10.0  # V, full scale of VALVE_COMMAND.VALVE_VOLTAGE


def quantise_voltage(commanded: float, output_range: float, bits: int) -> float:
    """Return the voltage [V] of a converter of 0..`output_range` [V] and `bits` for a `commanded` voltage.

    The frame has 0..10 V in 16 bits.
    """
    steps = 1 << bits
    return floor(commanded * steps / FULL_SCALE) * output_range / steps
