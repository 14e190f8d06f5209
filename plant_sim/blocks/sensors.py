"""Sensors of the rig behind its data acquisition: state to raw counts, with noise before quantisation.

Equation        V = sensitivity (value + sigma n), n standard normal;  counts by `adc`                    (rig.md, 9)
                encoder counts by `encoder`
Assumptions     white noise, one draw a channel and sample, reproducible by seed; all channels at one instant
Valid range     +-10 V
Not modelled    sensor dynamics, offset, drift, leakage, filters, skew: they are effects (plant_sim/effects)
References      Janssens 2010, sec. 3.9.4; sensitivities and noise of rig.md
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from plant_sim.blocks import adc, encoder
from plant_sim.effects.signals import ACQUISITION, SIGNALS, attached, bound, call, known
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
    """Noise source of one rig; `seed` makes the noise reproducible."""

    def __init__(self, seed: int) -> None:
        self._noise = _normals(seed)

    def sample(self, rig: Any, state: Any, interval: float) -> tuple[Counts, Any]:
        """Counts of a rig's `state`, and the state with those of its effects moved on; `interval` [s] since the last sample."""
        effects = rig.table.kernel
        counts, states = acquire(state.y, state.effects, next(self._noise), rig.record, effects, interval)
        return Counts._make(counts), state if effects is None else state._replace(effects=states)


@njit(cache=True, error_model="numpy")
def acquire(rig_state, states_before, noise, parameters, effects, interval):
    """Counts of one sample, and the effects' states after it. noise: 4 standard normal numbers; interval [s]."""
    states = states_before.copy()
    signals = np.zeros(1, SIGNALS)
    y, c, s = rig_state[0], parameters[0], signals[0]
    e = bound(effects, states)
    pressure = c.sensors_pressure_sensitivity * (y.sensed_pressure + c.sensors_pressure_noise * noise[0])
    celsius = y.sensed_temperature - ZERO_CELSIUS
    temperature = c.sensors_temperature_sensitivity * (celsius + c.sensors_temperature_noise * noise[1])
    motor = c.sensors_motor_torque_sensitivity * (y.sensed_motor_torque + c.sensors_torque_noise * noise[2])
    clutch = c.sensors_clutch_torque_sensitivity * (y.sensed_clutch_torque + c.sensors_torque_noise * noise[3])
    angle = y.angle
    if attached(ACQUISITION, e):
        known(e, s, y)
        s.pressure_voltage, s.temperature_voltage = pressure, temperature
        s.motor_torque_voltage, s.clutch_torque_voltage, s.encoder_angle = motor, clutch, angle
        call(ACQUISITION, e, s, c, interval)
        pressure, temperature = s.pressure_voltage, s.temperature_voltage
        motor, clutch, angle = s.motor_torque_voltage, s.clutch_torque_voltage, s.encoder_angle
    full = c.sensors_input_range
    counts = (
        adc.counts(pressure, full, int(c.sensors_pressure_bits), 12),
        adc.counts(temperature, full, int(c.sensors_temperature_bits), 12),
        adc.counts(motor, full, int(c.sensors_motor_torque_bits), 12),
        adc.counts(clutch, full, int(c.sensors_clutch_torque_bits), 16),
        encoder.counts(angle, c.sensors_encoder_counts),
    )
    return counts, states


def _normals(seed: int) -> Iterator[np.ndarray]:
    generator = np.random.default_rng(seed)
    while True:
        yield from generator.standard_normal((_BLOCK, 4))
