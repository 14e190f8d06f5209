"""Air entrapped in the cylinder: soft at low pressure, so that the fill draws more oil and its pressure rises later.

What            free air, left from draining, must be compressed before the pressure rises
Equation        V(p) = V_0 p_0 / (p_0 + p), isothermal;  C = C_h + V_0 p_0 / (p_0 + p)^2,  p_0 = 1.01325 bar
Assumptions     small bubbles: isothermal; the amount of air stays; none dissolves
Valid range     V_0 0..5e-5 m^3 at atmospheric pressure, p >= 0
Not modelled    solution and cavitation, purging with each fill, air in the line before the throttle
References      Merritt 1967, Hydraulic Control Systems, chapter 2 (effective bulk modulus with air); Watton 2009,
                Fundamentals of Fluid Power Control; Jelali & Kroll 2003, Hydraulic Servo-systems
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import HYDRAULICS

ATMOSPHERE = 101325.0  # Pa, standard


def soften(s, c, p, x, h):
    """Add the compressibility of the air to that of oil and line."""
    share = 1.0 / (ATMOSPHERE + max(s.pressure, 0.0))  # within a step the pressure may fall below 0
    s.capacity += p.volume * ATMOSPHERE * share * share


EFFECT = Effect(
    block="hydraulics",
    laws={HYDRAULICS: soften},
    parameters=(
        Strength(
            "volume", "m^3", off=0.0, typical=1e-6, bounds=(0.0, 5e-5),
            source="[D] 1 cm^3 in addition to the 11 cm^3 that the piston displaces: left after draining through the shaft",
        ),
    ),
)  # fmt: skip
