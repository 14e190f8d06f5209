"""Coefficient of friction falls with the load.

What            contact spots merge under load, so that the Coulomb torque rises less than in proportion to the force
Equation        M_C = M_C0 [1 - f exp(-L/p_n)],  p_n = F_n/A_cyl = p* - p_contact,  f = 1/a_2                        (4.2)
Assumptions     no delay behind the load; viscous part unchanged
Valid range     p_n 0..3 bar; f 0..0.9
Not modelled    the part of this that the maps of Table 6.4 contain already: they are straight lines over 0.35..1.85 bar
References      Janssens 2010, eq. 4.2, figs 4.14 and 4.16 (the law is plant_sim/friction/load_law.py's)
"""

from math import exp

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, Strength
from plant_sim.effects.signals import FRICTION


def saturate(s, c, p, x, h):
    """Scale the Coulomb torque with the load."""
    pressed = s.friction_pressure - c.piston_contact_pressure
    if pressed > 0.0:
        s.coulomb *= 1.0 - p.fall * exp(-p.load / pressed)  # Janssens 2010, eq. 4.2


EFFECT = Effect(
    block="friction",
    laws={FRICTION: saturate},
    parameters=(
        Strength(
            "fall", "1", off=0.0, typical=0.08, bounds=(0.0, 0.9),
            source="[D] 3 % of the Coulomb torque at 3.4 bar; a_2 = 1/fall of eq. 4.2",
        ),
        Shape(
            "load", "bar", typical=1.0, bounds=(0.05, 10.0),
            source="[D] in the middle of the pressures of Janssens 2010, Table 6.4, less contact pressure; L of eq. 4.2",
        ),
    ),
    display=Display("triangle", column="clutch_torque_nm"),
)  # fmt: skip
