"""Internal leakage of the cylinder through its seal rings and the rotary feed.

What            oil leaves the cylinder, so that its pressure stays below that of the valve
Equation        q = G (p_v - p) - G_l p;  steady p = p_v G/(G + G_l)
Assumptions     laminar gap, constant viscosity, into a casing at ambient pressure
Valid range     G_l 0..1e-4 m^3/(s bar)
Not modelled    temperature and speed of the rotary seal, orifice-like leaks (square root of the pressure)
References      Merritt 1967, Hydraulic Control Systems, chapters 3 and 6 (laminar leakage coefficients); Jelali & Kroll 2003
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import HYDRAULICS


def leak(s, c, p, x, h):
    """Subtract the leakage from the flow into the cylinder."""
    s.flow -= p.conductance * s.pressure


def rate(p, c):
    """Rate [1/s] at which the leakage empties the cylinder."""
    return p["conductance"] / c["hydraulics_capacity"]


EFFECT = Effect(
    block="hydraulics",
    laws={HYDRAULICS: leak},
    parameters=(
        Strength(
            "conductance", "m^3/(s bar)", off=0.0, typical=2e-6, bounds=(0.0, 1e-4),
            source="[D] 1 % of the line's conductance: 0.4 l/min at 3.4 bar",
        ),
    ),
    rate=rate,
)  # fmt: skip
