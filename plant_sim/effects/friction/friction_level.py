"""Level of the friction torque, drifting in time.

What            friction material, oil and wear differ from clutch to clutch, and with them the whole torque by one factor
Equation        M = max(level + drift t, 0) (M_C m + f), t since the effect was switched on
Assumptions     Coulomb and viscous part change alike
Valid range     level 0.3..3
Not modelled    the wear that causes it
References      Janssens 2010, sec. 6.2.2 (friction material and oil) and chapter 7 (changing parameters)
"""

from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import TORQUE


def scale(s, c, p, x, h):
    """Multiply the torque."""
    x.drifted += p.drift * h
    s.torque *= max(p.level + x.drifted, 0.0)


EFFECT = Effect(
    block="friction",
    laws={TORQUE: scale},
    parameters=(
        Strength(
            "level", "1", off=1.0, typical=0.85, bounds=(0.3, 3.0),
            source="[D] 15 % between batches of friction material and oil; Janssens 2010, sec. 6.2.2 names both as causes",
        ),
        Strength(
            "drift", "1/s", off=0.0, typical=-1e-3, bounds=(-0.1, 0.1),
            source="[D] wear and glazing, announced as future work in Janssens 2010, chapter 7",
        ),
    ),
    states=(State("drifted", "1"),),
)  # fmt: skip
