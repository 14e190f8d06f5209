"""A valve with another natural frequency.

What            cold or thick oil, a weak amplifier or a worn solenoid make the valve slower (or a better one faster)
Equation        p_v'' + 2 zeta (r w) p_v' + (r w)^2 p_v = (r w)^2 u
Assumptions     damping ratio unchanged; the same for large and small steps
Valid range     r 0.1..3
Not modelled    limited slew rate; dependence on temperature (oil_viscosity does the line)
References      Merritt 1967, Hydraulic Control Systems; Watton 2009, Fundamentals of Fluid Power Control (valves as
                second-order systems)
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import RIG


def slow(s, c, p, x, h):
    """Scale the natural frequency."""
    c.valve_frequency *= p.ratio


EFFECT = Effect(
    block="valve",
    laws={RIG: slow},
    parameters=(
        Strength(
            "ratio", "1", off=1.0, typical=0.9, bounds=(0.1, 3.0),
            source="[D] 10 % between valves of one type: 4 ms more of lag",
        ),
    ),
)  # fmt: skip
