"""Coulomb friction changes with the oil's temperature.

What            the boundary film on the lining weakens as the oil warms, so that the speed-independent part falls as well
Equation        M_C = M_C0 max(1 + a (T - T_ref), 0),  T_ref of the rig's oil, at which the maps were identified
Assumptions     linear over the range; the friction follows the mean temperature of the oil without delay
Valid range     oil 50..150 degC, a -0.01..0.01 1/K
Not modelled    temperature of the interface (friction_fade), ageing of the oil's additives
References      Janssens 2010, fig 6.8 (-0.1 %/K of the whole torque at 200 rpm) and 6.9, which gives it to the viscous
                part; Maki 2005, Wet clutch tribology, Lulea, on temperature as a variable of its own
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import FRICTION


def soften(s, c, p, x, h):
    """Scale the Coulomb torque with the temperature."""
    s.coulomb *= max(1.0 + p.slope * (s.temperature - c.oil_reference), 0.0)


EFFECT = Effect(
    block="friction",
    laws={FRICTION: soften},
    parameters=(
        Strength(
            "slope", "1/K", off=0.0, typical=-4e-3, bounds=(-0.01, 0.01),
            source="[D] a few times the 0.1 %/K of the whole torque in Janssens 2010, fig 6.8: 10 K change 10 Nm by 0.4 Nm",
        ),
    ),
    display=Display("hold", column="clutch_torque_nm"),
)  # fmt: skip
