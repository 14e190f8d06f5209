"""Anti-alias filter before the converter.

What            a low pass of second order on each analog channel: frequencies above half the sample rate do not cause aliasing
Equation        u_shown'' + sqrt(2) w u_shown' + w^2 u_shown = w^2 u,  w = 2 pi corner: Butterworth, -3 dB at the corner
                a slow signal comes late by sqrt(2)/w
                exact for an input that is linear over the integration step
Assumptions     one corner for all four channels; the filter has settled when the effect is switched on
Valid range     corner 20..5000 Hz; inserted 0 (bypassed) or 1 (in the line), between them a blend for a smooth change
Not modelled    tolerance of the corner by channel; the noise of docs/rig.md, 9, is that of the converter, after the filter
References      Butterworth 1930: On the theory of filter amplifiers, Experimental Wireless 7
"""

from math import cos, exp, pi, sin, sqrt

from numba import njit

from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import SENSORS


@njit(inline="always")
def low_pass(shown, rate, begin, slope, lag, h, decay, cosine, sine):
    """Output and its rate after a step h of an input that rises from `begin` with `slope`; poles at (-1 +- j)/lag."""
    off, off_rate = shown - (begin - slope * lag), rate - slope  # from the steady response to this ramp
    return (
        begin + slope * (h - lag) + decay * (off * (cosine + sine) + off_rate * lag * sine),
        slope + decay * (off_rate * (cosine - sine) - 2.0 * off / lag * sine),
    )


def smooth(s, c, p, x, h):
    """Filter every channel."""
    pressure, temperature = s.sensed_pressure, s.sensed_temperature
    motor, clutch = s.sensed_motor_torque, s.sensed_clutch_torque
    motor_before, clutch_before = x.motor_torque, x.clutch_torque
    if h > 0.0:
        if x.begun == 0.0:
            x.begun = 1.0
            x.pressure = x.last_pressure = pressure
            x.temperature = x.last_temperature = temperature
            x.motor_torque = x.last_motor = motor_before = motor
            x.clutch_torque = x.last_clutch = clutch_before = clutch
        lag = 1.0 / (pi * sqrt(2.0) * p.corner)  # sqrt(2)/w
        decay, cosine, sine = exp(-h / lag), cos(h / lag), sin(h / lag)
        slope = (pressure - x.last_pressure) / h
        x.pressure, x.pressure_rate = low_pass(
            x.pressure, x.pressure_rate, x.last_pressure, slope, lag, h, decay, cosine, sine
        )
        slope = (temperature - x.last_temperature) / h
        x.temperature, x.temperature_rate = low_pass(
            x.temperature, x.temperature_rate, x.last_temperature, slope, lag, h, decay, cosine, sine
        )
        slope = (motor - x.last_motor) / h  # torques are those of mid-step: the step begins half a step before
        x.motor_torque, x.motor_rate = low_pass(
            x.motor_torque, x.motor_rate, motor - 0.5 * slope * h, slope, lag, h, decay, cosine, sine
        )
        slope = (clutch - x.last_clutch) / h
        x.clutch_torque, x.clutch_rate = low_pass(
            x.clutch_torque, x.clutch_rate, clutch - 0.5 * slope * h, slope, lag, h, decay, cosine, sine
        )
        x.last_pressure, x.last_temperature = pressure, temperature
        x.last_motor, x.last_clutch = motor, clutch
    if x.begun > 0.0:
        s.sensed_pressure += p.inserted * (x.pressure - pressure)
        s.sensed_temperature += p.inserted * (x.temperature - temperature)
        # torques at mid-step, as they come in; at a sample (h = 0) both values are equal
        s.sensed_motor_torque += p.inserted * (0.5 * (motor_before + x.motor_torque) - motor)
        s.sensed_clutch_torque += p.inserted * (0.5 * (clutch_before + x.clutch_torque) - clutch)


EFFECT = Effect(
    block="sensors",
    laws={SENSORS: smooth},
    rank=30,
    parameters=(
        Strength(
            "inserted", "1", off=0.0, typical=1.0, bounds=(0.0, 1.0),
            source="[D] in the line or not",
        ),
        Shape(
            "corner", "Hz", typical=400.0, bounds=(20.0, 5000.0),
            source="[D] 0.4 of the sample rate of 1 kHz",
        ),
    ),
    states=(
        State("begun", "1"),
        State("pressure", "Pa"),
        State("pressure_rate", "Pa/s"),
        State("last_pressure", "Pa"),
        State("temperature", "K"),
        State("temperature_rate", "K/s"),
        State("last_temperature", "K"),
        State("motor_torque", "Nm"),
        State("motor_rate", "Nm/s"),
        State("last_motor", "Nm"),
        State("clutch_torque", "Nm"),
        State("clutch_rate", "Nm/s"),
        State("last_clutch", "Nm"),
    ),
)  # fmt: skip
