"""Sampling instant of the converter.

What            the converter starts a fixed time before the frame leaves, so that the frame shows the values of that time
Equation        u_shown(t) = u(t - lead) on all four analog channels, linear between integration steps
Assumptions     all channels at one instant; encoder counts are latched with the frame
Valid range     lead 0..1.5 ms
Not modelled    jitter of the instant
References      law: plant_sim/blocks/delay_line.py
"""

from plant_sim.blocks.delay_line import AT_END, AT_MID_STEP, begin_step, read_delayed
from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import SENSORS


def sample_early(s, c, p, x, h):
    """Show every channel as it was when the converter started."""
    begin_step(x, h)
    s.sensed_pressure = read_delayed(x.pressure, x, s.sensed_pressure, p.lead, AT_END, h)
    s.sensed_temperature = read_delayed(x.temperature, x, s.sensed_temperature, p.lead, AT_END, h)
    s.sensed_motor_torque = read_delayed(x.motor_torque, x, s.sensed_motor_torque, p.lead, AT_MID_STEP, h)
    s.sensed_clutch_torque = read_delayed(x.clutch_torque, x, s.sensed_clutch_torque, p.lead, AT_MID_STEP, h)


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: sample_early},
    rank=50,
    candidate=False,
    parameters=(
        Strength(
            "lead", "us", off=0.0, typical=500.0, bounds=(0.0, 1500.0),
            source="[D] half a cycle at 1 kHz: conversion, averaging and packing of the frame",
        ),
    ),
    states=(
        State("pressure", "Pa", 32),
        State("temperature", "K", 32),
        State("motor_torque", "Nm", 32),
        State("clutch_torque", "Nm", 32),
        State("taken", "1"),
        State("step", "s"),
    ),
)  # fmt: skip
