"""Saturation of a sensor's amplifier.

What            the amplifier of the pressure or the clutch-torque channel ends below the converter's range
Equation        V_shown = min(max(V, -limit), limit), after the noise
Assumptions     hard ends, symmetric; no time to recover
Valid range     limit 0.1..20 V; 20 V is the widest converter there is, so it never binds
Not modelled    the bend before the end; which end an amplifier with one supply has at 0 V
References      Janssens 2010, sec. 3.9.4: +-10 V at the converter
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import ACQUISITION
from plant_sim.effects.start import ChannelEnds


def saturate(s, c, p, x, h):
    """Cut both channels."""
    s.pressure_voltage = min(max(s.pressure_voltage, -p.pressure_limit), p.pressure_limit)
    s.clutch_torque_voltage = min(max(s.clutch_torque_voltage, -p.torque_limit), p.torque_limit)


EFFECT = Effect(
    block="sensors",
    laws={ACQUISITION: saturate},
    rank=10,
    parameters=(
        Strength(
            "pressure_limit", "V", off=20.0, typical=3.3, bounds=(0.1, 20.0),
            source="[D] amplifier on a single 3.3 V supply: 3.3 bar at 1 V/bar, within the rig's 2.7..4.2 bar",
        ),
        Strength(
            "torque_limit", "V", off=20.0, typical=3.3, bounds=(0.1, 20.0),
            source="[D] the same amplifier: 16.5 Nm at 0.2 V/Nm, within the rig's 0..30 Nm",
        ),
    ),
    start=ChannelEnds({"pressure_limit": "cylinder_pressure_bar", "torque_limit": "clutch_torque_nm"}),
)  # fmt: skip
