"""Friction differs with the direction of slip.

What            cut of the grooves, grain of the lining or a tilted guide make one direction rub more than the other
Equation        M = M_0 (1 + a) for M_0 > 0, M_0 (1 - a) for M_0 < 0
Assumptions     the direction is that of the friction, which is that of slip but for its lag: so there is no jump at a reversal,
                and friction in pre-sliding stays passive
Valid range     |a| <= 0.5
Not modelled    another Stribeck curve in the other direction
References      Janot, Gautier and Brunot 2019, data set of the EMPS axis: friction that depends on the
                direction explains more of its force than one that does not
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import TORQUE


def lean(s, c, p, x, h):
    """Raise one direction, lower the other."""
    s.torque += p.asymmetry * abs(s.torque)


EFFECT = Effect(
    block="friction",
    laws={TORQUE: lean},
    parameters=(
        Strength(
            "asymmetry", "1", off=0.0, typical=0.03, bounds=(-0.5, 0.5),
            source="[D] 6 % between the directions",
        ),
    ),
    rank=15,  # after presliding, of which it is a fixed function
)  # fmt: skip
