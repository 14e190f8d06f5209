"""Frozen sensor.

What            a channel keeps its last value, without noise: a converter that hangs, or a buffer that is no longer filled
Equation        V_shown = V of the last sample before the channel's strength became 0.5 or more
Assumptions     frozen at the converter, after everything else; a channel that is frozen when the effect is switched on
                keeps the sample of that instant
Valid range     each strength 0 (works) or 1 (frozen)
Not modelled    a frame that stops; the alive counter of this one continues
References      ISO 26262-5:2018, Table D.1: failure modes of sensors, among them stuck in range
"""

from numba import njit

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import ACQUISITION

_SOURCE = "[D] fault injection: frozen or not"


@njit(inline="always")
def hold(now, last, frozen):
    """A channel's present value, or its last one."""
    return last if frozen else now


def freeze(s, c, p, x, h):
    """Show the last value of each frozen channel; remember what is shown."""
    began = x.begun > 0.0
    s.pressure_voltage = hold(s.pressure_voltage, x.pressure, began and p.pressure >= 0.5)
    s.temperature_voltage = hold(s.temperature_voltage, x.temperature, began and p.temperature >= 0.5)
    s.motor_torque_voltage = hold(s.motor_torque_voltage, x.motor_torque, began and p.motor_torque >= 0.5)
    s.clutch_torque_voltage = hold(s.clutch_torque_voltage, x.clutch_torque, began and p.clutch_torque >= 0.5)
    s.encoder_angle = hold(s.encoder_angle, x.encoder, began and p.encoder >= 0.5)
    if h > 0.0:
        x.begun = 1.0
        x.pressure, x.temperature = s.pressure_voltage, s.temperature_voltage
        x.motor_torque, x.clutch_torque, x.encoder = s.motor_torque_voltage, s.clutch_torque_voltage, s.encoder_angle


EFFECT = Effect(
    block="fault",
    laws={ACQUISITION: freeze},
    rank=40,
    candidate=False,
    parameters=(
        Strength("pressure", "1", off=0.0, typical=1.0, bounds=(0.0, 1.0), source=_SOURCE),
        Strength("temperature", "1", off=0.0, typical=1.0, bounds=(0.0, 1.0), source=_SOURCE),
        Strength("motor_torque", "1", off=0.0, typical=1.0, bounds=(0.0, 1.0), source=_SOURCE),
        Strength("clutch_torque", "1", off=0.0, typical=1.0, bounds=(0.0, 1.0), source=_SOURCE),
        Strength("encoder", "1", off=0.0, typical=1.0, bounds=(0.0, 1.0), source=_SOURCE),
    ),
    states=(
        State("begun", "1"),
        State("pressure", "V"),
        State("temperature", "V"),
        State("motor_torque", "V"),
        State("clutch_torque", "V"),
        State("encoder", "rad"),
    ),
    display=Display("engagement", column="clutch_torque_nm"),
)  # fmt: skip
