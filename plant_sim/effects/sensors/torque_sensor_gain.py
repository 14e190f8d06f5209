"""Gain of the clutch-torque sensor.

What            the sensor's sensitivity, or the length of the arm that presses on it, is not as assumed
Equation        M_shown = gain M
Assumptions     linear, no offset
Valid range     gain 0.5..2
Not modelled    non-linearity, hysteresis and temperature dependence of the gain
References      docs/rig.md, 9 gives the sensitivity an uncertainty of 1 %
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import SENSORS


def scale(s, c, p, x, h):
    """Multiply the torque."""
    s.sensed_clutch_torque *= p.gain


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: scale},
    rank=10,
    parameters=(
        Strength(
            "gain", "1", off=1.0, typical=1.05, bounds=(0.5, 2.0),
            source="[D] 5 % out of calibration: five times what parameters/janssens2010.toml allows the sensitivity",
        ),
    ),
)  # fmt: skip
