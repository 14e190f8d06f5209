"""Torque periodic in position that does not depend on load.

What            cogging, a ball screw's pitch or a bent shaft add a torque that returns every turn, pressed or not
Equation        M = M_0 + A cos(n theta + phi)
Assumptions     one order n; a potential torque: no work over a period; theta at mid-step
Valid range     A 0..200 Nm, n 0.5..200 a turn
Not modelled    harmonics
References      Janot, Gautier and Brunot 2019, data set of the EMPS axis: a ripple over the screw's pitch; the one that
                scales with load is shaft_angle_ripple
"""

from math import cos

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, Strength
from plant_sim.effects.signals import TORQUE
from plant_sim.effects.start import StrongestOrder


def ripple(s, c, p, x, h):
    """Add the torque of this position."""
    s.torque += p.amplitude * cos(p.order * (s.angle + 0.5 * h * s.slip) + p.phase)


EFFECT = Effect(
    block="friction",
    laws={TORQUE: ripple},
    parameters=(
        Strength(
            "amplitude", "Nm", off=0.0, typical=0.3, bounds=(0.0, 200.0),
            source="[D] 1 % of the 30 Nm of Janssens 2010, figs 6.8 to 6.14: usual cogging; 10 Nm is a lot,"
            " and 20 times it on the largest rigs",
        ),
        Shape("order", "1", typical=6.0, bounds=(0.5, 200.0), source="[D] periods a turn"),
        Shape("phase", "rad", typical=0.5, bounds=(-3.2, 3.2), source="[D] where the encoder's zero happens to be"),
    ),
    rank=30,  # after the effects that scale the friction: this torque is no part of it
    display=Display("crawl", column="clutch_torque_nm", over="shaft_angle_rad"),
    start=StrongestOrder("clutch_torque_nm"),
)  # fmt: skip
