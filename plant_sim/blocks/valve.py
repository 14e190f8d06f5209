"""Proportional pressure valve with its voltage-to-current converter.

Equation        u = clip(k_v V, 0, p_supply);  p_v'' + 2 zeta w p_v' + w^2 p_v = w^2 u          (docs/rig.md, eq. 1)
Assumptions     the supply pressure is constant; the voltage is held constant over a step (zero-order hold)
Valid range     V 0..10 V
Not modelled    flow limits; dead band, stiction, hysteresis, delay, sagging supply are effects (plant_sim/effects)
References      Janssens 2010, sec. 6.3 (supply 2.5 MPa, bandwidth of its pressure loop 9.8 Hz); w, zeta, k_v: chosen here
"""

from numba import njit


@njit(inline="always")
def limit_demand(demand, supply_pressure):
    """Return the pressure demand of the valve [Pa], limited to 0..`supply_pressure` [Pa]."""
    return min(max(demand, 0.0), supply_pressure)  # docs/rig.md, eq. 1


@njit(inline="always")
def acceleration(pressure, rate, demand, frequency, damping):
    """Return the second derivative of the valve pressure [Pa/s^2].

    Arguments: pressure [Pa], its rate [Pa/s], demand [Pa], `frequency` [rad/s], damping ratio [-].
    """
    return frequency * (frequency * (demand - pressure) - 2.0 * damping * rate)  # docs/rig.md, eq. 1
