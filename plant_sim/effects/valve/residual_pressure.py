"""Pressure that no effect of the catalogue explains, as a polynomial at the valve's demand.

What            replaces a missing effect that the discrepancy workflow cannot name, so that the model can be used meanwhile
Equation        u += a_0 + a_1 P + a_2 P^2 + a_3 W + a_4 W^2 + a_5 T + a_6 D + a_7 P D + a_8 t + a_9 E        where u > 0
                P = (u - 3.4 bar)/0.8 bar, W = |omega|/20 rad/s, T = (T - 70 degC)/10 K, t = time/24 s,
                E: u/0.8 bar minus the same after a lag of 50 ms,
                dD = du/0.1 bar, |D| <= 1: direction of the demand, kept while it is constant (Maxwell-slip element)
Assumptions     none: coefficients are fitted (clutch_hil/discrepancy/surrogate_term.py), not understood
Valid range     that of the runs it was fitted to; |P|, W, |T| are held beyond 2, |E| beyond 6
Not modelled    the physical cause; memory beyond 50 ms
References      Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63 (a model and its discrepancy term)
"""

from math import exp

from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import COMMAND

BAR = 1e5
PRESSURE, PRESSURE_SPAN = 3.4 * BAR, 0.8 * BAR  # Pa, middle and half of the rig's range in contact: docs/rig.md
SLIP_SPAN = 20.0  # rad/s
CELSIUS_70, KELVIN_SPAN = 343.15, 10.0  # K: reference and warming of a run
TIME_SPAN = 24.0  # s, a run
LAG = 0.05  # s: what follows changes of the demand
TURN = 0.1 * BAR  # Pa: the direction has turned after twice as much


MOST = 2.0  # of P, and of W, T: beyond twice the range of a run what was fitted is held, not extrapolated
FOLLOWED = 6.0  # of E: a step over the whole range in contact


def add(s, c, p, x, h):
    """Add the polynomial."""
    half = 1.0 - exp(-0.5 * h / LAG)  # 0 where h is
    if h > 0.0:
        x.direction = min(max(x.direction + (s.demand - x.last) / TURN, -1.0), 1.0)
        x.last = s.demand
        x.before += half * (s.demand - x.before)
    behind = x.before  # at mid-step
    x.before += half * (s.demand - x.before)
    if s.demand <= 0.0:
        return
    q = min(max((s.demand - PRESSURE) / PRESSURE_SPAN, -MOST), MOST)
    w = min(abs(s.cylinder_speed) / SLIP_SPAN, MOST)
    t = min(max((s.temperature - CELSIUS_70) / KELVIN_SPAN, -MOST), MOST)
    e = min(max((s.demand - behind) / PRESSURE_SPAN, -FOLLOWED), FOLLOWED)
    s.demand += (
        p.level + p.temperature * t + p.time * s.time / TIME_SPAN + p.direction * x.direction + p.lag * e
        + q * (p.pressure + p.pressure2 * q + p.pressure_direction * x.direction) + w * (p.slip + p.slip2 * w)
    )  # fmt: skip


def _make_coefficient(name):
    return Strength(
        name, "bar", off=0.0, typical=0.05, bounds=(-1.0, 1.0), source="fitted; [D] bounds as the range in contact"
    )


EFFECT = Effect(
    block="valve",
    laws={COMMAND: add},
    parameters=tuple(_make_coefficient(name) for name in (
        "level", "pressure", "pressure2", "slip", "slip2", "temperature", "direction", "pressure_direction", "time", "lag",
    )),
    states=(State("last", "Pa"), State("direction", "1"), State("before", "Pa")),
    rank=90,  # after all effects that are understood
    candidate=False,
)  # fmt: skip
