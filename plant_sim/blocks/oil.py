"""Oil between the plates: heating by friction, and what its temperature does to viscous friction.

Equation        C_th dT/dt = |M omega| - h_th (T - T_sump)                                (docs/rig.md, eq. 7)
                r_T = 1 + g (mu(T)/mu(T_ref) - 1),  mu(T) = A log10(T - T_0) + B          (6.3; docs/rig.md, eq. 6)
Assumptions     one thermal mass; logarithm to base 10 (the only reading that gives the slope of fig 6.8)
Valid range     T > 35 degC
Not modelled    distribution over the plates, oil flow, viscosity law of the oil (only its effect on friction)
References      Janssens 2010, eq. 6.3, Table 6.1, figs 6.8 and 6.9
"""

from math import log10

from numba import njit


@njit(inline="always")
def friction_coefficient(temperature, slope, offset, origin):
    """Return the friction coefficient mu [-] at `temperature` [K]; `origin` T_0 [K]. Only its ratio is used."""
    return slope * log10(max(temperature - origin, 1.0)) + offset  # Janssens 2010, eq. 6.3


@njit(inline="always")
def viscosity_ratio(coefficient, reference, gain):
    """Return the factor r_T [-] on the viscous torque from mu(T) and mu(T_ref); 1 at the reference temperature."""
    return 1.0 + gain * (coefficient / reference - 1.0)  # docs/rig.md, eq. 6


@njit(inline="always")
def heating_rate(temperature, friction_power, heat_capacity, heat_transfer, sump_temperature):
    """Return the rate of the oil temperature [K/s] at `friction_power` [W]."""
    return (friction_power - heat_transfer * (temperature - sump_temperature)) / heat_capacity  # docs/rig.md, eq. 7
