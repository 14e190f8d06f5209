"""Zero error of the speed sensor.

What            a tachometer shows a speed when the shaft is at rest; an angle that is integrated from it drifts
Equation        omega_shown = omega + offset,  theta_shown = theta + integral of the offset since it is on
Assumptions     constant; the drive's own regulator does not use this sensor
Valid range     offset -5..5 rad/s
Not modelled    its gain, its ripple
References      -
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import ACQUISITION


def turn(s, c, p, x, h):
    """Turn the shown angle with the offset."""
    x.turned += p.offset * h
    s.encoder_angle += x.turned


EFFECT = Effect(
    block="sensors",
    laws={ACQUISITION: turn},
    rank=20,
    candidate=False,
    parameters=(
        Strength(
            "offset", "rad/s", off=0.0, typical=0.3, bounds=(-5.0, 5.0),
            source="[D] 1 % of the 26 rad/s of the maps",
        ),
    ),
    states=(State("turned", "rad"),),
    display=Display("engagement", column="slip_speed_rad_s"),
)  # fmt: skip
