"""Zero error of the pressure sensor.

What            the sensor shows a pressure when there is none, and has the same error at any other pressure
Equation        p_shown = p + offset
Assumptions     constant
Valid range     offset -5..5 bar
Not modelled    its drift with temperature and age
References      -
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import SENSORS


def add(s, c, p, x, h):
    """Add the zero error."""
    s.sensed_pressure += p.offset


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: add},
    rank=20,
    parameters=(
        Strength(
            "offset", "bar", off=0.0, typical=0.05, bounds=(-5.0, 5.0),
            source="[D] 0.5 % of a 10 bar transmitter",
        ),
    ),
)  # fmt: skip
