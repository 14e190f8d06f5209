"""Stiction of the valve's spool: it stays until the force on it exceeds the break-away force, then jumps.

What            dirt, silting and side load hold the spool; a slow command gives a staircase, an integrating regulator hunts
Equation        |u - w| > S: w = u - sign(u - w) kappa S;  else w stays;  u_out = w
                S break-away, kappa S what is left when it has come to rest again, all as pressure
Assumptions     massless spool; the jump is over within a step; the same friction both ways
Valid range     S 0..2 bar, kappa 0..0.8; with kappa = 1 nothing jumps: a play operator, which is valve_hysteresis
Not modelled    silting that grows with the time at rest, dither, viscous friction (the valve's own damping)
References      He, Wang, Pottmann & Qin 2007, Ind. Eng. Chem. Res. 46 (this two-parameter law); Choudhury, Thornhill &
                Shah 2005, Control Engineering Practice 13 (stiction models); Merritt 1967 (causes, dither)
"""

from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import COMMAND


def stick(s, c, p, x, h):
    """Hold the demand until it has gone further than the break-away force."""
    ahead = s.demand - x.spool
    if abs(ahead) > p.breakaway:
        left = p.breakaway * p.kinetic_share
        x.spool = s.demand - (left if ahead > 0.0 else -left)
    s.demand = x.spool


EFFECT = Effect(
    block="valve",
    laws={COMMAND: stick},
    parameters=(
        Strength(
            "breakaway", "bar", off=0.0, typical=0.05, bounds=(0.0, 2.0),
            source="[D] 0.2 % of 25 bar: a spool in clean oil, with dither",
        ),
        Shape(
            "kinetic_share", "1", typical=0.5, bounds=(0.0, 0.8),
            source="[D] sliding friction half of break-away; lubricated metal pairs lie between 0.3 and 0.8",
        ),
    ),
    states=(State("spool", "Pa"),),
    rank=3,  # behind the solenoid
)  # fmt: skip
