"""Zero error of the oil-temperature sensor.

What            the sensor shows a temperature that is off by a constant
Equation        T_shown = T + offset
Assumptions     constant
Valid range     offset -100..100 K
Not modelled    an offset that changes with temperature: error of the sensitivity, self-heating
References      IEC 60751: a Pt100 of class B is right within 0.30 K + 0.005 |T|, 0.65 K at 70 degC
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import SENSORS


def add(s, c, p, x, h):
    """Add the zero error."""
    s.sensed_temperature += p.offset


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: add},
    rank=20,
    candidate=False,
    parameters=(
        Strength(
            "offset", "K", off=0.0, typical=5.0, bounds=(-100.0, 100.0),
            source="[D] a lead of 2 ohm that a two-wire Pt100 (0.385 ohm/K) takes for temperature",
        ),
    ),
)  # fmt: skip
