"""Gain of the motor-torque channel.

What            the drive computes its torque from the current with a torque constant that is not that of the motor
Equation        M_m,shown = gain M_m
Assumptions     linear, no offset; the motor's own torque is unchanged
Valid range     gain 0.5..2
Not modelled    the constant's dependence on the temperature of the magnets and on saturation
References      docs/rig.md, 9 gives the sensitivity an uncertainty of 1 %
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import SENSORS


def scale(s, c, p, x, h):
    """Multiply the torque."""
    s.sensed_motor_torque *= p.gain


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: scale},
    rank=10,
    parameters=(
        Strength(
            "gain", "1", off=1.0, typical=1.05, bounds=(0.5, 2.0),
            source="[D] 5 %: data sheets give a torque constant to 5 or 10 %, and a warm magnet loses 0.1 % of it per kelvin",
        ),
    ),
)  # fmt: skip
