"""Line from valve to cylinder and the cylinder's volume.

Equation        q = G (p_v - p);  dp/dt = (q - A_cyl dx/dt) / C_h,  p >= 0                          (rig.md, 2)
Assumptions     laminar line, constant oil and line compliance C_h
Valid range     0..25 bar
Not modelled    entrapped air, leakage, centrifugal pressure, line inertia
References      design values of rig.md, chosen for the measured 9.8 Hz of fig 6.15 of Janssens 2010
"""

from numba import njit


@njit(inline="always")
def pressure_rate(valve_pressure, pressure, piston_speed, conductance, capacity, area):
    """Rate of the cylinder pressure [Pa/s]; conductance [m^3/(s Pa)], capacity [m^3/Pa], area [m^2]."""
    flow = conductance * (valve_pressure - pressure)
    rate = (flow - area * piston_speed) / capacity  # rig.md, 2
    return max(rate, 0.0) if pressure <= 0.0 else rate
