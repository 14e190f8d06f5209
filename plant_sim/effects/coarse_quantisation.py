"""Coarse quantisation of the pressure and the clutch-torque channel.

What            a converter has fewer effective bits than it is sold with: its lowest ones are not connected or say nothing
Equation        V_shown = step round(V / step), step = 2 V_range 2^lost / 2^bits, after the noise
Assumptions     the error is that of a coarser ideal converter
Valid range     bits lost 0..8 of 12 and 0..12 of 16; fractions are allowed, as for any effective number of bits
Not modelled    the noise that takes effective bits away in a real converter: raise sensors...._noise for that
References      Bennett 1948: Spectra of quantized signals, Bell System Technical Journal 27 (error uniform, step^2/12)
"""

from math import floor

from numba import njit

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import ACQUISITION


@njit(inline="always")
def rounded(voltage, input_range, bits):
    """`voltage` [V] to the nearest level of a converter of +-`input_range` [V] and `bits`."""
    step = 2.0 * input_range / 2.0**bits
    return step * floor(voltage / step + 0.5)


def coarsen(s, c, p, x, h):
    """Round both channels."""
    full = c.sensors_input_range
    s.pressure_voltage = rounded(s.pressure_voltage, full, c.sensors_pressure_bits - p.pressure_bits_lost)
    s.clutch_torque_voltage = rounded(s.clutch_torque_voltage, full, c.sensors_clutch_torque_bits - p.torque_bits_lost)


EFFECT = Effect(
    block="sensors",
    laws={ACQUISITION: coarsen},
    rank=20,
    parameters=(
        Strength(
            "pressure_bits_lost", "bit", off=0.0, typical=4.0, bounds=(0.0, 8.0),
            source="[D] 8 of 12 bits: 78 mbar a step",
        ),
        Strength(
            "torque_bits_lost", "bit", off=0.0, typical=8.0, bounds=(0.0, 12.0),
            source="[D] 8 of 16 bits: 0.39 Nm a step",
        ),
    ),
)  # fmt: skip
