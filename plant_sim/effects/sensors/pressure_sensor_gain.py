"""Gain of the pressure sensor.

What            the sensor's sensitivity is not the one of its data sheet
Equation        p_shown = gain p
Assumptions     linear, no offset
Valid range     gain 0.5..2
Not modelled    non-linearity, hysteresis and temperature dependence of the gain
References      docs/rig.md, 9 gives the sensitivity an uncertainty of 1 %
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import SENSORS


def scale(s, c, p, x, h):
    """Multiply the pressure."""
    s.sensed_pressure *= p.gain


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: scale},
    rank=10,
    parameters=(
        Strength(
            "gain", "1", off=1.0, typical=1.03, bounds=(0.5, 2.0),
            source="[D] three times the 1 % that parameters/janssens2010.toml allows the sensitivity: out of calibration",
        ),
    ),
)  # fmt: skip
