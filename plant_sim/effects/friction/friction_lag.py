"""Friction lags more, or less, than identified.

What            friction needs time to follow a change of slip (by C), and a change of load (until the asperities have settled)
Equation        C = a C_0;  dM_C/dt = (M_C0 - M_C)/tau_n                           (6.9; normal state of 6.2, C_n = 1/tau_n)
Assumptions     both are lags in time, as the thesis has its attraction parameter in gross sliding; plates that have just
                touched have the friction of their load without delay
Integration     exact at constant load over a step
Valid range     a 0.05..20, tau_n 0..0.2 s
Not modelled    lag over a distance of slip
References      Janssens 2010, eq. 6.7 and fig 6.14 (C at 3.4 bar alone), eq. 6.2, whose normal state is not identified there
"""

from math import expm1

from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import FRICTION, TORQUE


def follow(s, c, p, x, h):
    """Scale the attraction; let the Coulomb torque follow the load late."""
    s.attraction *= p.attraction
    if p.load_lag == 0.0:
        return
    felt = x.coulomb if x.coulomb > 0.0 else s.coulomb
    gone = -expm1(-0.5 * h / p.load_lag)
    middle = felt + (s.coulomb - felt) * gone
    if h > 0.0:
        x.coulomb = middle + (s.coulomb - middle) * gone
    s.coulomb = middle


def part(s, c, p, x, h):
    """Forget the load when the plates part."""
    if h > 0.0 and s.contact == 0.0:
        x.coulomb = 0.0


EFFECT = Effect(
    block="friction",
    laws={FRICTION: follow, TORQUE: part},
    parameters=(
        Strength(
            "attraction", "1", off=1.0, typical=0.5, bounds=(0.05, 20.0),
            source="[D] twice the lag: C is known at one pressure only, Janssens 2010, eq. 6.7",
        ),
        Strength(
            "load_lag", "ms", off=0.0, typical=5.0, bounds=(0.0, 200.0),
            source="[D] the order of 1/C = 14 ms, Janssens 2010, eq. 6.7; C_n of eq. 6.2 is not given there",
        ),
    ),
    states=(State("coulomb", "Nm"),),
    rank=10,  # after the effects that change the Coulomb torque, which it lets lag
)  # fmt: skip
