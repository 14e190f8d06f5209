"""Zero error of the clutch-torque sensor.

What            the sensor shows a torque when there is none: not zeroed, or its amplifier has drifted
Equation        M_shown = M + offset
Assumptions     constant; added after the leak of a piezo sensor, where its power unit adds it
Valid range     offset -50..50 Nm
Not modelled    its drift with temperature and age
References      Janssens 2010, sec. C.2: the zero error V_0 that zeroing before a measurement leaves
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import SENSORS


def add(s, c, p, x, h):
    """Add the zero error."""
    s.sensed_clutch_torque += p.offset


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: add},
    rank=20,
    parameters=(
        Strength(
            "offset", "Nm", off=0.0, typical=0.5, bounds=(-50.0, 50.0),
            source="[D] 1 % of the channel's 50 Nm",
        ),
    ),
)  # fmt: skip
