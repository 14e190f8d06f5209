"""Saturation of a sensor's amplifier.

What            the amplifier of the pressure or the clutch-torque channel saturates within the converter's range
Equation        V_shown = min(max(V, -limit), limit), after the noise
Assumptions     sharp limits, symmetric; it recovers without delay
Valid range     limit 0.1..20 V; at 20 V, beyond the range of any converter here, it cuts nothing
Not modelled    the bend before the limit; the limit at 0 V of an amplifier with one supply
References      Janssens 2010, sec. 3.9.4: +-10 V at the converter
"""

from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import ACQUISITION
from plant_sim.effects.start import ChannelEnds


def saturate(s, c, p, x, h):
    """Limit both channels."""
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
