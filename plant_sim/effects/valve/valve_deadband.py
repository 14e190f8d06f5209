"""Dead band of the valve: the first part of its voltage gives no pressure.

What            a spool with overlap, for which the amplifier does not compensate, loses the first V_0 of the voltage
Equation        u = k_v (V - V_0) for V > V_0, 0 for |V| <= V_0, k_v (V + V_0) for V < -V_0              (dead zone)
Assumptions     the same overlap in both directions; the slope beyond it is unchanged
Valid range     V_0 0..1 V
Not modelled    leakage through the overlap, which rounds the corner; an amplifier that compensates too much
References      Merritt 1967, Hydraulic Control Systems, chapter 5 (closed-centre valves); Jelali & Kroll 2003, Hydraulic
                Servo-systems (valve nonlinearities)
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import COMMAND


def swallow(s, c, p, x, h):
    """Subtract the dead zone from the demand."""
    band = c.valve_gain * p.width
    s.demand -= min(max(s.demand, -band), band)


EFFECT = Effect(
    block="valve",
    laws={COMMAND: swallow},
    parameters=(
        Strength(
            "width", "V", off=0.0, typical=0.01, bounds=(0.0, 1.0),
            source="[D] 0.1 % of 10 V: what the amplifier's compensation leaves of an overlap of some percent; 25 mbar",
        ),
    ),
    display=Display("triangle", column="cylinder_pressure_bar"),
)  # fmt: skip
