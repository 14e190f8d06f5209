"""Converter of the valve's output: counts to voltage.

Equation        V = counts V_range / 2^n, counts 0..2^n - 1, held until the next command                 (rig.md, 9)
Assumptions     ideal converter, no settling; a converter with fewer bits than the frame's field drops the lowest
Valid range     4..16 bit
Not modelled    settling, glitches, offset and gain error
References      dSPACE 1103 of Janssens 2010, sec. 3.9.4; rig.md: 16 bit, 0..10 V
"""

FIELD_BITS = 16  # of VALVE_COMMAND.VALVE_VOLTAGE


def voltage(counts: int, output_range: float, bits: int) -> float:
    """Voltage [V] of a converter of 0..`output_range` [V] and `bits` for the `counts` of a command."""
    dropped = FIELD_BITS - bits
    return (counts >> dropped << dropped) * output_range / (1 << FIELD_BITS)
