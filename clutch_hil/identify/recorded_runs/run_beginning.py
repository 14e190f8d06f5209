"""Initial state of a recorded run of a clutch: at rest, or in operation.

At rest         pressure 0 and the demanded speed (docs/rig.md)
In operation    pressures, slip and torques as measured, from lines through the first rows; the piston in equilibrium of
                pressure, springs, stack and damping; friction state and integral of the motor's controller so that both
                torques are the measured ones
Assumptions     states that are not measured settle within `SETTLING`: valve, piston, springs of an effect. Locked plates
                under a limited motor must first slide. Until then the outputs of the model are set to the measured ones, so
                that the cut of a recording is not identified as an effect
"""

import numpy as np

from clutch_hil.fitting.model import Columns
from clutch_hil.identify.clutch_effects import EMPTY
from plant_sim.rigs.wet_clutch import Rig, Whole
from protocols.files.units import BAR, ZERO_CELSIUS

_MEASURED = ("cylinder_pressure_bar", "slip_speed_rad_s", "clutch_torque_nm", "motor_torque_nm")
SETTLING = 0.3  # s: the motor's controller, the slowest of these states, has 0.1 s (docs/rig.md, eq. 8: k_p/k_i)
_MOST_SETTLING = 0.1  # largest share of a run
_WARMTH = 0.2  # s, averaging time of the initial temperature: in half of it the clutch is still open
_LINE = 0.02  # s, length of the line through the first rows: shorter than any ramp of the profiles
_LEAST_ROWS = 3  # least number of rows of this line
# rad/s, largest difference of a speed that counts as the demanded one: four steps of the encoder at 1 kHz
AT_DEMAND = 0.15
# rad/s, slip for computing the friction state of plates at rest: at 0 the model returns the holding torque
_CREEP = 1e-9
_AT_LIMIT = 0.2  # Nm below the motor's limit: four deviations of the noise of its channel


def find_initial_state(rig: Rig, columns: Columns, period: float, torque_limit: float) -> Whole:
    """Return the initial state of a run. period [s]: time between rows. torque_limit [Nm]: limit of the motor."""
    celsius = float(columns["oil_temperature_degc"][: max(2, round(_WARMTH / period))].mean())
    demand = float(columns["motor_speed_demand_rad_s"][0])
    state = rig.make_rest_state(demand, celsius + ZERO_CELSIUS)
    state.y["angle"] = columns["shaft_angle_rad"][0]
    if begins_in_operation(columns, period):
        _move_to_operation(rig, state, columns, period, torque_limit)
        state = rig.advance(state, 0.0, demand, torque_limit, 0.0, 0)  # updates the outputs
    return state


def begins_in_operation(columns: Columns, period: float) -> bool:
    """Return whether a run begins with pressure in the cylinder or off its demanded speed; False for inputs alone."""
    if not {*_MEASURED} <= set(columns):
        return False
    pressure, slip = (fit_line(columns[name], period)[0] for name in _MEASURED[:2])
    return bool(pressure > EMPTY or abs(slip - columns["motor_speed_demand_rad_s"][0]) > AT_DEMAND)


def begin_as_measured(
    predicted: dict[str, np.ndarray], columns: Columns, period: float, limit: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the predicted outputs (n,), or the measured ones until a run that begins in operation has settled.

    limit (n,): torque limit of the motor [Nm].
    """
    if not begins_in_operation(columns, period):
        return predicted
    rows = min(
        _find_release(columns, period, limit) + count_settling_rows(columns, period), len(columns["time_s"]) // 2
    )
    return {name: np.concatenate([columns[name][:rows], values[rows:]]) for name, values in predicted.items()}


def count_settling_rows(columns: Columns, period: float) -> int:
    """Return the number of rows until the state of a run that begins in operation has settled."""
    return min(round(SETTLING / period), round(_MOST_SETTLING * len(columns["time_s"])))


def _find_release(columns: Columns, period: float, limit: np.ndarray) -> int:
    """Return the first row in which locked plates under a motor at its limit slide; 0 if the run does not begin like this.

    While the plates rest, the unknown initial state of the motor's controller is not corrected.
    """
    first = slice(_count_rows(period))
    if (
        np.any(columns["slip_speed_rad_s"][first])
        or not _is_at_limit(columns["motor_torque_nm"][first], limit[first]).all()
    ):
        return 0
    moving = np.flatnonzero(columns["slip_speed_rad_s"])
    return int(moving[0]) if len(moving) else len(limit)


def _is_at_limit(torque: np.ndarray, limit: np.ndarray) -> np.ndarray:
    return np.abs(torque) > limit - _AT_LIMIT


def fit_line(values: np.ndarray, period: float) -> tuple[float, float]:
    """Fit a line to the first rows of `values` (n,). Return its first value, and its slope [1/s]."""
    first = values[: _count_rows(period)]
    middle = 0.5 * (len(first) - 1)
    steps = np.arange(len(first)) - middle
    # slope per row; four times as fast as `polyfit`, and called in each simulation
    slope = float(steps @ first) / float(steps @ steps)
    return float(first.mean()) - slope * middle, slope / period


def find_speed_integral(
    torque: float, error: float, limit: float, proportional_gain: float, integral_gain: float
) -> float:
    """Return the integral [rad] of the motor's controller for a measured `torque` [Nm] at a speed `error` [rad/s].

    A motor at its `limit` [Nm] holds its integral. The earlier value is not measured; it is taken as the one that gives this
    torque without a speed error.
    """
    if not integral_gain > 0.0:
        return 0.0
    needed = 0.0 if _is_at_limit(np.array(torque), np.array(limit)) else proportional_gain * error
    return float((torque - needed) / integral_gain)  # docs/rig.md, eq. 8


def _move_to_operation(rig: Rig, state: Whole, columns: Columns, period: float, torque_limit: float) -> None:
    """Set pressures, piston, slip, friction state and speed integral of `state` to the measured values."""
    y, c = state.y, rig.record[0]
    pressure, rise = (BAR * one for one in fit_line(columns["cylinder_pressure_bar"], period))
    y["pressure"] = max(pressure, 0.0)
    y["position"], speed = _find_held_position(rig, pressure, rise)
    flow = c["hydraulics_capacity"] * rise + c["piston_area"] * speed  # docs/rig.md, eq. 2
    y["valve_pressure"], y["valve_rate"] = max(pressure + flow / c["hydraulics_conductance"], 0.0), rise
    slip, _ = fit_line(columns["slip_speed_rad_s"], period)
    still = not np.any(columns["slip_speed_rad_s"][: _count_rows(period)])
    y["slip_speed"] = _CREEP if still else slip
    demand = float(columns["motor_speed_demand_rad_s"][0])
    motor, clutch = (fit_line(columns[name], period)[0] for name in ("motor_torque_nm", "clutch_torque_nm"))
    gains = c["motor_proportional_gain"], c["motor_integral_gain"]
    y["speed_integral"] = find_speed_integral(motor, demand - float(y["slip_speed"][0]), torque_limit, *gains)
    torques = []
    for value in (0.0, 1.0):  # the torque is linear in the friction state
        y["friction_state"] = value
        torques.append(float(rig.advance(state, 0.0, demand, torque_limit, 0.0, 0).y["sensed_clutch_torque"][0]))
    coulomb = torques[1] - torques[0]
    y["friction_state"] = min(max((clutch - torques[0]) / coulomb, -1.0), 1.0) if coulomb else 0.0
    if still:
        y["slip_speed"] = 0.0


def _find_held_position(rig: Rig, pressure: float, rise: float) -> tuple[float, float]:
    """Return position [m] and speed [m/s] of a piston at `pressure` [Pa] that rises by `rise` [Pa/s] (docs/rig.md, eq. 3)."""
    c = rig.record[0]
    area, spring, stack = c["piston_area"], c["piston_spring_stiffness"], c["piston_stack_stiffness"]
    speed = area * rise / spring
    free = (pressure * area - c["piston_preload"] - c["piston_damping"] * speed) / spring
    if free <= c["piston_clearance"]:
        return (free, speed) if free > 0.0 else (0.0, 0.0)
    speed = area * rise / (spring + stack)
    push = pressure * area - c["piston_preload"] - c["piston_damping"] * speed
    return (push + stack * c["piston_clearance"]) / (spring + stack), speed


def _count_rows(period: float) -> int:
    return max(round(_LINE / period), _LEAST_ROWS)
