"""A valve with a lower natural frequency or more damping, or a lag before it.

What            cold or thick oil, a weak amplifier or a worn solenoid make the valve slower
Equation        p_v'' + 2 (d zeta) (r w) p_v' + (r w)^2 p_v = (r w)^2 i,  tau i' = u - i
Assumptions     the same for large and small steps; when the effect is switched on, the current is that of the valve's present
                pressure
Valid range     r 0.1..1, d 1..5, tau 0..50 ms
                A faster valve is another valve.frequency: with r above 1, a greater damping and a lag would imitate each other
Not modelled    limited slew rate; dependence on temperature (oil_viscosity has that of the line)
References      Merritt 1967, Hydraulic Control Systems; Watton 2009, Fundamentals of Fluid Power Control (valves as
                second-order systems; the amplifier's current loop as a lag before them)
"""

from math import exp

from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import COMMAND, RIG


def slow(s, c, p, x, h):
    """Scale natural frequency and damping ratio."""
    c.valve_frequency *= p.ratio
    c.valve_damping *= p.damping


def follow(s, c, p, x, h):
    """Let the demand follow the command as the current of the solenoid does; the valve gets its mean over the step."""
    if x.begun == 0.0:
        x.begun, x.current = 1.0, s.valve_pressure
    behind = x.current - s.demand
    kept = exp(-h / p.lag) if p.lag > 0.0 else 0.0
    x.current = s.demand + kept * behind
    s.demand += behind * (1.0 - kept) * p.lag / h


EFFECT = Effect(
    block="valve",
    laws={RIG: slow, COMMAND: follow},
    parameters=(
        Strength(
            "ratio", "1", off=1.0, typical=0.9, bounds=(0.1, 1.0),
            source="[D] 10 % between valves of one type: 4 ms more of lag",
        ),
        Strength(
            "damping", "1", off=1.0, typical=1.1, bounds=(1.0, 5.0),
            source="[D] 10 % between valves of one type; thick oil damps the spool. Less damping: valve.damping",
        ),
        Strength(
            "lag", "ms", off=0.0, typical=3.0, bounds=(0.0, 50.0),
            source="[D] current loop of a plain amplifier, 50 Hz; without feedback L/R of a solenoid is 10 to 30 ms",
        ),
    ),
    states=(State("current", "Pa"), State("begun", "1")),
    rank=1,  # after the dead band, which is one of the amplifier's voltage
)  # fmt: skip
