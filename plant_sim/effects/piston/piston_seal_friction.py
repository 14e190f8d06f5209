"""Friction of the seal rings on the piston, with pre-sliding.

What            the seals resist the piston, like a spring before they slide: torque over pressure becomes a loop
Equation        dF = k dx while |F| < W, else |F| = W;  W = W_0 + W_p p,  k = W / x_s
                (one Maxwell-slip element, thesis sec. 5.2)
Assumptions     break-away force independent of speed; it grows with W_p, since the oil presses a lip seal on
Valid range     W 0..1000 N
Not modelled    Stribeck effect of the lip, stick time, memory of the pressure within the lip
References      Janssens 2010, fig 6.11: offered as the first cause of the direction-dependent torque over pressure;
                Flitney 2014, Seals and Sealing Handbook (lip seals: friction grows with pressure)
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import PISTON
from plant_sim.friction.maxwell_slip import element


def resist(s, c, p, x, h):
    """Add the force of the seals against the piston's motion."""
    limit = p.force + p.pressure_slope * s.pressure
    x.force = element(x.force, s.displacement, limit / p.travel, limit)
    s.piston_force += x.force


_HELD = 2.5 / 2.0  # the force is held over a step: stable up to a rate of 2/step, where the rig allows 2.5/step


def rate(p, c):
    """Stiffness of the seals at full supply pressure over the damping of the piston [1/s]."""
    stiffness = (p["force"] + p["pressure_slope"] * c["valve_supply_pressure"]) / p["travel"]
    return _HELD * stiffness / c["piston_damping"]


EFFECT = Effect(
    block="piston",
    laws={PISTON: resist},
    parameters=(
        Strength(
            "force", "N", off=0.0, typical=40.0, bounds=(0.0, 1000.0),
            source="[D] with the slope 60 N at 3.4 bar: the loop of Janssens 2010, fig 6.11, about 0.1 bar wide",
        ),
        Strength(
            "pressure_slope", "N/bar", off=0.0, typical=6.0, bounds=(0.0, 40.0),
            source="[D] two lips of 1.1 m together, 1 mm wide, friction coefficient 0.05",
        ),
        Shape(
            "travel", "m", typical=5.0e-6, bounds=(1e-6, 1e-3),
            source="[D] pre-sliding travel of an elastomer lip",
        ),
    ),
    states=(State("force", "N"),),
    rate=rate,
    display=Display("triangle", column="clutch_torque_nm", over="cylinder_pressure_bar"),
)  # fmt: skip
