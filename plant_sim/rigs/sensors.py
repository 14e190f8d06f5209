"""Sensors of the rig behind its data acquisition: state to raw counts, with noise before quantisation.

Equation        V = sensitivity (value + sigma n), n standard normal;  counts by `adc`          (docs/rig.md, eq. 9)
                encoder counts by `encoder`
Assumptions     white noise, one draw a channel and sample, reproducible by seed; all channels at one instant
Valid range     +-10 V
Not modelled    sensor dynamics, offset, drift, leakage, filters, skew: they are effects (plant_sim/effects)
References      Janssens 2010, sec. 3.9.4; sensitivities and noise: docs/rig.md, eq. 9
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

from plant_sim.blocks import adc, encoder
from plant_sim.effects.signals import ACQUISITION, SIGNALS, bind_laws, call, has_law, set_known
from protocols.can.frames import load_frames
from protocols.files.units import ZERO_CELSIUS

_NOISE_BLOCK = 64  # samples of noise drawn at once: faster than one by one, and short enough for a cycle (20 us)
# Bits of the frames' fields, in which counts are left-justified; constants of the compiled code
_PRESSURE_BITS, _TEMPERATURE_BITS, _CLUTCH_TORQUE_BITS = (
    load_frames()["ANALOG_SENSORS"].bits[name] for name in ("cylinder_pressure", "oil_temperature", "clutch_torque")
)
_MOTOR_TORQUE_BITS = load_frames()["ENCODER"].bits["motor_torque"]
_ANGLE_BITS = 32  # of the counter in the data acquisition; the frame has the low ones


class Counts(NamedTuple):
    """Raw counts of one sample, as the frames carry them."""

    pressure: int
    temperature: int
    motor_torque: int
    clutch_torque: int
    encoder: int


class Scales(NamedTuple):
    """Parameters of the data acquisition, SI units, under their names in the rig's record."""

    sensors_input_range: float
    sensors_pressure_sensitivity: float
    sensors_pressure_bits: float
    sensors_pressure_noise: float
    sensors_temperature_sensitivity: float
    sensors_temperature_bits: float
    sensors_temperature_noise: float
    sensors_motor_torque_sensitivity: float
    sensors_motor_torque_bits: float
    sensors_clutch_torque_sensitivity: float
    sensors_clutch_torque_bits: float
    sensors_torque_noise: float
    sensors_encoder_counts: float


class Sensors:
    """Noise source of one rig; `seed` makes the noise reproducible."""

    def __init__(self, seed: int) -> None:
        self._noise = _draw_noise(seed)

    def sample(self, rig: Any, state: Any, interval: float, y: Any = None) -> tuple[Counts, Any]:
        """Sample a rig's `state`: return the counts, and the state with its effects advanced.

        interval: time since the last sample [s]. y: `state.read()`, where the caller already has it.
        """
        effects, noise = rig.table.kernel, next(self._noise)
        if effects is None:
            y = y or state.read()
            sensed = y.sensed_pressure, y.sensed_temperature, y.sensed_motor_torque, y.sensed_clutch_torque
            # plain Python takes 15.5 us, a compiled call 18 us with the cold CPU caches of a cycle of 1 ms
            channels = voltages(*sensed, noise, rig.scales)
            return Counts._make(_counts(*channels, y.angle, rig.scales)), state  # type: ignore[call-arg]
        counts, states = acquire(state.y, state.effects, noise, rig.record, effects, interval)
        return Counts._make(counts), state._replace(effects=states)


@register_jitable(inline="always")
def voltages(pressure, kelvin, motor, clutch, noise, c):
    """Return the voltages at the converters for sensor values [Pa, K, Nm, Nm] and four standard normal numbers."""
    return (
        c.sensors_pressure_sensitivity * (pressure + c.sensors_pressure_noise * noise[0]),
        c.sensors_temperature_sensitivity * (kelvin - ZERO_CELSIUS + c.sensors_temperature_noise * noise[1]),
        c.sensors_motor_torque_sensitivity * (motor + c.sensors_torque_noise * noise[2]),
        c.sensors_clutch_torque_sensitivity * (clutch + c.sensors_torque_noise * noise[3]),
    )


@register_jitable(inline="always")
def _counts(pressure, temperature, motor, clutch, angle, c):
    """Return the counts for voltages [V] and the encoder's angle [rad]."""
    full = c.sensors_input_range
    return (
        adc.counts(pressure, full, int(c.sensors_pressure_bits), _PRESSURE_BITS),
        adc.counts(temperature, full, int(c.sensors_temperature_bits), _TEMPERATURE_BITS),
        adc.counts(motor, full, int(c.sensors_motor_torque_bits), _MOTOR_TORQUE_BITS),
        adc.counts(clutch, full, int(c.sensors_clutch_torque_bits), _CLUTCH_TORQUE_BITS),
        encoder.counts(angle, c.sensors_encoder_counts, _ANGLE_BITS),
    )


@njit(cache=True, error_model="numpy")
def acquire(rig_state, states_before, noise, parameters, effects, interval):
    """Return the counts of one sample, and the effects' states after it; noise (4,) standard normal numbers, interval [s]."""
    states = states_before.copy()
    signals = np.zeros(1, SIGNALS)
    y, c, s = rig_state[0], parameters[0], signals[0]
    e = bind_laws(effects, states)
    pressure, temperature, motor, clutch = voltages(
        y.sensed_pressure, y.sensed_temperature, y.sensed_motor_torque, y.sensed_clutch_torque,
        noise, c,
    )  # fmt: skip
    angle = y.angle
    set_known(e, s, y)
    if has_law(ACQUISITION, e):
        s.pressure_voltage, s.temperature_voltage = pressure, temperature
        s.motor_torque_voltage, s.clutch_torque_voltage, s.encoder_angle = motor, clutch, angle
        call(ACQUISITION, e, s, c, interval)
        pressure, temperature = s.pressure_voltage, s.temperature_voltage
        motor, clutch, angle = s.motor_torque_voltage, s.clutch_torque_voltage, s.encoder_angle
    return _counts(pressure, temperature, motor, clutch, angle, c), states


def _draw_noise(seed: int) -> Iterator[tuple[float, float, float, float]]:
    generator = np.random.default_rng(seed)
    while True:
        yield from map(tuple, generator.standard_normal((_NOISE_BLOCK, 4)).tolist())
