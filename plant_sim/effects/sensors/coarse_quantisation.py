"""Coarse quantisation of the pressure and the clutch-torque channel.

What            a converter has fewer effective bits than its data sheet says: the lowest are not connected, or only noise
Equation        V_shown = step (round(V / step - o) + o), step = 2 V_range 2^lost / 2^bits, after the noise
                o = 0: a level at 0 V (mid-tread); o = 0.5: none (mid-rise, as of a converter that truncates)
Assumptions     the error is that of a coarser ideal converter
Valid range     bits lost 0..8 of 12 and 0..12 of 16; fractions are allowed, as for any effective number of bits
Not modelled    the noise to which a real converter loses bits: raise the parameters sensors.*_noise for that
References      Bennett 1948: Spectra of quantized signals, Bell System Technical Journal 27 (error uniform, step^2/12)
"""

from math import floor

from numba import njit

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, Strength
from plant_sim.effects.signals import ACQUISITION


@njit(inline="always")
def round_to_level(voltage, input_range, bits, offset):
    """The level nearest to `voltage` [V] of a converter with `bits` over +-`input_range` [V]; one lies `offset` steps off 0."""
    step = 2.0 * input_range / 2.0**bits
    return step * (floor(voltage / step - offset + 0.5) + offset)


def coarsen(s, c, p, x, h):
    """Round both channels."""
    full, pressure, torque = c.sensors_input_range, c.sensors_pressure_bits, c.sensors_clutch_torque_bits
    s.pressure_voltage = round_to_level(s.pressure_voltage, full, pressure - p.pressure_bits_lost, p.offset)
    s.clutch_torque_voltage = round_to_level(s.clutch_torque_voltage, full, torque - p.torque_bits_lost, p.offset)


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
        Shape(
            "offset", "1", typical=0.0, bounds=(0.0, 1.0),
            source="[D] rounding, as the converters of docs/rig.md, 9",
        ),
    ),
    display=Display("triangle", column="clutch_torque_nm"),
)  # fmt: skip
