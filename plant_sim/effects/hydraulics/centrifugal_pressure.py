"""Centrifugal pressure of the oil that turns with the cylinder.

What            the cylinder turns with the motor's side; its oil has a higher pressure at the piston than at the feed, where
                the sensor is
Equation        p_thrust = p + k omega^2;  k = rho (r_o^2 + r_i^2 - 2 r_f^2)/4, the mean over the ring r_i..r_o, fed at r_f
Assumptions     the oil turns as a solid body and fills the cylinder; no balance chamber
Valid range     k 0..1e-3 bar/(rad/s)^2
Not modelled    slip of the oil against the cylinder, partial fill, the turning oil's part in the pressure drop of the line
References      White, Fluid Mechanics, chapter 2 (liquid in rigid-body rotation), averaged over the ring here
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import HYDRAULICS


def press(s, c, p, x, h):
    """Add the mean centrifugal pressure to the one that drives the piston."""
    s.thrust_pressure += p.coefficient * s.cylinder_speed * s.cylinder_speed


EFFECT = Effect(
    block="hydraulics",
    laws={HYDRAULICS: press},
    parameters=(
        Strength(
            "coefficient", "bar/(rad/s)^2", off=0.0, typical=3e-5, bounds=(0.0, 1e-3),
            source="[D] 850 kg/m^3, a ring 80..100 mm (1.131e-2 m^2) fed at 30 mm: 3.1e-5; 20 mbar at 250 rpm",
        ),
    ),
)  # fmt: skip
