"""Torque estimator: the normal-load dependent part of the XGMS model (eq. 6.9) driven by measured pressure, slip, temperature.

Equation        M_sim = level M_C(p) m + (level + viscous) sign(omega) C_v(p) r_T |omega|^gamma;  m' = sign(omega) C (1 - m/s_n)
Assumptions     gross sliding; measured pressure is the pressure on the plates; one element (sec. 6.2.3)
Valid range     p 2.7..4.2 bar, 0..250 rpm, oil above 35 degC
Not modelled    pre-sliding, seal friction, direction of the stroke
References      Janssens 2010, eqs 6.2, 6.3, 6.6, 6.9, Tables 6.1, 6.4, 6.5. `level` and `viscous` are ours (adaptation.py)
"""

from math import exp, log10

from numba import njit

from rt_controller.record import floats

# The controller's calibration of the clutch; SI units (Pa, K, Nm, rad/s), names as in `controller.toml`
MODEL = floats(
    "coulomb_slope", "coulomb_intercept", "viscous_slope", "viscous_intercept", "beta_inf", "beta_onset", "beta_scale",
    "stribeck_speed", "viscous_exponent", "attraction", "contact_pressure", "oil_slope", "oil_offset", "oil_origin",
    "oil_reference", "oil_viscous_gain", "motor_inertia",
)  # fmt: skip


@njit
def viscosity_ratio(model, temperature):
    """Factor r_T [-] of the viscous torque at `temperature` [K]."""
    A, B, T_0 = model.oil_slope, model.oil_offset, model.oil_origin
    mu = A * log10(max(temperature - T_0, 1.0)) + B  # Janssens 2010, eq. 6.3
    mu_ref = A * log10(model.oil_reference - T_0) + B
    return 1.0 + model.oil_viscous_gain * (mu / mu_ref - 1.0)  # rig.md, 6


@njit
def friction_state(model, state, pressure, slip, step):
    """Normalised friction state m [-] after `step` [s] at `pressure` [Pa] and `slip` [rad/s]: exact exponential."""
    if slip == 0.0:
        return state
    beta_inf = model.beta_inf
    beta = min(1.0, beta_inf + (1.0 - beta_inf) * exp((model.beta_onset - pressure) / model.beta_scale))  # eq. 6.6
    s_n = 1.0 + (beta - 1.0) * exp(-model.stribeck_speed / abs(slip))  # eq. 6.2
    target = s_n if slip > 0.0 else -s_n
    return target + (state - target) * exp(-model.attraction * step / s_n)  # eq. 6.9, solved over the step


@njit
def torque_parts(model, state, pressure, slip, temperature):
    """Coulomb part M_C m and viscous part [Nm] of the torque, before level and viscous correction."""
    coulomb = max(0.0, model.coulomb_slope * pressure + model.coulomb_intercept) * state  # eq. 6.9, Table 6.4
    factor = max(0.0, model.viscous_slope * pressure + model.viscous_intercept)
    viscous = factor * viscosity_ratio(model, temperature) * abs(slip) ** model.viscous_exponent  # eq. 6.9
    return coulomb, viscous if slip >= 0.0 else -viscous
