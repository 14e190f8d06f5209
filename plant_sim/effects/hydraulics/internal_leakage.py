"""Internal leakage of the cylinder through its seal rings and the rotary feed.

What            oil leaves the cylinder, so that its pressure stays below that of the valve; hot oil leaks more
Equation        q = G (p_v - p) - G_l (eta(T_ref)/eta(T))^share p: Vogel's law (blocks/viscosity.py), 1 at the reference
                temperature;  there the steady p = p_v G/(G + G_l)
Assumptions     a gap into a casing at ambient pressure; the oil in it has the temperature of that between the plates
Valid range     G_l 0..1e-4 m^3/(s bar), T 35..150 degC, share 0..1: 1 for a laminar gap, 0 for one like an orifice
Not modelled    speed of the rotary seal; the square root of the pressure in an orifice
References      Merritt 1967, Hydraulic Control Systems, chapters 2 (viscosity), 3 and 6 (laminar leakage coefficients);
                Jelali & Kroll 2003
"""

from plant_sim.blocks.viscosity import HOTTEST, relative_conductance
from plant_sim.effects.effect import Effect, Shape, Strength
from plant_sim.effects.signals import HYDRAULICS


def leak(s, c, p, x, h):
    """Subtract the leakage from the flow into the cylinder."""
    s.flow -= p.conductance * relative_conductance(s.temperature, c.oil_reference, p.share) * s.pressure


def rate(p, c):
    """Rate [1/s] at which the leakage of the thinnest oil empties the cylinder."""
    most = relative_conductance(HOTTEST, c["oil_reference"], p["share"])
    return most * p["conductance"] / c["hydraulics_capacity"]


EFFECT = Effect(
    block="hydraulics",
    laws={HYDRAULICS: leak},
    parameters=(
        Strength(
            "conductance", "m^3/(s bar)", off=0.0, typical=2e-6, bounds=(0.0, 1e-4),
            source="[D] 1 % of the line's conductance: 0.4 l/min at 3.4 bar",
        ),
        Shape("share", "1", typical=1.0, bounds=(0.0, 1.0), source="[D] a laminar gap, as seal rings have"),
    ),
    rate=rate,
)  # fmt: skip
