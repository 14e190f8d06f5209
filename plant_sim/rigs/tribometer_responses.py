"""Frequency responses of the tribometer: tangential and normal, by random-phase multisine; tangential by stepped sine too.

What            the identification experiments of section 3.10, on a rig with any friction model
Method          best linear approximation with its deviation, noise and distortion (`multisine`): four realisations of some
                periods each, the first period of each run left out
Assumptions     angles are exact: a count of the encoder is as large as the motion at high preload
Valid range     that of `tribometer`: resonances are damped by the method, the more the longer dt
References      Janssens 2010, sec. 3.10; Pintelon and Schoukens 2012
"""

from math import pi
from typing import NamedTuple

import numpy as np

from plant_sim.friction.model import require
from plant_sim.rigs.multisine import FrequencyResponse, Multisine, estimate_response
from plant_sim.rigs.tribometer import Tribometer

Array = np.ndarray
REALISATIONS, PERIODS = 4, 10  # sec. 3.10
DRIFT_STIFFNESS = 1.0  # Nm/rad, chosen: the weak position loop of sec. 3.10; as much as the inertia at 1 Hz


class Tangential(NamedTuple):
    """Responses of the motor's angle [rad] to the torque [Nm] of the motor, and to that of the dynamometers."""

    motor: FrequencyResponse
    dynamometers: FrequencyResponse


def measure_tangential_response(
    rig: Tribometer, load: float, source: Multisine, dt: float, periods: int = PERIODS, seed: int = 1
) -> Tangential:
    """Return the response under `load` [N] to the motor torque `source` [Nm], sampled every `dt` [s]. Raises InputError."""
    random = np.random.default_rng(seed)
    torques = np.array([source.draw_period(random) for _ in range(REALISATIONS)])
    angle, motor, table = (np.empty((REALISATIONS, periods, source.samples)) for _ in range(3))
    for m, period in enumerate(torques):
        torque = np.append(np.tile(period, periods + 1), period[0])
        record = rig.run(rig.make_torque_drive(torque, DRIFT_STIFFNESS), load, (torque.size - 1) * dt, dt)
        for kept, signal in ((angle, record.angle_rad), (motor, record.motor_torque), (table, record.torque_measured)):
            kept[m] = signal[source.samples : -1].reshape(periods, source.samples)
    return Tangential(
        estimate_response(source, dt, motor, angle, torques), estimate_response(source, dt, table, angle, torques)
    )


def measure_stepped_sine(
    rig: Tribometer, load: float, amplitude: float, frequencies: Array, dt: float
) -> tuple[Array, Array]:
    """Return the frequencies [Hz] and first harmonics of angle over motor torque [rad/Nm] under `load` [N].

    Sines of `amplitude` [Nm], one after the other, at whole numbers of samples near `frequencies` [Hz]. Raises InputError.
    """
    require("amplitude", amplitude, above=0.0, unit="Nm")
    samples = np.unique(np.round(1.0 / (dt * np.asarray(frequencies, float))).astype(int))[::-1]
    responses, state = [], None
    for period in samples:
        settle, cycles = max(4, int(0.3 / (period * dt))), 4
        angle = 2.0 * pi * np.arange((settle + cycles) * period + 1) / period
        drive = rig.make_torque_drive(amplitude * np.sin(angle), DRIFT_STIFFNESS)
        record = rig.run(drive, load, (angle.size - 1) * dt, dt, start=state)
        state = record.end
        part = slice(settle * period, -1)
        turn = np.exp(-1j * angle[part])
        responses.append(np.sum(record.angle_rad[part] * turn) / np.sum(record.motor_torque[part] * turn))
    return 1.0 / (samples * dt), np.array(responses)


def measure_normal_response(
    rig: Tribometer, load: float, source: Multisine, dt: float, periods: int = PERIODS, seed: int = 2
) -> FrequencyResponse:
    """Return the deflection of the dynamometers [m] over the shaker's force `source` [N] about `load` [N].

    Raises InputError.
    """
    random = np.random.default_rng(seed)
    force, deflection = (np.empty((REALISATIONS, periods, source.samples)) for _ in range(2))
    for m in range(REALISATIONS):
        period = source.draw_period(random)
        forces = np.append(np.tile(period, periods + 1), period[0])
        record = rig.run(rig.make_torque_drive(0.0), load + forces, (forces.size - 1) * dt, dt)
        shown = record.normal_measured[source.samples : -1] / rig.normal.table_stiffness
        force[m], deflection[m] = (signal.reshape(periods, -1) for signal in (forces[source.samples : -1], shown))
    return estimate_response(source, dt, force, deflection)
