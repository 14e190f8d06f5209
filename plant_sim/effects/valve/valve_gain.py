"""Gain of the valve and its amplifier off its nominal value, drifting in time.

What            set-up of the amplifier, magnet and spring differ from valve to valve; amplifier and coil warm up
Equation        u = max(r + drift t, 0) k_v V, t since the effect was switched on
Assumptions     linear; the drift is slow against a run
Valid range     r 0.5..1.5
Not modelled    curvature of the characteristic; the end of the warming
References      Merritt 1967, Hydraulic Control Systems, chapter 5 (valve coefficients and their tolerance)
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import COMMAND


def scale(s, c, p, x, h):
    """Scale the demand."""
    x.drifted += p.drift * h
    s.demand *= max(p.ratio + x.drifted, 0.0)


EFFECT = Effect(
    block="valve",
    laws={COMMAND: scale},
    parameters=(
        Strength(
            "ratio", "1", off=1.0, typical=0.99, bounds=(0.5, 1.5),
            source="[D] 1 %, 34 mbar at 3.4 bar; valve.gain itself is known to 2 % (docs/rig.md, 1)",
        ),
        Strength(
            "drift", "1/s", off=0.0, typical=-3e-4, bounds=(-0.1, 0.1),
            source="[D] 3 % in 100 s: copper has 0.4 %/K, so a coil at constant voltage that warms by 7.5 K",
        ),
    ),
    states=(State("drifted", "1"),),
    rank=1,  # after the dead band, which is one of the amplifier's voltage
    display=Display("triangle", column="cylinder_pressure_bar"),
)  # fmt: skip
