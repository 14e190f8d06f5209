"""DC restoration of the clutch torque by the data acquisition.

What            the acquisition restores what a leaking piezo sensor has lost; where nothing leaks, it makes offsets grow
Equation        V_shown = V + z,  z' = decay_rate V, that is (s + a)/s;  V within the converter's range     (thesis, sec. C.2)
Assumptions     the sensor fades with the assumed decay_rate; a zero error V_0 becomes a ramp of slope decay_rate V_0.
                A decay rate that is wrong by the factor k turns a constant load F into F (k - (k - 1) exp(-t/tau))
Valid range     decay_rate 0..10 1/s; useful only with torque_sensor_leakage; what the converter cuts off is not restored
Not modelled    zeroing before a measurement: set torque_sensor_offset to the offset that remains
References      Janssens 2010, appendix C; law: plant_sim/blocks/dc_restoration.py
"""

from math import expm1

from plant_sim.blocks.dc_restoration import integrate_leak, restore_voltage
from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import ACQUISITION


def restore(s, c, p, x, h):
    """Add the part that has leaked."""
    taken = min(max(s.clutch_torque_voltage, -c.sensors_input_range), c.sensors_input_range)
    s.clutch_torque_voltage = restore_voltage(taken, x.integral)
    x.integral = integrate_leak(x.integral, taken, -expm1(-p.decay_rate * h))


EFFECT = Effect(
    block="sensors",
    laws={ACQUISITION: restore},
    rank=30,
    candidate=False,
    parameters=(
        Strength(
            "decay_rate", "1/s", off=0.0, typical=0.3912, bounds=(0.0, 10.0),
            source="[D] a = -ln(0.02)/t_98 of sec. C.2 with t_98 = 10 s, as torque_sensor_leakage leaks",
        ),
    ),
    states=(State("integral", "V"),),
    display=Display("hold", column="clutch_torque_nm", beside="torque_sensor_leakage"),
)  # fmt: skip
