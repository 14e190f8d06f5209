"""Thermal lag of the oil-temperature sensor.

What            the probe takes time to reach the temperature of the oil
Equation        T_shown' = (T - T_shown) / time;  exact for a temperature held over the integration step
Assumptions     one lumped heat capacity and a constant heat transfer; probe and oil agree when the effect is switched on
Valid range     time 0..60 s
Not modelled    heat conducted along the probe, heat transfer that changes with the flow of the oil
References      Incropera, DeWitt, Bergman, Lavine 2007: Fundamentals of heat and mass transfer, sec. 5.1, lumped capacitance
"""

from math import exp

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import SENSORS


def follow(s, c, p, x, h):
    """Let the probe follow the oil."""
    oil = s.sensed_temperature
    if h > 0.0:
        if x.probe == 0.0:  # 0 K, at which no probe is: the effect was switched on in this step
            x.probe = oil
        x.probe = oil + (x.probe - oil) * exp(-h / p.time)
    if x.probe > 0.0:
        s.sensed_temperature = x.probe


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: follow},
    parameters=(
        Strength(
            "time", "s", off=0.0, typical=3.0, bounds=(0.0, 60.0),
            source="[D] a sheathed probe of 3 mm in slowly flowing oil: data sheets give seconds",
        ),
    ),
    states=(State("probe", "K"),),
    display=Display("hold"),
)  # fmt: skip
