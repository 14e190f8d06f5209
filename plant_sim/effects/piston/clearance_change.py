"""Clearance of the plates off its nominal value.

What            with wear the piston moves further before the plates touch; with swelling or a thicker plate less far
Equation        x_c -> max(x_c + change, 0); the springs stay, so that their force at touch is greater by k_s change
Assumptions     the same all around the plates; constant in a run
Valid range     change -0.5..2 mm at 1 mm of clearance
Not modelled    wear with the work done, thermal expansion
References      Janssens 2010, sec. 6.2.2 (wear of the friction material) and eq. 6.1 (springs)
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import RIG


def move(s, c, p, x, h):
    """Change the clearance between the plates and the piston at rest."""
    c.piston_clearance = max(c.piston_clearance + p.change, 0.0)


EFFECT = Effect(
    block="piston",
    laws={RIG: move},
    parameters=(
        Strength(
            "change", "mm", off=0.0, typical=0.03, bounds=(-0.5, 2.0),
            source="[D] 3 % of the clearance: wear over a small part of the lining's life; a fill at 3.4 bar takes 2 ms longer",
        ),
    ),
)  # fmt: skip
