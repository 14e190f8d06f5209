"""Offset of the encoder.

What            the encoder is turned against the shaft by a constant angle; an offset along a ramp looks like a slip speed
Equation        theta_shown = theta + offset
Assumptions     constant; counts are those of the shown angle
Valid range     offset -2 pi..2 pi
Not modelled    single lost counts, eccentricity
References      -
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import ACQUISITION


def add(s, c, p, x, h):
    """Add the offset."""
    s.encoder_angle += p.offset


EFFECT = Effect(
    block="sensors",
    laws={ACQUISITION: add},
    rank=20,
    candidate=False,
    parameters=(
        Strength(
            "offset", "rad", off=0.0, typical=0.01, bounds=(-6.283185307179586, 6.283185307179586),
            source="[D] 0.6 deg: a coupling that has slipped",
        ),
    ),
    display=Display("engagement", column="shaft_angle_rad"),
)  # fmt: skip
