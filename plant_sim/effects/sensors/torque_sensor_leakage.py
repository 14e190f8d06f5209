"""Leakage of a piezo (ICP) clutch-torque sensor.

What            the sensor's charge leaks away, so a constant torque fades; warming of the sensor acts as a load
Equation        q' = decay_rate (L - q);  M_shown = L - q;  L = M + warming_load (T - T_0)               (thesis, sec. C.2)
                that is tau s/(tau s + 1) with tau = 1/decay_rate; exact for a load held over the integration step
Assumptions     sensor and power unit have one time constant; the sensor has the oil's temperature; T_0 is the one when the
                effect is switched on
Valid range     decay_rate 0..10 1/s; steps of any length
Not modelled    resonance, sensitivity that changes with temperature, the time in which the sensor warms up
References      Janssens 2010, appendix C; law: plant_sim/blocks/icp_sensor.py
"""

from math import expm1

from plant_sim.blocks.icp_sensor import leak
from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import SENSORS


def fade(s, c, p, x, h):
    """Show the load without the part that has leaked."""
    if h > 0.0 and x.origin == 0.0:  # 0 K, at which no sensor is: the effect was switched on in this step
        x.origin = s.temperature
    load = s.sensed_clutch_torque
    if x.origin > 0.0:
        load += p.warming_load * (s.temperature - x.origin)
    share = -expm1(-0.5 * p.decay_rate * h)
    leaked = leak(x.leaked, load, share)  # over half a step: the load is that of mid-step
    s.sensed_clutch_torque = load - leaked
    x.leaked = leak(leaked, load, share)


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: fade},
    parameters=(
        Strength(
            "decay_rate", "1/s", off=0.0, typical=0.3912, bounds=(0.0, 10.0),
            source="[D] 98 % gone after 10 s, -ln(0.02)/10 s: what fig C.3 allows; appendix C prints no value",
        ),
        Strength(
            "warming_load", "Nm/K", off=0.0, typical=-0.05, bounds=(-5.0, 5.0),
            source="[D] sign of fig C.7, where a warm hand takes a quarter off 4 kg; the size was chosen here",
        ),
    ),
    states=(State("leaked", "Nm"), State("origin", "K")),
    display=Display("hold"),
)  # fmt: skip
