"""The state that a recorded run of a clutch begins in: at rest, or in the middle of its operation.

At rest         pressure 0 and the speed that is demanded (docs/rig.md)
In operation    pressures, slip and torques as they are measured, by lines through the first rows; the piston where springs,
                stack and its damping hold it under that pressure; the friction state and the integral of the motor's
                controller such that both torques are the measured ones
Assumptions     what nobody measures settles within `SETTLING`: valve, piston, springs of an effect. Until then the outputs of
                the model are the measured ones, so that no effect is found in how a recording was cut
"""

import numpy as np

from clutch_hil.fitting.model import Columns
from plant_sim.rigs.wet_clutch import Rig, Whole
from protocols.files.units import BAR, ZERO_CELSIUS

SETTLING = 0.3  # s: the motor's controller, slowest of what settles, has 0.1 s (docs/rig.md, eq. 8: J/k_p)
_MOST_SETTLING = 0.1  # of a run
_WARMTH = 0.2  # s of measured temperature that give the first one: the clutch is still open in half of it
_LINE = 0.02  # s: rows of a line through the beginning; shorter than any demand of the profiles takes to change
_LEAST_ROWS = 3  # of it
_EMPTY = 0.3  # bar: below it the clutch is at rest, if its speed is
AT_DEMAND = 0.15  # rad/s: four steps of the encoder at 1 kHz; the speed is that of the demand
_CREEP = (
    1e-9  # rad/s: of plates at rest whose friction state is asked for, because a torque at 0 is that which holds them
)


def find_initial_state(rig: Rig, columns: Columns, period: float, torque_limit: float) -> Whole:
    """The state that a run begins in. period [s]: of its rows; torque_limit [Nm]: of the motor."""
    celsius = float(columns["oil_temperature_degc"][: max(2, round(_WARMTH / period))].mean())
    demand = float(columns["motor_speed_demand_rad_s"][0])
    state = rig.make_rest_state(demand, celsius + ZERO_CELSIUS)
    state.y["angle"] = columns["shaft_angle_rad"][0]
    if begins_in_operation(columns, period):
        _move_to_operation(rig, state, columns, period, torque_limit)
        state = rig.advance(state, 0.0, demand, torque_limit, 0.0, 0)  # outputs follow
    return state


def begins_in_operation(columns: Columns, period: float) -> bool:
    """Whether a run begins with pressure in the cylinder, or at another speed than is demanded."""
    pressure, slip = (fit_line(columns[name], period)[0] for name in ("cylinder_pressure_bar", "slip_speed_rad_s"))
    return bool(pressure > _EMPTY or abs(slip - columns["motor_speed_demand_rad_s"][0]) > AT_DEMAND)


def begin_as_measured(predicted: dict[str, np.ndarray], columns: Columns, period: float) -> dict[str, np.ndarray]:
    """Outputs (n,) as predicted; of a run that begins in operation, as measured until its state has settled."""
    if not begins_in_operation(columns, period):
        return predicted
    rows = count_settling_rows(columns, period)
    return {name: np.concatenate([columns[name][:rows], values[rows:]]) for name, values in predicted.items()}


def count_settling_rows(columns: Columns, period: float) -> int:
    """Rows of a run that begins in operation, until its state has settled."""
    return min(round(SETTLING / period), round(_MOST_SETTLING * len(columns["time_s"])))


def fit_line(values: np.ndarray, period: float) -> tuple[float, float]:
    """First value of a line through the first rows of `values` (n,), and its slope [1/s]."""
    first = values[: _count_rows(period)]
    slope, value = np.polyfit(np.arange(len(first)) * period, first, 1)
    return float(value), float(slope)


def _move_to_operation(rig: Rig, state: Whole, columns: Columns, period: float, torque_limit: float) -> None:
    """Set pressures, piston, slip and what carries the torques as they are measured."""
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
    for name, measured, least, most in (
        ("friction_state", "clutch_torque", -1.0, 1.0), ("speed_integral", "motor_torque", -np.inf, np.inf),
    ):  # fmt: skip
        torques = []
        for value in (0.0, 1e-3):  # both torques are linear in it, and the motor's is not at its limit
            y[name] = value
            torques.append(float(rig.advance(state, 0.0, demand, np.inf, 0.0, 0).y[f"sensed_{measured}"][0]))
        wanted, _ = fit_line(columns[f"{measured}_nm"], period)
        slope = (torques[1] - torques[0]) / 1e-3
        y[name] = min(max((wanted - torques[0]) / slope, least), most) if slope else 0.0
    if still:
        y["slip_speed"] = 0.0


def _find_held_position(rig: Rig, pressure: float, rise: float) -> tuple[float, float]:
    """Position [m] and speed [m/s] of a piston under a `pressure` [Pa] that rises [Pa/s]: docs/rig.md, eq. 3."""
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
