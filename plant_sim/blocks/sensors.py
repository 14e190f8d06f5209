"""Sensors of the rig: state to raw counts, with noise before quantisation.

Equation        V = sensitivity (value + sigma n), n standard normal;  counts by `adc`                    (rig.md, 9)
                encoder counts = floor(theta counts_per_rev / 2 pi)
Assumptions     white noise, one draw a channel and sample, reproducible by seed
Not modelled    sensor dynamics, offset, drift, leakage of the piezo sensors (appendix C)
References      Janssens 2010, sec. 3.9.4; sensitivities and noise of rig.md
"""

from collections.abc import Iterator
from math import floor, pi
from typing import NamedTuple

import numpy as np

from plant_sim.blocks.adc import counts
from protocols.parameters import ParameterSet
from protocols.units import ZERO_CELSIUS

_BLOCK = 64  # samples drawn at once: cheaper than one by one, and short enough for a cycle (20 us)


class Counts(NamedTuple):
    """Raw counts of one sample, as the frames carry them."""

    pressure: int
    temperature: int
    motor_torque: int
    clutch_torque: int
    encoder: int


class Sensors:
    """Noise source and scalings of one rig; `seed` makes the noise reproducible."""

    def __init__(self, parameters: ParameterSet, seed: int) -> None:
        s = parameters.si("sensors")
        self._range = s["input_range"]
        self._pressure = s["pressure_sensitivity"], s["pressure_noise"], int(s["pressure_bits"])
        self._temperature = s["temperature_sensitivity"], s["temperature_noise"], int(s["temperature_bits"])
        self._motor = s["motor_torque_sensitivity"], s["torque_noise"], int(s["motor_torque_bits"])
        self._clutch = s["clutch_torque_sensitivity"], s["torque_noise"], int(s["clutch_torque_bits"])
        self._encoder = s["encoder_counts"] / (2.0 * pi)  # counts/rad
        self._noise = _normals(seed)

    def sample(
        self, pressure: float, temperature: float, motor_torque: float, clutch_torque: float, angle: float
    ) -> Counts:
        """Counts for pressure [Pa], temperature [K], torques [Nm] and angle [rad]."""
        a, b, c, d = next(self._noise)
        return Counts(
            self._convert(pressure, a, *self._pressure, 12),
            self._convert(temperature - ZERO_CELSIUS, b, *self._temperature, 12),
            self._convert(motor_torque, c, *self._motor, 12),
            self._convert(clutch_torque, d, *self._clutch, 16),
            (floor(angle * self._encoder) + 0x80000000 & 0xFFFFFFFF) - 0x80000000,
        )

    def _convert(self, value: float, noise: float, sensitivity: float, sigma: float, bits: int, field: int) -> int:
        return counts(sensitivity * (value + sigma * noise), self._range, bits, field)


def _normals(seed: int) -> Iterator[list[float]]:
    generator = np.random.default_rng(seed)
    while True:
        yield from generator.standard_normal((_BLOCK, 4)).tolist()
