"""Motor torque ripples with its angle.

What            slots, and harmonics of flux and current, make the motor's torque uneven over a turn
Equation        M_m = M_m0 [1 + a cos(n theta + phi)]
Assumptions     one order n, in proportion to the demanded torque; the drive's torque signal shows the ripple; theta is
                the angle of the plate at mid-step: the twist of the shaft is small against a period
Valid range     a 0..0.5, n 0.5..200 a turn
Not modelled    cogging without current (position_ripple), the drive's own compensation, change with field weakening
References      Hanselman 2003, Brushless permanent magnet motor design, ch. on torque ripple
"""

from math import cos

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, Strength
from plant_sim.effects.signals import DRIVE
from plant_sim.effects.start import StrongestOrder


def ripple(s, c, p, x, h):
    """Scale the motor's torque by a cosine of the angle."""
    factor = 1.0 + p.amplitude * cos(p.order * (s.angle + 0.5 * h * s.slip) + p.phase)
    s.motor_torque *= factor
    s.drive_torque *= factor


EFFECT = Effect(
    block="drive",
    laws={DRIVE: ripple},
    parameters=(
        Strength(
            "amplitude", "1", off=0.0, typical=0.03, bounds=(0.0, 0.5),
            source="[D] usual for machines without skewed slots",
        ),
        Shape("order", "1", typical=24.0, bounds=(0.5, 200.0), source="[D] sixth harmonic of four pole pairs"),
        Shape("phase", "rad", typical=0.5, bounds=(-3.2, 3.2), source="[D] where the encoder's zero happens to be"),
    ),
    display=Display("crawl", column="motor_torque_nm", over="shaft_angle_rad"),
    start=StrongestOrder("motor_torque_nm", share_of="motor_torque_nm"),
)  # fmt: skip
