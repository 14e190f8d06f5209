"""Drain through the valve's tank port: the cylinder empties with another conductance than it fills.

What            oil enters past the supply edge of the valve, and leaves past its tank edge and another line
Equation        q = r G (p_v - p) where p_v < p
Assumptions     laminar in both directions; tank at ambient pressure
Valid range     r 0.05..3
Not modelled    back pressure of the tank line, oil held back by rotation (centrifugal_pressure)
References      Merritt 1967, Hydraulic Control Systems, chapter 5 (orifices of a spool valve need not match)
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import HYDRAULICS


def drain(s, c, p, x, h):
    """Scale the flow out of the cylinder."""
    if s.valve_pressure < s.pressure:
        s.flow *= p.ratio


def rate(p, c):
    """Amount [1/s] that a wider drain adds to the rate at which the line fills the cylinder."""
    return max(p["ratio"] - 1.0, 0.0) * c["hydraulics_conductance"] / c["hydraulics_capacity"]


EFFECT = Effect(
    block="hydraulics",
    laws={HYDRAULICS: drain},
    parameters=(
        Strength(
            "ratio", "1", off=1.0, typical=0.9, bounds=(0.05, 3.0),
            source="[D] a tank port a little narrower than the supply's",
        ),
    ),
    rank=-1,  # before leakage: it scales the flow of the line alone
    rate=rate,
    candidate=False,
)  # fmt: skip
