"""Dead time of the valve: the command arrives late.

What            amplifier, rise of the current and overlap of the spool take time before the pressure begins to answer
Equation        u_out(t) = u(t - delay); the demand is held over a step, the delayed one is the mean over the step
Assumptions     pure transport delay; the demand before the start of a run was 0; where the effect is switched on later, the
                demand before is taken as that at this moment
Valid range     delay 0..50 ms
Not modelled    a delay that depends on the size of the step or on the oil's temperature
References      Jelali & Kroll 2003, Hydraulic Servo-systems; Watton 2009, Fundamentals of Fluid Power Control; law:
                plant_sim/blocks/delay_line.py
"""

from plant_sim.blocks.delay_line import AT_END, begin_step, read_delayed
from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import COMMAND


def delay(s, c, p, x, h):
    """Replace the demand by that of `delay` ago."""
    if x.taken == 0.0 and s.time <= h:  # a run begins: the first value of the line stays 0
        begin_step(x, h)
    begin_step(x, h)
    s.demand = read_delayed(x.past, x, s.demand, p.delay, AT_END, h)


EFFECT = Effect(
    block="valve",
    laws={COMMAND: delay},
    parameters=(
        Strength(
            "delay", "ms", off=0.0, typical=3.0, bounds=(0.0, 50.0),
            source="[D] a few milliseconds of amplifier and solenoid",
        ),
    ),
    states=(State("past", "Pa", 1024), State("taken", "1"), State("step", "s")),
)  # fmt: skip
