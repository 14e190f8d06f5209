"""Line from valve to cylinder and the cylinder's volume.

Equation        q = G (p_v - p);  dp/dt = (q - A_cyl dx/dt) / C_h,  p >= 0                          (docs/rig.md, eq. 2)
Assumptions     laminar line, constant oil and line compliance C_h
Valid range     0..25 bar
Not modelled    line inertia; air, leakage, centrifugal pressure, cold oil are effects (plant_sim/effects)
References      design values, chosen to come near the 9.8 Hz of fig 6.15 of Janssens 2010
"""

from numba import njit


@njit(inline="always")
def line_flow(valve_pressure, pressure, conductance):
    """Return the flow from the valve into the cylinder q [m^3/s]; conductance [m^3/(s Pa)]."""
    return conductance * (valve_pressure - pressure)  # docs/rig.md, eq. 2


@njit(inline="always")
def pressure_rate(flow, pressure, piston_speed, capacity, area):
    """Return the rate of the cylinder pressure [Pa/s] at `flow` [m^3/s]; capacity [m^3/Pa], area [m^2]."""
    rate = (flow - area * piston_speed) * (1.0 / capacity)  # docs/rig.md, eq. 2; no division, see `piston.speed`
    return max(rate, 0.0) if pressure <= 0.0 else rate
