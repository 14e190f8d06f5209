"""Open-loop excitations of the rig that show an effect, and the measured response of the rig to them."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from plant_sim.rigs import wet_clutch
from plant_sim.rigs.sensors import Sensors
from protocols.can.frames import load_frames
from protocols.files.parameters import ParameterSet
from protocols.files.units import ZERO_CELSIUS

PERIOD = 1e-3  # s, period of samples and inputs
QUANTITIES: Mapping[str, tuple[str, str, float]] = {  # column of docs/rig.md: what, unit, resolution
    # resolution: standard deviation of noise and quantisation (docs/rig.md, 9); for the slip: of the encoder over one period
    "clutch_torque_nm": ("clutch torque", "Nm", 0.05),
    "cylinder_pressure_bar": ("cylinder pressure", "bar", 0.0053),
    "slip_speed_rad_s": ("slip speed", "rad/s", 0.016),
    "oil_temperature_degc": ("oil temperature", "degC", 0.104),
    "motor_torque_nm": ("motor torque", "Nm", 0.051),
    "shaft_angle_rad": ("shaft angle", "rad", 1.1e-5),
}
INPUTS: Mapping[str, tuple[str, str]] = {  # column of docs/rig.md: what, unit
    "valve_voltage_v": ("valve voltage", "V"),
    "motor_speed_demand_rad_s": ("speed demand", "rad/s"),
}
_SUBSTEPS = round(PERIOD / wet_clutch.STEP_LIMIT)
_NOISE_FREE = {f"sensors.{name}_noise": 0.0 for name in ("pressure", "temperature", "torque")}
_BAR_PER_VOLT = 2.5  # docs/rig.md, 1
_PRESSED_VOLTAGE = 3.4 / _BAR_PER_VOLT  # V, at which most figures of chapter 6 were measured


@dataclass(frozen=True, eq=False)
class Excitation:
    """Valve voltage [V] and speed demand [rad/s], each (n,), one value per PERIOD.

    settling: number of initial samples whose response is not compared. celsius: initial oil temperature [degC].
    filled: whether the piston starts at the plates; otherwise it starts at rest. over: column on the horizontal axis of its
    plot.
    """

    title: str
    voltage: np.ndarray
    speed: np.ndarray
    settling: int = 0
    celsius: float = 70.0
    filled: bool = True
    over: str = "time_s"


def answer(
    parameters: ParameterSet, excitation: Excitation, later: tuple[int, ParameterSet] | None = None
) -> dict[str, np.ndarray]:
    """Simulate a rig with `parameters`; return what the data acquisition measures without noise: columns of docs/rig.md (n,).

    later: index of a sample, and the parameters from that sample on.
    """
    rig = wet_clutch.Rig(parameters.with_values(_NOISE_FREE))
    begin = rig.fill if excitation.filled else rig.make_rest_state
    state = begin(excitation.speed[0], excitation.celsius + ZERO_CELSIUS)
    sensors, limit = Sensors(1), parameters["motor.torque_limit"].si
    samples = np.empty((len(excitation.voltage), 5))
    for k, (voltage, speed) in enumerate(zip(excitation.voltage.tolist(), excitation.speed.tolist(), strict=True)):
        if later and later[0] == k:
            before, rig = rig, wet_clutch.Rig(later[1].with_values(_NOISE_FREE))
            state = state._replace(effects=rig.table.carry_over(state.effects, before.table))
        counts, state = sensors.sample(rig, state, PERIOD)
        samples[k] = counts
        state = rig.advance(state, voltage, speed, limit, PERIOD, _SUBSTEPS)
    return _make_columns(samples, excitation)


def _make_columns(samples: np.ndarray, excitation: Excitation) -> dict[str, np.ndarray]:
    frames = load_frames()
    scale = frames["ANALOG_SENSORS"].scale | frames["ENCODER"].scale
    names = ("cylinder_pressure", "oil_temperature", "motor_torque", "clutch_torque", "shaft_angle")
    pressure, temperature, motor, clutch, angle = (samples[:, i] * scale[name] for i, name in enumerate(names))
    return {
        "time_s": PERIOD * np.arange(len(samples)),
        "valve_voltage_v": excitation.voltage,
        "motor_speed_demand_rad_s": excitation.speed,
        "cylinder_pressure_bar": pressure,
        "slip_speed_rad_s": np.gradient(angle, PERIOD),
        "shaft_angle_rad": angle,
        "oil_temperature_degc": temperature,
        "clutch_torque_nm": clutch,
        "motor_torque_nm": motor,
    }


def _make_engagement(celsius: float) -> Excitation:
    voltage = np.concatenate([np.full(450, _PRESSED_VOLTAGE), np.zeros(300)])
    title = f"step to 3.4 bar and release, 20 rad/s, {celsius:g} degC"
    return Excitation(title, voltage, np.full(len(voltage), 20.0), celsius=celsius, filled=False)


def _make_triangle() -> Excitation:
    up = np.linspace(2.4, 4.2, 1500)
    # the first loop starts from another state than the next
    pressure = np.concatenate([np.full(300, 2.4), up, up[::-1], up, up[::-1]])
    return Excitation(
        "triangle of 2.4 to 4.2 bar, 1.5 s each way, 20 rad/s",
        pressure / _BAR_PER_VOLT, np.full(len(pressure), 20.0), settling=300 + 3000, over="valve_voltage_v",
    )  # fmt: skip


def _make_slip_sine(amplitude: float, hertz: float) -> Excitation:
    period = round(1.0 / (hertz * PERIOD))
    speed = amplitude * np.cos(2.0 * np.pi / period * np.arange(period + 3000 // period * period))
    return Excitation(
        f"slip sine of {amplitude:g} rad/s, {hertz:g} Hz, 3.4 bar",
        np.full(len(speed), _PRESSED_VOLTAGE), speed, settling=len(speed) - period, over="motor_speed_demand_rad_s",
    )  # fmt: skip


def _make_slip_steps() -> Excitation:
    speed = np.concatenate([np.full(600, 5.0), np.full(200, 15.0), np.full(200, 5.0)])
    return Excitation("slip steps 5, 15, 5 rad/s, 3.4 bar", np.full(len(speed), _PRESSED_VOLTAGE), speed, settling=550)


def _make_crawl() -> Excitation:
    return Excitation("slip of 4 rad/s, 3.4 bar", np.full(2200, _PRESSED_VOLTAGE), np.full(2200, 4.0), settling=600)


def _hold() -> Excitation:
    voltage = np.concatenate([np.full(12000, _PRESSED_VOLTAGE), np.zeros(1000)])
    return Excitation(
        "12 s of 3.4 bar and 20 rad/s from 50 degC on, then released",
        voltage, np.full(len(voltage), 20.0), settling=400, celsius=50.0,
    )  # fmt: skip


@cache
def make_excitations() -> Mapping[str, Excitation]:
    """Return every excitation by name."""
    return {
        "engagement": _make_engagement(70.0),
        "cold_engagement": _make_engagement(40.0),
        "triangle": _make_triangle(),
        "slip_sine": _make_slip_sine(15.0, 0.5),
        "reversals": _make_slip_sine(1.9, 1.0),
        "slip_steps": _make_slip_steps(),
        "crawl": _make_crawl(),
        "hold": _hold(),
    }
