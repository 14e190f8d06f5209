"""Gain of the valve and its amplifier off its nominal value.

What            set-up of the amplifier, magnet and spring differ from valve to valve
Equation        u = r k_v V
Assumptions     linear
Valid range     r 0.5..1.5
Not modelled    curvature of the characteristic, coil temperature
References      Merritt 1967, Hydraulic Control Systems, chapter 5 (valve coefficients and their tolerance)
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import COMMAND


def scale(s, c, p, x, h):
    """Scale the demand."""
    s.demand *= p.ratio


EFFECT = Effect(
    block="valve",
    laws={COMMAND: scale},
    parameters=(
        Strength(
            "ratio", "1", off=1.0, typical=0.99, bounds=(0.5, 1.5),
            source="[D] 1 %, 34 mbar at 3.4 bar; valve.gain itself is known to 2 % (docs/rig.md, 1)",
        ),
    ),
    rank=1,  # after the dead band, which is one of the amplifier's voltage
    display=Display("triangle", column="cylinder_pressure_bar"),
)  # fmt: skip
