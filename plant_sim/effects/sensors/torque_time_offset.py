"""Clutch torque arrives late.

What            the torque channel shows the torque of a fixed time ago: its filter, converter or link is slower than others
Equation        M_shown(t) = M(t - delay), linear between integration steps
Assumptions     pure delay; the torque before the effect was switched on is taken as that at this moment
Valid range     delay 0..50 ms
Not modelled    a torque that is early, which no rig has: delay the other channels instead
References      law: plant_sim/blocks/delay_line.py
"""

from plant_sim.blocks.delay_line import AT_MID_STEP, begin_step, read_delayed
from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import SENSORS


def show_past(s, c, p, x, h):
    """Show the torque of `delay` ago."""
    begin_step(x, h)
    s.sensed_clutch_torque = read_delayed(x.past, x, s.sensed_clutch_torque, p.delay, AT_MID_STEP, h)


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: show_past},
    rank=40,
    parameters=(
        Strength(
            "delay", "ms", off=0.0, typical=3.0, bounds=(0.0, 50.0),
            source="[D] three cycles at 1 kHz: a strain-gauge amplifier with its filter, on a link of its own",
        ),
    ),
    states=(State("past", "Nm", 1024), State("taken", "1"), State("step", "s")),
)  # fmt: skip
