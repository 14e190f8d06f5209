"""Stiction of the valve's spool: it stays until the force on it exceeds the break-away force, then jumps.

What            dirt, silting and side load hold the spool; a slow command gives a staircase; a loop with an integrator hunts
Equation        stuck: w stays until |u - w| > S;  sliding: dw/dt = a (|u - w|/S - kappa) sign(u - w)
                stuck again when |dw/dt| < b a;  u_out = w
                S: break-away, kappa S: sliding friction, both as pressure; a: speed under a surplus of S, since the cause of
                stiction is viscous as well; S/a: time constant of the slide
Assumptions     massless spool; the same friction in both directions; a band of speed about 0 counts as rest (Karnopp); when
                the effect is switched on, the spool rests at the valve's present pressure
Valid range     S 0..2 bar, kappa 0..0.8, a 5..1000 bar/s, b 0..0.2. A ramp slower than b a gives a staircase, a faster one a
                lag of kappa S. With kappa = 1 nothing would jump: that is a play operator, as in valve_hysteresis
Not modelled    silting that grows with the time at rest, dither
References      Karnopp 1985, J. Dyn. Sys. Meas. Control 107 (rest as a band of speed); Choudhury, Thornhill & Shah 2005,
                Control Engineering Practice 13 (stiction of valves); He, Wang, Pottmann & Qin 2007, Ind. Eng. Chem. Res. 46
                (the two parameters S, kappa); Merritt 1967 (causes, dither)
"""

from math import exp, log

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import COMMAND


def stick(s, c, p, x, h):
    """Hold the demand until it has moved by the break-away force; then follow it until the spool is slow."""
    if h > 0.0 and x.begun == 0.0:
        x.begun, x.spool = 1.0, s.valve_pressure
    ahead = s.demand - x.spool
    s.demand = x.spool
    if h == 0.0:
        return
    if abs(ahead) > p.breakaway:
        x.sliding = 1.0 if ahead > 0.0 else -1.0
    way, rest = x.sliding, p.rest_band * p.breakaway
    if way == 0.0:
        return
    surplus = way * ahead - p.breakaway * p.kinetic_share
    if surplus <= rest:
        x.sliding = 0.0
        return
    pace = h * p.speed / p.breakaway
    left = surplus * exp(-pace)
    mean = (surplus - left) / pace  # of the surplus, over the step
    if left < rest:  # it comes to rest within the step
        mean = (surplus - rest) / pace + rest * (1.0 - log(surplus / rest) / pace)
        left, x.sliding = rest, 0.0
    s.demand += way * (surplus - mean)
    x.spool += way * (surplus - left)


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
        Shape(
            "speed", "bar/s", typical=100.0, bounds=(5.0, 1000.0),
            source="[D] 1 ms for a break-away of 0.1 bar: a spool is much faster than its valve (20 ms)",
        ),
        Shape("rest_band", "1", typical=0.01, bounds=(0.0, 0.2), source="[D] ramps below 1 bar/s stick and slip"),
    ),
    states=(State("spool", "Pa"), State("sliding", "1"), State("begun", "1")),
    rank=3,  # after the solenoid
    display=Display("triangle", column="cylinder_pressure_bar"),
)  # fmt: skip
