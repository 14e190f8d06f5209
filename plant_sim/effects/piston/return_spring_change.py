"""Return springs stronger or weaker than nominal.

What            springs relax, break, or come from another batch, so that the plates touch at another pressure
Equation        F_spring = r (F_0 + k_s x)
Assumptions     preload and stiffness change by the same factor, as where some springs of the ring are missing
Valid range     r 0.5..1.5
Not modelled    tilting of the piston by a missing spring, springs that are not linear
References      Janssens 2010, eq. 6.1 and Table 6.3 (contact pressure, which the springs make)
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import RIG


def relax(s, c, p, x, h):
    """Scale the springs' force."""
    c.piston_preload *= p.ratio
    c.piston_spring_stiffness *= p.ratio


def rate(p, c):
    """The stiffness that stronger springs add, over the damping of the piston [1/s]."""
    return max(p["ratio"] - 1.0, 0.0) * c["piston_spring_stiffness"] / c["piston_damping"]


EFFECT = Effect(
    block="piston",
    laws={RIG: relax},
    parameters=(
        Strength(
            "ratio", "1", off=1.0, typical=0.99, bounds=(0.5, 1.5),
            source="[D] 1 % of set: the plates touch 24 mbar earlier, in the uncertainty of Table 6.3",
        ),
    ),
    rate=rate,
)  # fmt: skip
