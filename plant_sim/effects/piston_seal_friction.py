"""Friction of the seal rings on the piston, with pre-sliding.

What            the seals resist the piston before they slide, so that torque over pressure opens a loop
Equation        dF = k_seal dx while |F| < W, else |F| = W;  k_seal = W / x_s   (one Maxwell-slip element, thesis sec. 5.2)
Assumptions     break-away force W independent of pressure and speed
Valid range     W 0..1000 N
Not modelled    pressure-dependent squeeze of the ring, Stribeck effect of the lip, stick time
References      Janssens 2010, fig 6.11: offered as the first cause of the direction-dependent torque over pressure
"""

from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import PISTON
from plant_sim.friction.maxwell_slip import element


def resist(s, c, p, x, h):
    """Add the force of the seals against the piston's motion."""
    x.force = element(x.force, s.displacement, p.force / p.travel, p.force)
    s.piston_force += x.force


def rate(p, c):
    """The seals' stiffness on the piston's damping [1/s]."""
    return p["force"] / p["travel"] / c["piston_damping"]


EFFECT = Effect(
    block="piston",
    laws={PISTON: resist},
    parameters=(
        Strength(
            "force", "N", off=0.0, typical=60.0, bounds=(0.0, 1000.0),
            source="[D] 60 N give the loop of Janssens 2010, fig 6.11: about 0.1 bar wide",
        ),
        Shape(
            "travel", "m", typical=5.0e-6, bounds=(1e-6, 1e-3),
            source="[D] pre-sliding travel of an elastomer lip",
        ),
    ),
    states=(State("force", "N"),),
    rate=rate,
)  # fmt: skip
