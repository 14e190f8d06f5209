"""Torque ripples with the shaft's angle, in proportion to itself.

What            a plate that is not flat, or not square to the shaft, presses or rubs unevenly over a turn
Equation        M = M_0 [1 + a cos(n theta + phi)]
Assumptions     one order n; theta at mid-step
Valid range     a 0..0.5, n 0.5..200 a turn
Not modelled    harmonics, ripple of the pressure it causes
References      [D] runout of plates; Janssens 2010, sec. 3.9.1: encoder on the turning side
"""

from math import cos

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, Strength
from plant_sim.effects.signals import TORQUE
from plant_sim.effects.start import StrongestOrder


def ripple(s, c, p, x, h):
    """Scale the torque by a cosine of the angle."""
    s.torque *= 1.0 + p.amplitude * cos(p.order * (s.angle + 0.5 * h * s.slip) + p.phase)


EFFECT = Effect(
    block="friction",
    laws={TORQUE: ripple},
    parameters=(
        Strength(
            "amplitude", "1", off=0.0, typical=0.03, bounds=(0.0, 0.5),
            source="[D] 3 %: some micrometres of runout against the compression of lining and stack",
        ),
        Shape("order", "1", typical=2.0, bounds=(0.5, 200.0), source="[D] periods a turn; a buckled plate has two"),
        Shape("phase", "rad", typical=0.5, bounds=(-3.2, 3.2), source="[D] where the encoder's zero happens to be"),
    ),
    display=Display("crawl", column="clutch_torque_nm", over="shaft_angle_rad"),
    start=StrongestOrder("clutch_torque_nm", share_of="clutch_torque_nm"),
)  # fmt: skip
