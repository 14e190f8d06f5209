"""Hysteresis of the valve's solenoid: its pressure is lower while rising than while falling.

What            magnetic hysteresis and dry friction of the armature make the pressure lag the command by up to half a loop
Equation        w_i = min(max(w_i, u - r_i), u + r_i);  u_out = u - (1/s) mean of (u - w_1)..(u - w_4);
                r_i = s (2 i - 1)/8 width
                (Prandtl-Ishlinskii: play operators of evenly spread radii; the saturated loop is `width` wide; from one of
                its sides to the other the command moves by s times the width)
Assumptions     independent of the rate; loops are congruent at all pressures; the history begins at zero demand
Valid range     width 0..2 bar, s 0.25..4
Not modelled    saturation of the iron, dither, dependence on rate; a spool that jumps is spool_stiction
References      Krasnosel'skii & Pokrovskii 1989, Systems with Hysteresis; Brokate & Sprekels 1996, Hysteresis and Phase
                Transitions (play, Prandtl-Ishlinskii, return-point memory); Jelali & Kroll 2003 (proportional valves)
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import COMMAND

PLAYS = 4  # enough that a minor loop looks smooth in 5 mbar of noise


def lag(s, c, p, x, h):
    """Replace the demand by the mean of the play operators."""
    demand, behind = s.demand, 0.0
    for i in range(PLAYS):
        radius = p.spread * p.width * (2 * i + 1) / (2 * PLAYS)
        x.plays[i] = min(max(x.plays[i], demand - radius), demand + radius)
        behind += demand - x.plays[i]
    s.demand = demand - behind / (p.spread * PLAYS)


EFFECT = Effect(
    block="valve",
    laws={COMMAND: lag},
    parameters=(
        Strength(
            "width", "bar", off=0.0, typical=0.06, bounds=(0.0, 2.0),
            source="[D] 0.25 % of 25 bar, with dither; undithered proportional pressure valves have some percent",
        ),
        Shape(
            "spread", "1", typical=1.0, bounds=(0.25, 4.0),
            source="[D] a single play operator crosses over its own width",
        ),
    ),
    states=(State("plays", "Pa", PLAYS),),
    rank=2,  # after dead band and gain: the solenoid is fed by the amplifier
    display=Display("triangle", column="cylinder_pressure_bar"),
)  # fmt: skip
