"""AC motor with PI speed control and torque limit.

Equation        M_m = clip(k_p e + k_i int e, -M_max, M_max), e = omega_d - omega; int held while limited
                J domega/dt = M_m - M,  theta' = omega                                              (docs/rig.md, eq. 8)
Assumptions     current loop infinitely fast; shaft rigid; output side of the clutch fixed
Valid range     |omega| <= 250 rpm, |M_m| <= 40 Nm
Not modelled    cogging, torque ripple, backlash, shaft compliance
References      design values: docs/rig.md, eq. 8
"""

from numba import njit


@njit(inline="always")
def torque_demand(error, integral, proportional_gain, integral_gain):
    """Return the torque the speed controller asks for [Nm] from speed `error` [rad/s] and its `integral` [rad]."""
    return proportional_gain * error + integral_gain * integral  # docs/rig.md, eq. 8


@njit(inline="always")
def limit_torque(torque, limit):
    """Return the motor torque M_m [Nm] within +-`limit` [Nm]."""
    return min(max(torque, -limit), limit)
