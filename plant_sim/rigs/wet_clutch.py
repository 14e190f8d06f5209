"""The wet-clutch rig of chapter 6: valve, cylinder, piston, clutch, oil, motor, on one screen.

Equation        rig.md, 1 to 8, with the laws in `plant_sim.blocks` and the effects in `plant_sim.effects`
Integration     steps of at most 0.1 ms. Valve, cylinder and piston: classical Runge-Kutta of order 4. Friction state: exact
                exponential at the pressure of mid-step. Motor, oil, angle: midpoint rule. Against LSODA at rtol 1e-9
                (tests/test_wet_clutch.py) the pressure differs by less than an ADC step.
Assumptions     inputs constant over a call; viscosity ratio constant over a step
Not modelled    what each block lists
References      Janssens 2010, chapter 6
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit

from plant_sim.blocks import clutch, hydraulics, motor, oil, piston, valve
from plant_sim.effects import friction_level, piston_seal_friction
from protocols.errors import InputError
from protocols.parameters import ParameterSet, load_defaults, load_overlay

DEFAULTS = Path(__file__).parents[1] / "parameters" / "janssens2010.toml"
STEP_LIMIT = 1e-4  # s, longest integration step: rig.md; the stack on its damping has a time constant of 0.4 ms

_STABLE = 2.5  # rate times step that Runge-Kutta 4 bears on the real axis, 2.78, less a margin
_GROUPS = ("valve", "hydraulics", "piston", "clutch", "oil", "motor", "friction_level", "piston_seal_friction")


class State(NamedTuple):
    """State and outputs of the rig at `time`."""

    time: float  # s
    valve_pressure: float  # Pa
    valve_rate: float  # Pa/s
    pressure: float  # Pa, cylinder
    position: float  # m, piston, 0 at rest
    seal_force: float  # N
    friction_state: float  # m of eq. 6.9, dimensionless
    temperature: float  # K, oil
    slip_speed: float  # rad/s
    speed_integral: float  # rad, of the motor's speed controller
    angle: float  # rad
    clutch_torque: float  # Nm, M
    motor_torque: float  # Nm, M_m
    normal_force: float  # N, on the plates


STATE = np.dtype([(name, np.float64) for name in State._fields])  # a State as the kernel takes it


def as_state(record: np.ndarray) -> State:
    """The named tuple of a structured array (1,) of STATE: plain floats, quick to read."""
    return State(*record.view(np.float64).tolist())


def parameter_record(parameters: ParameterSet) -> np.ndarray:
    """Parameters as the kernel takes them: a structured array of one record, SI, fields `group_name`."""
    values = {f"{group}_{name}": v for group in _GROUPS for name, v in parameters.si(group).items()}
    area = values["piston_area"]
    # rig.md, 3: F_0 = A p_preload, and k_s such that F_spring(x_c) = A p_contact
    values["piston_preload"] = area * values["piston_preload_pressure"]
    rise = values["piston_contact_pressure"] - values["piston_preload_pressure"]
    values["piston_spring_stiffness"] = area * rise / values["piston_clearance"]
    _check_step(values)
    return np.array([tuple(values.values())], dtype=[(name, np.float64) for name in values])


def _check_step(values: dict[str, float]) -> None:
    """Raise InputError when fluid and piston together are too fast for the integration step."""
    damping, capacity = values["piston_damping"], values["hydraulics_capacity"]
    # a rig may be built without the effect
    seal = values.get("piston_seal_friction_force", 0.0) / values.get("piston_seal_friction_travel", 1.0)
    piston_rate = (values["piston_spring_stiffness"] + values["piston_stack_stiffness"] + seal) / damping
    fluid_rate = values["piston_area"] ** 2 / (capacity * damping) + values["hydraulics_conductance"] / capacity
    rate = piston_rate + fluid_rate  # 1/s, bound on the fastest eigenvalue of rig.md 2 and 3
    if not rate * STEP_LIMIT <= _STABLE:
        raise InputError(
            f"the rig is too fast to integrate: piston and cylinder together reach {rate:.3g} 1/s; allowed are"
            f" {_STABLE / STEP_LIMIT:.3g} 1/s (raise piston.damping or hydraulics.capacity, or lower piston.area)"
        )


def nominal(changed: Path | None = None) -> ParameterSet:
    """The parameters of rig.md, or as changed by a user's file. Raises InputError."""
    shipped = load_defaults(DEFAULTS)
    return load_overlay(changed, shipped) if changed else shipped


def initial_state(slip_speed: float, temperature: float) -> np.ndarray:
    """State at rest: piston back, pressures 0, motor at `slip_speed` [rad/s], oil at `temperature` [K] (rig.md)."""
    state = np.zeros(1, dtype=STATE)
    state["slip_speed"] = slip_speed
    state["temperature"] = temperature
    return state


def filled_state(slip_speed: float, temperature: float, parameters: np.ndarray) -> np.ndarray:
    """State of a filled clutch: piston at the plates, contact pressure in valve and cylinder; arguments as `initial_state`."""
    state = initial_state(slip_speed, temperature)
    state["position"] = parameters["piston_clearance"]
    for name in ("valve_pressure", "pressure"):
        state[name] = parameters["piston_contact_pressure"]
    return state


@njit(inline="always")
def _fluid_rates(pv, rate, p, x, seal, demand, c):
    """Time derivatives of valve pressure, its rate, cylinder pressure and piston position."""
    stack = piston.stack_force(x, c.piston_clearance, c.piston_stack_stiffness)
    speed = piston.speed(
        p, x, stack, seal, c.piston_area, c.piston_preload, c.piston_spring_stiffness, c.piston_damping
    )
    return (
        rate,
        valve.acceleration(pv, rate, demand, c.valve_frequency, c.valve_damping),
        hydraulics.pressure_rate(pv, p, speed, c.hydraulics_conductance, c.hydraulics_capacity, c.piston_area),
        speed,
    )


@njit(inline="always")
def _friction_pressure(position, c):
    """Effective friction pressure p* [Pa]; 0 out of contact."""
    force = piston.stack_force(position, c.piston_clearance, c.piston_stack_stiffness)
    return c.piston_contact_pressure + force / c.piston_area if force > 0.0 else 0.0  # rig.md, 4


@njit(inline="always")
def _clutch_torque(pressure, state, slip, viscosity_ratio, level, c):
    """Clutch torque [Nm] in contact at effective pressure [Pa] > 0, 0 otherwise."""
    if pressure == 0.0:
        return 0.0
    coulomb = clutch.coulomb_torque(pressure, c.clutch_coulomb_slope, c.clutch_coulomb_intercept)
    viscous = clutch.viscous_factor(pressure, c.clutch_viscous_slope, c.clutch_viscous_intercept)
    return level * clutch.torque(coulomb, state, viscous, viscosity_ratio, slip, c.clutch_viscous_exponent)


# arcp: divisions by constants become multiplications; contract: fused multiply-add. Same result on every run of a machine.
@njit(cache=True, error_model="numpy", fastmath={"arcp", "contract"})
def advance(before, voltage, speed_demand, torque_limit, parameters, duration, substeps):
    """State after `duration` [s] with the inputs held.

    before: structured array (1,) of STATE; voltage [V]; speed_demand [rad/s]; torque_limit [Nm];
    parameters: array of `parameter_record`; substeps: number of integration steps.
    Returns a new structured array (1,) of STATE. Pure: changes none of its arguments.
    """
    after = before.copy()
    y = after[0]
    c = parameters[0]
    h = duration / substeps
    demand = valve.pressure_demand(voltage, c.valve_gain, c.valve_supply_pressure)
    limit = min(torque_limit, c.motor_torque_limit)
    time, pv, rate, p, x, seal = y.time, y.valve_pressure, y.valve_rate, y.pressure, y.position, y.seal_force
    m, temperature, slip, integral, angle = y.friction_state, y.temperature, y.slip_speed, y.speed_integral, y.angle
    torque, motor_torque = y.clutch_torque, y.motor_torque
    mu_reference = oil.friction_coefficient(c.oil_reference, c.oil_slope, c.oil_offset, c.oil_origin)
    viscosity_ratio = level = 1.0
    for _ in range(substeps):
        # valve, line, cylinder, piston: Runge-Kutta 4
        a0, a1, a2, a3 = _fluid_rates(pv, rate, p, x, seal, demand, c)
        k = 0.5 * h
        b0, b1, b2, b3 = _fluid_rates(pv + k * a0, rate + k * a1, p + k * a2, x + k * a3, seal, demand, c)
        c0, c1, c2, c3 = _fluid_rates(pv + k * b0, rate + k * b1, p + k * b2, x + k * b3, seal, demand, c)
        d0, d1, d2, d3 = _fluid_rates(pv + h * c0, rate + h * c1, p + h * c2, x + h * c3, seal, demand, c)
        k = h / 6.0
        pv += k * (a0 + 2.0 * (b0 + c0) + d0)
        rate += k * (a1 + 2.0 * (b1 + c1) + d1)
        p = max(p + k * (a2 + 2.0 * (b2 + c2) + d2), 0.0)
        x_before = x
        x += k * (a3 + 2.0 * (b3 + c3) + d3)
        if x < 0.0:  # the piston meets its rest within the step: the oil it did not displace stays in the cylinder
            p = max(p + x * c.piston_area / c.hydraulics_capacity, 0.0)
            x = 0.0
        seal = piston_seal_friction.force(
            seal, x - x_before, c.piston_seal_friction_force, c.piston_seal_friction_travel
        )

        # clutch, motor, oil at mid-step
        slip_mid = slip + 0.5 * h * (motor_torque - torque) / c.motor_inertia
        level = friction_level.factor(time + 0.5 * h, c.friction_level_level, c.friction_level_drift)
        mu = oil.friction_coefficient(temperature, c.oil_slope, c.oil_offset, c.oil_origin)
        viscosity_ratio = oil.viscosity_ratio(mu, mu_reference, c.oil_viscous_gain)
        pressure_mid = _friction_pressure(0.5 * (x_before + x), c)
        if pressure_mid > 0.0:
            ratio = clutch.stribeck_ratio(
                pressure_mid,
                slip_mid,
                c.clutch_beta_inf,
                c.clutch_beta_onset,
                c.clutch_beta_scale,
                c.clutch_stribeck_speed,
            )
            m_before = m
            m = clutch.relaxed(m, ratio, slip_mid, c.clutch_attraction, h)
            torque = _clutch_torque(pressure_mid, 0.5 * (m_before + m), slip_mid, viscosity_ratio, level, c)
        else:
            m = torque = 0.0  # rig.md, 4
        error = speed_demand - slip_mid
        asked = motor.torque_demand(error, integral + 0.5 * h * error, c.motor_proportional_gain, c.motor_integral_gain)
        motor_torque = motor.limited(asked, limit)
        if asked == motor_torque:
            integral += h * error
        temperature += h * oil.heating_rate(
            temperature, abs(torque * slip_mid), c.oil_heat_capacity, c.oil_heat_transfer, c.oil_sump_temperature
        )
        slip_before = slip
        slip += h * (motor_torque - torque) / c.motor_inertia  # rig.md, 8
        angle += 0.5 * h * (slip_before + slip)
        time += h
    y.time, y.valve_pressure, y.valve_rate, y.pressure, y.position, y.seal_force = time, pv, rate, p, x, seal
    y.friction_state, y.temperature, y.slip_speed, y.speed_integral, y.angle = m, temperature, slip, integral, angle
    y.normal_force = piston.stack_force(x, c.piston_clearance, c.piston_stack_stiffness)
    y.clutch_torque = _clutch_torque(_friction_pressure(x, c), m, slip, viscosity_ratio, level, c)
    asked = motor.torque_demand(speed_demand - slip, integral, c.motor_proportional_gain, c.motor_integral_gain)
    y.motor_torque = motor.limited(asked, limit)
    return after
