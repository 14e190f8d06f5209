"""Saturation of a sensor's amplifier.

What            the amplifier of the pressure or the clutch-torque channel saturates within the converter's range
Equation        |V_shown| = min(|V|, limit) - bend ln(1 + exp(-||V| - limit|/bend)), at least 0, after the noise
                at the limit itself it shows bend ln 2 less;  without a bend  V_shown = min(max(V, -limit), limit)
Assumptions     symmetric limits; the same bend in both channels; it recovers without delay
Valid range     limit 0.1..20 V; at 20 V, beyond the range of any converter here, it cuts nothing;  bend 0..0.5 V
Not modelled    the limit at 0 V of an amplifier with one supply
References      Janssens 2010, sec. 3.9.4: +-10 V at the converter; Boyd & Vandenberghe 2004, Convex Optimization, sec. 3.1.5:
                log-sum-exp as a smooth maximum
"""

from math import copysign, exp, log1p

from numba import njit

from plant_sim.effects.effect import Effect, Shape, Strength
from plant_sim.effects.signals import ACQUISITION
from plant_sim.effects.start import ChannelEnds

HIGHEST = 20.0  # V, a limit beyond the range of any converter here


@njit(inline="always")
def limit_voltage(voltage, limit, bend):
    """Voltage [V] behind an amplifier that ends at `limit` [V] and bends before it."""
    size = min(abs(voltage), limit)
    if bend > 0.0 and limit < HIGHEST:
        size = max(size - bend * log1p(exp(-abs(abs(voltage) - limit) / bend)), 0.0)
    return copysign(size, voltage)


def saturate(s, c, p, x, h):
    """Limit both channels."""
    s.pressure_voltage = limit_voltage(s.pressure_voltage, p.pressure_limit, p.bend)
    s.clutch_torque_voltage = limit_voltage(s.clutch_torque_voltage, p.torque_limit, p.bend)


EFFECT = Effect(
    block="sensors",
    laws={ACQUISITION: saturate},
    rank=10,
    parameters=(
        Strength(
            "pressure_limit", "V", off=HIGHEST, typical=3.3, bounds=(0.1, HIGHEST),
            source="[D] amplifier on a single 3.3 V supply: 3.3 bar at 1 V/bar, within the rig's 2.7..4.2 bar",
        ),
        Strength(
            "torque_limit", "V", off=HIGHEST, typical=3.3, bounds=(0.1, HIGHEST),
            source="[D] the same amplifier: 16.5 Nm at 0.2 V/Nm, within the rig's 0..30 Nm",
        ),
        Shape(
            "bend", "V", typical=0.05, bounds=(0.0, 0.5),
            source="[D] an output stage that comes close to its supply bends in some tens of millivolts",
        ),
    ),
    start=ChannelEnds({"pressure_limit": "cylinder_pressure_bar", "torque_limit": "clutch_torque_nm"}),
)  # fmt: skip
