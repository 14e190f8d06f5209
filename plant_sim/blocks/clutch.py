"""Friction torque of the wet multi-disk clutch: XGMS with one element that sticks rigidly.

Equation        M_C = max(0, a_MC p* + b_MC);  C_v = max(0, a_Cv p* + b_Cv)                        (Table 6.4)
                beta = min(1, beta_inf + (1 - beta_inf) exp(-(p* - p_1)/p_0))                       (6.6)
                s_n = 1 + (beta - 1) exp(-V_S/|omega|)                                              (6.2)
                m' = sign(omega) C (1 - m/s_n), s_n carrying the sign of omega                      (6.9)
                M = M_C m + sign(omega) C_v r_T |omega|^gamma                                       (6.9)
                p* = p_contact + F_n / A_cyl, only in contact                            (docs/rig.md, eq. 4)
                at omega = 0 the plates stick: they carry the applied torque while |M| <= M_C, and break away beyond it with
                m = +-1. This is the stick branch of the element, dF/dt = k omega, for k -> infinity; s_n(0) = 1
Integration     sticking and slow sliding: `plant_sim/rigs/standstill.py`
Assumptions     normal and tangential dynamics decoupled (sec. 6.2.3); temperature acts on the viscous term alone (fig 6.9)
Valid range     p* 2.7..4.2 bar, 0..250 rpm, 0..30 Nm, oil 50..150 degC
Not modelled    wear; pre-sliding, drag of the open clutch and more are effects (plant_sim/effects)
References      Janssens 2010, chapter 6
"""

from math import exp

from numba import njit


@njit(inline="always")
def coulomb_torque(pressure, slope, intercept):
    """Return the Coulomb torque M_C [Nm] at effective friction `pressure` p* [Pa]; slope [Nm/Pa], intercept [Nm]."""
    return max(0.0, slope * pressure + intercept)  # Janssens 2010, Table 6.4


@njit(inline="always")
def viscous_factor(pressure, slope, intercept):
    """Return the viscous factor C_v [Nm/(rad/s)^gamma] at `pressure` p* [Pa]."""
    return max(0.0, slope * pressure + intercept)  # Janssens 2010, Table 6.4


@njit(inline="always")
def stribeck_depth(pressure, beta_inf, beta_onset, beta_scale):
    """Return the ratio beta [-] of Stribeck level to Coulomb torque at `pressure` p* [Pa]."""
    return min(1.0, beta_inf + (1.0 - beta_inf) * exp(-(pressure - beta_onset) / beta_scale))  # Janssens 2010, eq. 6.6


@njit(inline="always")
def stribeck_ratio(beta, slip, stribeck_speed):
    """Return the normalised Stribeck torque s_n [-] at |slip| [rad/s]; 1 at standstill."""
    speed = abs(slip)
    return 1.0 + (beta - 1.0) * exp(-stribeck_speed / speed) if speed > 0.0 else 1.0  # Janssens 2010, eq. 6.2


@njit(inline="always")
def relax_state(state, ratio, slip, attraction, step):
    """Return the normalised friction state m [-] after `step` [s] of constant slip: exact solution of eq. 6.9.

    `ratio` is s_n [-], `attraction` is C [1/s]. At standstill the state stays.
    """
    if slip == 0.0:
        return state
    target = ratio if slip > 0.0 else -ratio
    return target + (state - target) * exp(-attraction * step / ratio)  # Janssens 2010, eq. 6.9


@njit(inline="always")
def torque(coulomb, state, viscous, slip, exponent):
    """Return the clutch torque M [Nm], positive when it opposes positive slip; `viscous`: C_v r_T [Nm/(rad/s)^gamma]."""
    drag = viscous * abs(slip) ** exponent
    return coulomb * state + (drag if slip > 0.0 else -drag)  # Janssens 2010, eq. 6.9
