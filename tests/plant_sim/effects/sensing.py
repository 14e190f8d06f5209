"""What the sensors show of a signal that is known at every time, called as a rig does: in each step, then with h = 0."""

from collections.abc import Callable

import numpy as np
from numba import njit

from plant_sim.effects.signals import SENSORS, SIGNALS, bind_laws, call
from plant_sim.rigs import wet_clutch

STEP = 1e-4  # s
PRESSURE, TEMPERATURE, MOTOR, CLUTCH = range(4)  # columns of what is shown

Signal = Callable[[np.ndarray], np.ndarray]  # times (n,) [s] to values (n,)


@njit
def _call(s, values, temperature, torques, parameters, e, h):
    s.sensed_pressure, s.sensed_temperature, s.temperature = values, temperature, temperature
    s.sensed_motor_torque, s.sensed_clutch_torque = torques, torques
    call(SENSORS, e, s, parameters[0], h)


@njit
def _show(at_end, at_mid_step, temperature, parameters, effects, states, h):
    signals = np.zeros(1, SIGNALS)
    s, e = signals[0], bind_laws(effects, states)
    shown = np.empty((at_end.size, 4))
    for k in range(at_end.size):
        if k:
            _call(s, at_end[k], temperature[k], at_mid_step[k - 1], parameters, e, h)
        _call(s, at_end[k], temperature[k], at_end[k], parameters, e, 0.0)
        shown[k] = s.sensed_pressure, s.sensed_temperature, s.sensed_motor_torque, s.sensed_clutch_torque
    return shown


def simulate_sensor(
    changed: dict[str, float], signal: Signal, seconds: float, step: float = STEP, temperature: Signal | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) [s] and what the four analog sensors show then (n, 4), in SI.

    changed: parameters by dotted name, each in its unit. Pressure and torques follow `signal`, [Pa] and [Nm], and so does the
    temperature [K] unless it is given. As in a rig a step ends with its pressure and temperature, but torques are mid-step's.
    """
    rig = wet_clutch.Rig(wet_clutch.load_nominal().with_values(changed))
    time = np.arange(round(seconds / step) + 1) * step
    warm = (temperature or signal)(time)
    return time, _show(
        signal(time),
        signal(time[:-1] + 0.5 * step),
        warm,
        rig.record,
        rig.table.kernel,
        rig.table.make_rest_states(),
        step,
    )
