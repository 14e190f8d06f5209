"""Zero error of the motor-torque channel.

What            the drive shows a torque when its motor delivers none
Equation        M_m,shown = M_m + offset
Assumptions     constant; the motor's own torque is unchanged
Valid range     offset -50..50 Nm
Not modelled    its drift with temperature and age
References      -
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import SENSORS


def add(s, c, p, x, h):
    """Add the zero error."""
    s.sensed_motor_torque += p.offset


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: add},
    rank=20,
    parameters=(
        Strength(
            "offset", "Nm", off=0.0, typical=0.8, bounds=(-50.0, 50.0),
            source="[D] 2 % of the motor's 40 Nm: current sensors of a drive",
        ),
    ),
)  # fmt: skip
