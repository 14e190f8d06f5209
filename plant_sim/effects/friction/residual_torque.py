"""Friction torque that no effect of the catalogue explains, as a polynomial.

What            replaces a missing effect that the discrepancy workflow cannot name, so that the model can be used meanwhile
Equation        M += sigma (a_0 + a_1 P + a_2 P^2 + a_3 W + a_4 W^2 + a_5 P W + a_6 T + a_7 P T + a_8 D + a_9 P D + a_10 t
                       + a_11 E) + a_12 V + b cos(n theta) + b' sin(n theta)    in contact
                M += sigma a_13 W                                               out of contact
                M += a_14                                                       always
                P = (p* - 3.4 bar)/0.8 bar, W = |omega|/20 rad/s, T = (T - 70 degC)/10 K, t = time/24 s,
                sigma = omega/(|omega| + 0.5 rad/s), E, V: p/0.8 bar, omega/20 rad/s minus the same after a lag of 20 ms,
                dD = dp/0.1 bar, |D| <= 1: direction of the pressure, kept while it is constant (Maxwell-slip element)
Assumptions     none: coefficients are fitted (clutch_hil/discrepancy/surrogate_term.py), not understood
Valid range     that of the runs it was fitted to; |P|, W, |T|, |E| are held beyond 2
Not modelled    the physical cause; memory beyond 20 ms
References      Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63 (a model and its discrepancy term)
"""

from math import cos, exp, sin

from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import TORQUE

BAR = 1e5
PRESSURE, PRESSURE_SPAN = 3.4 * BAR, 0.8 * BAR  # Pa, middle and half of the rig's range in contact: docs/rig.md
SLIP_SPAN = 20.0  # rad/s
CELSIUS_70, KELVIN_SPAN = 343.15, 10.0  # K: reference and warming of a run
TIME_SPAN = 24.0  # s, a run
LAG = 0.02  # s: what follows changes of pressure and slip
TURN = 0.1 * BAR  # Pa: the direction has turned after twice as much
MOST = 2.0  # of P, W, T, E: beyond twice the range of a run what was fitted is held, not extrapolated
CREEP = 0.5  # rad/s: slower slip has half a sign


def add(s, c, p, x, h):
    """Add the polynomial."""
    if h > 0.0:
        x.direction = min(max(x.direction + (s.pressure - x.last) / TURN, -1.0), 1.0)
        x.last = s.pressure
        share = 1.0 - exp(-h / LAG)
        x.pressure += share * (s.pressure - x.pressure)
        x.slip += share * (s.slip - x.slip)
    s.torque += p.offset
    speed = abs(s.slip)
    sign = s.slip / (speed + CREEP)
    w = min(speed / SLIP_SPAN, MOST)
    if s.contact == 0.0:
        s.torque += p.open_slip * w * sign
        return
    q = min(max((s.friction_pressure - PRESSURE) / PRESSURE_SPAN, -MOST), MOST)
    t = min(max((s.temperature - CELSIUS_70) / KELVIN_SPAN, -MOST), MOST)
    e = min(max((s.pressure - x.pressure) / PRESSURE_SPAN, -MOST), MOST)
    s.torque += p.slip_lag * (s.slip - x.slip) / SLIP_SPAN + sign * (
        p.level + p.temperature * t + p.time * s.time / TIME_SPAN + p.direction * x.direction
        + p.pressure_lag * e + w * (p.slip + p.slip2 * w)
        + q * (p.pressure + p.pressure2 * q + p.pressure_slip * w + p.pressure_temperature * t
               + p.pressure_direction * x.direction)
    )  # fmt: skip
    if p.cosine != 0.0 or p.sine != 0.0:
        s.torque += p.cosine * cos(p.order * s.angle) + p.sine * sin(p.order * s.angle)


def _make_coefficient(name):
    return Strength(
        name, "Nm", off=0.0, typical=0.5, bounds=(-10.0, 10.0), source="fitted; [D] bounds as the whole torque"
    )


EFFECT = Effect(
    block="friction",
    laws={TORQUE: add},
    parameters=(
        *(_make_coefficient(name) for name in (
            "offset", "level", "pressure", "pressure2", "slip", "slip2", "pressure_slip", "temperature",
            "pressure_temperature", "direction", "pressure_direction", "time", "pressure_lag", "slip_lag", "open_slip",
            "cosine", "sine",
        )),
        Shape("order", "1", typical=1.0, bounds=(0.1, 100.0), source="[D] as shaft_angle_ripple"),
    ),
    states=(State("last", "Pa"), State("direction", "1"), State("pressure", "Pa"), State("slip", "rad/s")),
    rank=90,  # after all effects that are understood
    candidate=False,
)  # fmt: skip
