"""Channel-to-channel skew of a multiplexed converter.

What            one converter takes the channels one after the other: pressure, temperature, motor torque, clutch torque
Equation        channel i of 0..3 shows u_i(t - (3 - i) interval), linear between integration steps
Assumptions     the frame leaves when the last channel is converted: that one is up to date, the first is three intervals old;
                encoder counts are latched with the frame
Valid range     interval 0..300 us
Not modelled    charge carried from one channel to the next by the multiplexer
References      Measurement Computing, PCI-DAS1602/12 user's guide: 3 us between channels in a burst, a quarter of the cycle
                without; law: plant_sim/blocks/delay_line.py
"""

from plant_sim.blocks.delay_line import AT_END, AT_MID_STEP, begin_step, read_delayed
from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import SENSORS


def stagger(s, c, p, x, h):
    """Show each channel as it was when it was converted."""
    begin_step(x, h)
    s.sensed_pressure = read_delayed(x.pressure, x, s.sensed_pressure, 3.0 * p.interval, AT_END, h)
    s.sensed_temperature = read_delayed(x.temperature, x, s.sensed_temperature, 2.0 * p.interval, AT_END, h)
    s.sensed_motor_torque = read_delayed(x.motor_torque, x, s.sensed_motor_torque, p.interval, AT_MID_STEP, h)


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: stagger},
    rank=50,
    candidate=False,
    parameters=(
        Strength(
            "interval", "us", off=0.0, typical=250.0, bounds=(0.0, 300.0),
            source="PCI-DAS1602/12 user's guide: four channels evenly over a cycle of 1 ms; 3 us in its burst mode",
        ),
    ),
    states=(
        State("pressure", "Pa", 32),
        State("temperature", "K", 32),
        State("motor_torque", "Nm", 32),
        State("taken", "1"),
        State("step", "s"),
    ),
)  # fmt: skip
