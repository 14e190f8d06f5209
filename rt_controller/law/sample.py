"""A sample: sensor values of one tick in SI, from the two frames ANALOG_SENSORS and ENCODER (which has the motor).

Time is counted in ticks of the data acquisition, so jitter of the bus has no effect.
"""

import numpy as np
from numba import njit

from protocols.can.words import count_rise, count_turn, read_raw, read_value
from rt_controller.law.slip import observe

# The newest complete sample: tick (unwrapped, -1 before the first); pressure [Pa]; temperature [K]; motor_torque [Nm], without
# its known zero error, constant for motor_stuck [s]; slip [rad/s], acceleration [rad/s^2] and angle [rad] of the observer;
# speed [rad/s]: mean since the sample before, from the encoder alone; count: encoder count (unwrapped). analog: the first
# frame of the next sample has arrived, with the values next_.... applied [Nm]: torque applied to this clutch while its slip is
# constant, valid if known
SAMPLE = np.dtype(
    [("tick", "i8"), ("pressure", "f8"), ("temperature", "f8"), ("motor_torque", "f8"), ("motor_stuck", "f8"), ("slip", "f8"),
     ("speed", "f8"), ("acceleration", "f8"), ("count", "i8"), ("angle", "f8"), ("analog", "?"), ("next_pressure", "f8"),
     ("next_temperature", "f8"), ("applied", "f8"), ("known", "?")]
)  # fmt: skip


@njit
def take_analog(sample, pressure, temperature):
    """Store the values of ANALOG_SENSORS: pressure [Pa], temperature [K]."""
    sample.analog = True
    sample.next_pressure, sample.next_temperature = pressure, temperature


@njit
def take_encoder(sample, word, encoder, period, bandwidth, speed_demand, motor_zero):
    """Take the payload `word` of ENCODER; return the ticks since the sample before, 0 without a frame ANALOG_SENSORS before it.

    `encoder`: definition of the frame (`words.make_frame_layout`); period [s]; bandwidth [1/s] of the slip observer. The first
    sample starts the observer at `speed_demand` [rad/s], as the motor already has its speed when a run begins. `motor_zero`
    [Nm]: zero error of the motor torque signal.
    """
    if not sample.analog:
        return 0
    sample.analog = False
    angle_step, sample_tick = encoder.shaft_angle.scale, read_raw(word, encoder.sample_tick)
    counts = count_turn(read_raw(word, encoder.shaft_angle), sample.count, encoder.shaft_angle)
    sample.count += counts
    angle = sample.count * angle_step
    if sample.tick < 0:
        ticks, sample.tick = 1, sample_tick
        sample.angle, sample.slip, sample.speed, sample.acceleration = angle, speed_demand, speed_demand, 0.0
    else:
        ticks = count_rise(sample_tick, sample.tick, encoder.sample_tick)
        if ticks:
            sample.tick += ticks
            sample.speed = counts * angle_step / (ticks * period)
            sample.angle, sample.slip, sample.acceleration = observe(
                (sample.angle, sample.slip, sample.acceleration), angle, ticks * period, bandwidth
            )
    sample.pressure, sample.temperature = sample.next_pressure, sample.next_temperature
    motor_torque = read_value(word, encoder.motor_torque) - motor_zero
    stuck = motor_torque == sample.motor_torque
    sample.motor_stuck = sample.motor_stuck + ticks * period if stuck else 0.0
    sample.motor_torque = motor_torque
    return ticks
