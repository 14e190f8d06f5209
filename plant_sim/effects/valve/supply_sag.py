"""Supply that sags while oil is drawn.

What            the fill takes more oil than pump and accumulator deliver at constant pressure; the valve divides the pressure
                between supply and tank, so that its own sags too
Equation        tau d(sag)/dt = R q - sag,  q = max(G (p_v - p), 0);  p_s = p_s0 - sag;  u_out = u p_s / p_s0,  u_out <= p_s
Assumptions     one lag for accumulator and pump; the valve opens in proportion to its voltage, so that its pressure is
                proportional to the supply's; q by the law of the line alone
Valid range     R 0..5e4 bar s/m^3, tau 1..200 ms
Not modelled    pump ripple, other consumers, a valve that regulates its own pressure (it would hide the sag)
References      Merritt 1967, Hydraulic Control Systems (supplies and accumulators); Jelali & Kroll 2003 (supply pressure as a
                state)
"""

from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import COMMAND


def sag(s, c, p, x, h):
    """Lower the supply by the sag of the drawn flow, and the demand in proportion."""
    flow = max(c.hydraulics_conductance * (s.valve_pressure - s.pressure), 0.0)
    x.sag += h / (p.recovery + 0.5 * h) * (p.droop * flow - x.sag)  # trapezoidal rule: stable at any step
    low = min(x.sag, s.supply_pressure)
    s.demand *= 1.0 - low / s.supply_pressure
    s.supply_pressure -= low


EFFECT = Effect(
    block="valve",
    laws={COMMAND: sag},
    parameters=(
        Strength(
            "droop", "bar s/m^3", off=0.0, typical=4000.0, bounds=(0.0, 5e4),
            source="[D] 0.5 bar of 25 at the 1.3e-4 m^3/s of a fill",
        ),
        Shape(
            "recovery", "ms", typical=20.0, bounds=(1.0, 200.0),
            source="[D] a pump's own pressure control takes some tens of milliseconds",
        ),
    ),
    states=(State("sag", "Pa"),),
    rank=4,  # after the spool
)  # fmt: skip
