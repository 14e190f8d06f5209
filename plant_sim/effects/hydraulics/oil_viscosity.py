"""Viscosity of the oil in the line: cold oil fills slowly.

What            the flow in the line is laminar, so that its conductance is inversely proportional to the oil's viscosity
Equation        G -> G (eta(T_ref)/eta(T))^share: Vogel's law (blocks/viscosity.py), 1 at the reference temperature
Assumptions     the oil in the line has the temperature of that between the plates; constant density
Valid range     T 35..150 degC (oil.py), share 0..1: 0.5 for a line half of which is an orifice
Not modelled    viscosity that depends on pressure; the same in the valve (slower_valve)
References      Vogel 1921, Physikalische Zeitschrift 22, p. 645; Merritt 1967, Hydraulic Control Systems, chapters 2 and 3
                (viscosity, laminar flow)
"""

from plant_sim.blocks.viscosity import HOTTEST, relative_conductance
from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import RIG


def thicken(s, c, p, x, h):
    """Scale the line's conductance."""
    c.hydraulics_conductance *= relative_conductance(s.temperature, c.oil_reference, p.share)


def rate(p, c):
    """Amount [1/s] that the thinnest oil adds to the rate at which the line fills the cylinder."""
    most = relative_conductance(HOTTEST, c["oil_reference"], p["share"])
    return (most - 1.0) * c["hydraulics_conductance"] / c["hydraulics_capacity"]


EFFECT = Effect(
    block="hydraulics",
    laws={RIG: thicken},
    parameters=(
        Strength("share", "1", off=0.0, typical=1.0, bounds=(0.0, 1.0), source="laminar line: docs/rig.md, 2"),
    ),
    rate=rate,
    candidate=False,
    display=Display("cold_engagement", column="clutch_torque_nm"),
)
