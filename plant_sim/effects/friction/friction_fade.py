"""Friction fades with the heat at the interface and recovers.

What            while the plates slip, lining and plate surface become hotter than the oil: the torque falls; later it recovers
Equation        dQ/dt = |M omega| - Q/tau;  M = M_0 (1 - k Q);  k = a/C_i, tau = C_i/G: with the fall of friction a [1/K], the
                surface's heat capacity C_i [J/K] and its conductance to the oil G [W/K]; torque shows only k and tau
Assumptions     one thermal node between friction and oil, Q/C_i warmer than the oil; Coulomb and viscous part fade alike
Integration     exact at constant power: the rate is k |M_0 omega| + 1/tau
Valid range     k Q < 1, which the law keeps
Not modelled    the delay that the node gives to the heating of the oil, distribution over the plates, burnt lining
References      Maki 2005, Wet clutch tribology, Lulea (the temperature of the interface determines its friction);
                [D] values: 2 mm of steel plate on 62 cm^2 store 50 J/K; where friction falls by 0.3 %/K, as in
                coulomb_temperature, k is 6e-5 1/J
"""

from math import expm1

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import TORQUE


def fade(s, c, p, x, h):
    """Reduce the torque by the heat at the interface."""
    power = abs(s.torque * s.slip)  # W, of the torque without fade
    rate = p.fade * power + 1.0 / p.recovery
    settled, gone = power / rate, -expm1(-0.5 * h * rate)
    middle = x.heat + (settled - x.heat) * gone
    x.heat = middle + (settled - middle) * gone
    s.torque *= max(1.0 - p.fade * middle, 0.0)


EFFECT = Effect(
    block="friction",
    laws={TORQUE: fade},
    parameters=(
        Strength("fade", "1/J", off=0.0, typical=6e-5, bounds=(0.0, 0.01), source="[D] 0.3 %/K over 50 J/K"),
        Shape(
            "recovery", "s", typical=4.0, bounds=(0.05, 100.0),
            source="[D] 50 J/K over 12 W/K: both faces to the oil in their grooves at 1000 W/(m^2 K)",
        ),
    ),
    states=(State("heat", "J"),),
    rank=20,  # after the effects that change sliding friction: the heat is that of all of it
    display=Display("hold", column="clutch_torque_nm"),
)  # fmt: skip
