"""Another Stribeck curve.

What            the oil, its friction modifier or a worn lining change how far, and at what speed, friction falls
Equation        s_n = 1 - d (1 - beta) exp(-v V_S/|omega|)                                             (6.2, d = v = 1)
Assumptions     same shape of the curve; friction at standstill unchanged
Valid range     d 0..3: from no fall to three times the fall, at most to 5 % of the Coulomb level; v 0.1..10
Not modelled    change of the viscous part
References      Stribeck 1902, Die wesentlichen Eigenschaften der Gleit- und Rollenlager; Janssens 2010, eqs 6.2 and 6.5
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import FRICTION

_LEAST = 0.05  # of beta: the friction state relaxes at C/s_n, which must stay finite


def reshape(s, c, p, x, h):
    """Change depth and speed of the Stribeck effect."""
    s.beta = max(s.beta + (1.0 - p.depth) * (1.0 - s.beta), _LEAST)
    s.stribeck_speed *= p.speed


EFFECT = Effect(
    block="friction",
    laws={FRICTION: reshape},
    parameters=(
        Strength(
            "depth", "1", off=1.0, typical=1.2, bounds=(0.0, 3.0),
            source="[D] beta_inf 0.64 in place of 0.70, as between batches of oil",
        ),
        Strength(
            "speed", "1", off=1.0, typical=0.9, bounds=(0.1, 10.0),
            source="[D] two standard deviations of V_S: Janssens 2010, eq. 6.5",
        ),
    ),
    display=Display("slip_sine", column="clutch_torque_nm"),
)  # fmt: skip
