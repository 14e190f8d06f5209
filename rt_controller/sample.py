"""A sample: what the sensors said at one tick, in SI, put together from its two frames."""

from typing import Any

from protocols.units import BAR, ZERO_CELSIUS
from rt_controller.slip import observe

_ANGLE_WRAP = 1 << 32  # counts of the encoder's counter
_TICK_WRAP = 1 << 16


class Sample:
    """The newest complete sample. Time comes from the ticks of the data acquisition, so bus jitter does not enter.

    period [s]; bandwidth of the slip observer [1/s]; temperature until one is measured [K]; angle_step [rad/count].

    `bandwidth` may be changed between samples. tick (unwrapped, -1 before the first), pressure [Pa], temperature [K],
    motor_torque [Nm], unchanged by a count for motor_stuck [s], slip [rad/s], acceleration [rad/s^2].
    """

    def __init__(self, period: float, bandwidth: float, temperature: float, angle_step: float) -> None:
        self.tick = -1
        self.pressure = self.motor_torque = self.motor_stuck = self.slip = self.acceleration = 0.0
        self.temperature = temperature
        self._period, self.bandwidth, self._angle_step = period, bandwidth, angle_step
        self._analog: Any = None  # half a sample: its encoder frame has not come yet
        self._count = 0  # encoder, unwrapped
        self._observer = (0.0, 0.0, 0.0)

    def analog(self, values: Any) -> None:
        """Take the physical values of ANALOG_SENSORS."""
        self._analog = values

    def encoder(self, raw: Any, speed_demand: float) -> int:
        """Take the raw values of ENCODER; return the ticks since the sample before, 0 while the analog half is missing.

        The first sample starts the slip observer at `speed_demand` [rad/s]: the motor holds its speed when a run begins.
        """
        analog, self._analog = self._analog, None
        if analog is None:
            return 0
        self._count += (raw.shaft_angle - self._count + _ANGLE_WRAP // 2) % _ANGLE_WRAP - _ANGLE_WRAP // 2
        angle = self._count * self._angle_step
        if self.tick < 0:
            ticks, self.tick = 1, raw.sample_tick
            self._observer = (angle, speed_demand, 0.0)
        elif ticks := (raw.sample_tick - self.tick) % _TICK_WRAP:
            self.tick += ticks
            self._observer = observe(self._observer, angle, ticks * self._period, self.bandwidth)
        _, self.slip, self.acceleration = self._observer
        self.pressure = analog.cylinder_pressure * BAR
        self.temperature = analog.oil_temperature + ZERO_CELSIUS
        self.motor_stuck = self.motor_stuck + ticks * self._period if analog.motor_torque == self.motor_torque else 0.0
        self.motor_torque = analog.motor_torque
        return ticks
