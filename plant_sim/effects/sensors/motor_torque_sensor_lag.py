"""Lag of the motor-torque channel.

What            the drive filters the torque that it shows
Equation        M_m,shown' = (M_m - M_m,shown)/time;  exact for a torque held over the integration step
Assumptions     a low pass of first order that has settled when the effect is switched on; the motor's own torque is unchanged
Valid range     time 0..100 ms
Not modelled    filters of higher order, and the cycle of the link between drive and data acquisition
References      -
"""

from math import exp

from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import SENSORS


def follow(s, c, p, x, h):
    """Let the shown torque follow the motor's."""
    torque = s.sensed_motor_torque
    if h > 0.0:
        if x.begun == 0.0:
            x.begun, x.shown = 1.0, torque
        s.sensed_motor_torque = torque + (x.shown - torque) * exp(-0.5 * h / p.time)  # torques are those of mid-step
        x.shown = torque + (x.shown - torque) * exp(-h / p.time)
    elif x.begun > 0.0 and p.time > 0.0:
        s.sensed_motor_torque = x.shown


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: follow},
    rank=25,
    parameters=(
        Strength(
            "time", "ms", off=0.0, typical=3.0, bounds=(0.0, 100.0),
            source="[D] a corner of 50 Hz, a usual setting of a drive's filter for the torque that it reports",
        ),
    ),
    states=(State("shown", "Nm"), State("begun", "1")),
)  # fmt: skip
