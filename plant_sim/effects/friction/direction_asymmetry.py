"""Friction differs with the direction of slip.

What            the cut of the grooves, the grain of the lining or a tilted guide give one direction more friction
Equation        M = M_0 + a |2 (1 - w) M_C + 2 w M_v|,  M_0 = M_C + M_v, Coulomb and viscous part
                so that w = 1/2 is M_0 (1 + a) for M_0 > 0, M_0 (1 - a) for M_0 < 0; w = 1: only the viscous part differs
Assumptions     the direction is that of the friction torque, which follows that of slip with its lag: so there is no jump at a
                reversal, and friction in pre-sliding stays passive
Valid range     |a| <= 0.5
Not modelled    another Stribeck curve in the other direction
References      Janot, Gautier and Brunot 2019, data set of the EMPS axis: friction that depends on the direction explains more
                of its force than one that does not (docs/measured_data.md)
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, Strength
from plant_sim.effects.signals import TORQUE


def lean(s, c, p, x, h):
    """Raise the torque in one direction and lower it in the other."""
    weight = 1.0 + (2.0 * p.viscous_part - 1.0) * (2.0 * s.viscous_share - 1.0)
    s.torque += p.asymmetry * weight * abs(s.torque)


EFFECT = Effect(
    block="friction",
    laws={TORQUE: lean},
    parameters=(
        Strength(
            "asymmetry", "1", off=0.0, typical=0.03, bounds=(-0.5, 0.5),
            source="[D] 6 % between the directions",
        ),
        Shape(
            "viscous_part", "1", typical=0.5, bounds=(0.0, 1.0),
            source="[D] w: both parts alike; of the EMPS axis it is 1, its Coulomb friction is the same in both directions",
        ),
    ),
    rank=15,  # after presliding: it scales the torque of pre-sliding
    display=Display("slip_sine", column="clutch_torque_nm"),
)  # fmt: skip
