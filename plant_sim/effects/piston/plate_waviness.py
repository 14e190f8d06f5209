"""Waviness of the plates: they touch at their crests first and take the force gradually.

What            the stack begins soft and reaches its stiffness once the crests are pressed flat
Equation        F = k (g + a)^2 / (4 a) for |g| < a, k g beyond, g = x - x_c: the linear stack, averaged over gaps g - z with z
                spread evenly over -a..a
Assumptions     straight crests (saw-tooth wave); each spot is a spring of its own (Winkler); the mean plane stays where it is
Valid range     a 0..0.5 mm, less than the clearance
Not modelled    bending stiffness, its own hysteresis, ripple as the plates turn (shaft_angle_ripple)
References      Johnson 1985, Contact Mechanics, chapter 4 (elastic foundation); Janssens 2010, fig 6.10 (piston and stack)
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import STACK


def cushion(s, c, p, x, h):
    """Replace the stack's force near touch by its mean over the wave."""
    gap = s.position - c.piston_clearance
    if abs(gap) < p.height:
        pressed = gap + p.height
        s.stack_force = c.piston_stack_stiffness * pressed * pressed / (4.0 * p.height)


EFFECT = Effect(
    block="piston",
    laws={STACK: cushion},
    parameters=(
        Strength(
            "height", "mm", off=0.0, typical=0.03, bounds=(0.0, 0.5),
            source="[D] 0.06 mm from crest to valley on plates meant to be flat; wavy plates are made with some tenths",
        ),
    ),
    display=Display("engagement", column="clutch_torque_nm"),
)  # fmt: skip
