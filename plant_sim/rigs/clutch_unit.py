"""One clutch with its valve: from the valve's voltage to pressure, piston and friction torque, with the hooks of the effects.

Equation        docs/rig.md, eq. 1 to 6, with the laws in `plant_sim.blocks`
Integration     valve, cylinder and piston: classical Runge-Kutta of order 4. Friction state: exact exponential at the pressure
                of mid-step
Assumptions     inputs, and the force against the piston, constant over a step
Not modelled    see each block
References      Janssens 2010, chapter 6; hooks: plant_sim/effects/signals.py

`y`: record with the states of a clutch, changed in place. `s`: signals, set by `signals.set_known`. `c`: parameters.
`h`: step [s]. `e`: effects as `signals.bind_laws` returns them.
"""

from numba import njit

from plant_sim.blocks import clutch, hydraulics, oil, piston, valve
from plant_sim.effects.signals import COMMAND, FRICTION, HYDRAULICS, PISTON, STACK, TORQUE, call, has_law


@njit(inline="always")
def stack_force(x, s, c, e):
    """Return the normal force on the plates F_n [N] at piston position `x` [m]."""
    force = piston.stack_force(x, c.piston_clearance, c.piston_stack_stiffness)
    if has_law(STACK, e):
        s.position, s.stack_force = x, force
        call(STACK, e, s, c, 0.0)
        force = max(s.stack_force, 0.0)
    return force


@njit(inline="always")
def _rates(pv, rate, p, x, resistance, s, c, e):
    """Return the time derivatives of valve pressure, its rate, cylinder pressure and piston position."""
    flow, capacity, thrust = hydraulics.line_flow(pv, p, c.hydraulics_conductance), c.hydraulics_capacity, p
    if has_law(HYDRAULICS, e):
        s.valve_pressure, s.pressure, s.position = pv, p, x
        s.flow, s.capacity, s.thrust_pressure = flow, capacity, thrust
        call(HYDRAULICS, e, s, c, 0.0)
        flow, capacity, thrust = s.flow, s.capacity, s.thrust_pressure
    stack = stack_force(x, s, c, e)
    speed = piston.speed(
        thrust, x, stack, resistance, c.piston_area, c.piston_preload, c.piston_spring_stiffness, c.piston_damping
    )
    return (
        rate,
        valve.acceleration(pv, rate, s.demand, c.valve_frequency, c.valve_damping),
        hydraulics.pressure_rate(flow, p, speed, capacity, c.piston_area),
        speed,
    )


@njit(inline="always")
def actuate(y, voltage, s, c, e, h):
    """Advance valve, cylinder and piston of `y` by a step; return the friction pressure p* [Pa] at mid-step."""
    s.voltage, s.demand, s.supply_pressure = voltage, c.valve_gain * voltage, c.valve_supply_pressure
    if has_law(COMMAND, e):
        call(COMMAND, e, s, c, h)
    s.demand = valve.limit_demand(s.demand, s.supply_pressure)
    pv, rate, p, x, held = y.valve_pressure, y.valve_rate, y.pressure, y.position, y.seal_force
    a0, a1, a2, a3 = _rates(pv, rate, p, x, held, s, c, e)
    k = 0.5 * h
    b0, b1, b2, b3 = _rates(pv + k * a0, rate + k * a1, p + k * a2, x + k * a3, held, s, c, e)
    c0, c1, c2, c3 = _rates(pv + k * b0, rate + k * b1, p + k * b2, x + k * b3, held, s, c, e)
    d0, d1, d2, d3 = _rates(pv + h * c0, rate + h * c1, p + h * c2, x + h * c3, held, s, c, e)
    k = h / 6.0
    y.valve_pressure = pv + k * (a0 + 2.0 * (b0 + c0) + d0)
    y.valve_rate = rate + k * (a1 + 2.0 * (b1 + c1) + d1)
    after = max(p + k * (a2 + 2.0 * (b2 + c2) + d2), 0.0)
    moved = x + k * (a3 + 2.0 * (b3 + c3) + d3)
    if moved < 0.0:  # the piston reaches its stop within the step: oil that it did not displace stays in the cylinder
        capacity = c.hydraulics_capacity
        if has_law(HYDRAULICS, e):
            capacity = s.capacity
        after = max(after + moved * c.piston_area / capacity, 0.0)
        moved = 0.0
    y.pressure, y.position, y.seal_force = after, moved, 0.0
    if has_law(PISTON, e):
        s.pressure, s.position, s.displacement, s.piston_force = after, moved, moved - x, 0.0
        call(PISTON, e, s, c, h)
        y.seal_force = s.piston_force
    return friction_pressure(0.5 * (x + moved), s, c, e)


@njit(inline="always")
def friction_pressure(position, s, c, e):
    """Return the effective friction pressure p* [Pa] at piston `position` [m]; 0 out of contact."""
    force = stack_force(position, s, c, e)
    s.position = position  # for FRICTION and TORQUE
    return c.piston_contact_pressure + force / c.piston_area if force > 0.0 else 0.0  # docs/rig.md, eq. 4


@njit(inline="always")
def slide(m, pressure, slip, viscosity_ratio, s, c, e, h):
    """Advance the friction by a step of constant slip; return the state m after it and the torque M [Nm] at its middle.

    pressure: friction pressure p* [Pa]; slip [rad/s]. With h = 0 the state stays and the torque is the present one.
    """
    torque = 0.0
    before = m
    if pressure > 0.0:
        coulomb = clutch.coulomb_torque(pressure, c.clutch_coulomb_slope, c.clutch_coulomb_intercept)
        viscous = clutch.viscous_factor(pressure, c.clutch_viscous_slope, c.clutch_viscous_intercept) * viscosity_ratio
        beta = clutch.stribeck_depth(pressure, c.clutch_beta_inf, c.clutch_beta_onset, c.clutch_beta_scale)
        stribeck_speed, attraction = c.clutch_stribeck_speed, c.clutch_attraction
        if has_law(FRICTION, e):
            s.friction_pressure, s.slip = pressure, slip
            s.coulomb, s.viscous, s.beta = coulomb, viscous, beta
            s.stribeck_speed, s.attraction, s.friction_state = stribeck_speed, attraction, m
            call(FRICTION, e, s, c, h)
            coulomb, viscous, beta = s.coulomb, s.viscous, s.beta
            stribeck_speed, attraction, before = s.stribeck_speed, s.attraction, s.friction_state
        m = clutch.relax_state(before, clutch.stribeck_ratio(beta, slip, stribeck_speed), slip, attraction, h)
        torque = clutch.torque(coulomb, 0.5 * (before + m), viscous, slip, c.clutch_viscous_exponent)
        if has_law(TORQUE, e):
            s.viscous_share = 1.0 - coulomb * 0.5 * (before + m) / torque if torque != 0.0 else 0.0
    else:
        m = 0.0  # docs/rig.md, eq. 4
    if has_law(TORQUE, e):
        s.friction_pressure, s.slip, s.torque = pressure, slip, torque
        s.contact = 1.0 if pressure > 0.0 else 0.0
        call(TORQUE, e, s, c, h)
        torque = s.torque
    return m, torque


@njit(inline="always")
def viscosity_ratio(temperature, c):
    """Return the factor r_T [-] on the viscous torque at oil `temperature` [K]."""
    mu = oil.friction_coefficient(temperature, c.oil_slope, c.oil_offset, c.oil_origin)
    return oil.viscosity_ratio(mu, c.oil_reference_coefficient, c.oil_viscous_gain)
