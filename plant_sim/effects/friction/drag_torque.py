"""Drag of the open clutch.

What            the oil in the gap is sheared while the plates do not touch
Equation        M = M_0 + d omega eta(T)/eta_ref (x_c + g)/(x_c - x + g) w,  w = 1 open, w = max(1 - p_n/0.35 bar, 0) pressed
                d = 2 N pi eta_ref r_m^3 B/gap at rest, laminar Couette flow in N gaps of width B at radius r_m
Assumptions     all gaps are equal and full of oil; g is the effective gap at touch, which waviness keeps open; the drag is
                continuous at touch. It is 0 from 2.7 bar on: there the maps of Table 6.4 begin, which contain the shear of
                the pressed film
Valid range     low speed, before air enters the gap
Not modelled    the peak and fall of drag at high speed as air enters, flow of oil, tilting
References      Iqbal, Al-Bender, Pluymers and Desmet 2013, ISRN Tribology 206539; Kitabayashi, Li and Hiraki 2003,
                SAE 2003-01-1973
"""

from plant_sim.blocks.viscosity import relative_viscosity
from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, Strength
from plant_sim.effects.signals import TORQUE

_MAPS_BEGIN = 0.35e5  # Pa over contact pressure: 2.7 bar less 2.35 bar, Janssens 2010, Tables 6.3 and 6.4


def shear(s, c, p, x, h):
    """Add the drag of the oil in the gap."""
    open_share = 1.0
    if s.contact > 0.0:
        open_share -= (s.friction_pressure - c.piston_contact_pressure) / _MAPS_BEGIN
        if open_share <= 0.0:
            return
    gap = max(c.piston_clearance - s.position, 0.0)
    closeness = (c.piston_clearance + p.gap) / (gap + p.gap)
    s.torque += p.drag * s.slip * closeness * open_share * relative_viscosity(s.temperature, c.oil_reference)


EFFECT = Effect(
    block="friction",
    laws={TORQUE: shear},
    parameters=(
        Strength(
            "drag", "Nm/(rad/s)", off=0.0, typical=0.015, bounds=(0.0, 10.0),
            source="[D] a pack of ten plates with gaps of 0.35 mm at 12 mPa s; the one plate of Janssens 2010 would have 0.001;"
            " 0.5 is a lot, and 20 times it on the largest rigs",
        ),
        Shape("gap", "mm", typical=0.2, bounds=(0.02, 2.0), source="[D] waviness of plates, and oil between them"),
    ),
    rank=30,  # after the effects that scale the friction: drag is no part of it
    display=Display("engagement", column="clutch_torque_nm"),
)  # fmt: skip
