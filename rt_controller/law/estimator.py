"""Torque estimator: the normal-load dependent part of the XGMS model (eq. 6.9) driven by measured pressure, slip, temperature.

Equation        sliding     M_sim = level M_C(p) m + (level + viscous) sign(omega) C_v(p) r_T |omega|^gamma
                            m' = sign(omega) C (1 - m/s_n), s_n carrying the sign of omega
                standing    M = applied torque, limited to -level M_C .. level M_C (GMS: stick dF/dt = k omega, slip from
                            |F| = s(0) = M_C on; here k -> infinity); m = M / (level M_C)
                turning     the plates stand when m can reach the applied share within a step T: at standstill s_n = 1, and
                            sign(omega) is any number in [-1, 1] (Filippov)
Assumptions     measured pressure is the pressure on the plates; one element (sec. 6.2.3)
Valid range     p 2.7..4.2 bar, 0..250 rpm either way, oil above 35 degC
Not modelled    pre-sliding (presliding.py), seal friction, direction of the stroke
References      Janssens 2010, sec. 5.2, eqs 6.2, 6.3, 6.6, 6.9, Tables 6.1, 6.4, 6.5; `level` and `viscous` are of this project
                (adaptation.py, trim.py)
"""

from math import exp, log10

from numba import njit

from rt_controller.law.record import make_float_type

# Calibration of the clutch in the controller: SI units (Pa, K, Nm, rad/s), names of `controller.toml`
MODEL = make_float_type(
    "coulomb_slope", "coulomb_intercept", "viscous_slope", "viscous_intercept", "beta_inf", "beta_onset", "beta_scale",
    "stribeck_speed", "viscous_exponent", "attraction", "contact_pressure", "piston_lag", "oil_slope", "oil_offset",
    "oil_origin", "oil_reference", "oil_viscous_gain", "motor_inertia", "motor_gain", "motor_torque_zero",
)  # fmt: skip


@njit
def viscosity_ratio(model, temperature):
    """Return the factor r_T [-] of the viscous torque at `temperature` [K]."""
    A, B, T_0 = model.oil_slope, model.oil_offset, model.oil_origin
    mu = A * log10(max(temperature - T_0, 1.0)) + B  # Janssens 2010, eq. 6.3
    mu_ref = A * log10(model.oil_reference - T_0) + B
    return 1.0 + model.oil_viscous_gain * (mu / mu_ref - 1.0)  # docs/rig.md, 6


@njit
def plate_pressure(model, present, before, pressure, step):
    """Return the pressure [Pa] on the plates after a `step` [s], behind the lag of the piston.

    It was `present` [Pa]; the cylinder pressure [Pa] has gone linearly from `before` to `pressure`.
    """
    lag = model.piston_lag
    if lag <= 0.0 or step <= 0.0:
        return pressure if lag <= 0.0 else present
    behind = lag * (pressure - before) / step
    # docs/rig.md, 3: c_p x' = A p - F, F' = k_stack x', solved for a ramp of p
    return pressure - behind + (present - before + behind) * exp(-step / lag)


@njit
def sliding_level(model, pressure, slip):
    """Return the magnitude s_n [-] of the Coulomb part in steady sliding at `pressure` [Pa] and `slip` [rad/s]."""
    if slip == 0.0:
        return 1.0
    beta_inf = model.beta_inf
    beta = min(1.0, beta_inf + (1.0 - beta_inf) * exp((model.beta_onset - pressure) / model.beta_scale))  # eq. 6.6
    return 1.0 + (beta - 1.0) * exp(-model.stribeck_speed / abs(slip))  # eq. 6.2


@njit
def friction_state(model, state, pressure, slip, step):
    """Return the normalised friction state m [-] after `step` [s] at constant `pressure` [Pa] and `slip` [rad/s]."""
    if slip == 0.0:
        return state
    s_n = sliding_level(model, pressure, slip)
    target = s_n if slip > 0.0 else -s_n
    return target + (state - target) * exp(-model.attraction * step / s_n)  # eq. 6.9, solved over the step


@njit
def reachable_states(model, state, step):
    """Return the lowest and highest m [-] that eq. 6.9 can reach from `state` within `step` [s] at standstill (s_n = 1)."""
    q = exp(-model.attraction * step)
    return -1.0 + (state + 1.0) * q, 1.0 + (state - 1.0) * q


@njit
def coulomb_torque(model, pressure):
    """Return the Coulomb torque M_C [Nm] at `pressure` [Pa]: the torque at which plates begin to slide."""
    return max(0.0, model.coulomb_slope * pressure + model.coulomb_intercept)  # Table 6.4


@njit
def viscous_torque(model, pressure, slip, temperature):
    """Return the viscous torque f [Nm] at `pressure` [Pa], `slip` [rad/s] and oil `temperature` [K], signed as the slip."""
    factor = max(0.0, model.viscous_slope * pressure + model.viscous_intercept)  # Table 6.4
    viscous = factor * viscosity_ratio(model, temperature) * abs(slip) ** model.viscous_exponent  # eq. 6.9
    return viscous if slip >= 0.0 else -viscous
