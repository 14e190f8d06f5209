"""Torque estimator: the normal-load dependent part of the XGMS model (eq. 6.9) driven by measured pressure, slip, temperature.

Equation        M_sim = level M_C(p) m + (level + viscous) sign(omega) C_v(p) r_T |omega|^gamma;  m' = sign(omega) C (1 - m/s_n)
Assumptions     gross sliding; measured pressure is the pressure on the plates; one element (sec. 6.2.3)
Valid range     p 2.7..4.2 bar, 0..250 rpm, oil above 35 degC
Not modelled    pre-sliding, seal friction, direction of the stroke
References      Janssens 2010, eqs 6.2, 6.3, 6.6, 6.9, Tables 6.1, 6.4, 6.5. `level` and `viscous` are ours (adaptation.py)
"""

from dataclasses import dataclass
from math import exp, log10


@dataclass(frozen=True, slots=True)
class Model:
    """The controller's calibration of the clutch; SI units (Pa, K, Nm, rad/s), names as in `controller.toml`."""

    coulomb_slope: float
    coulomb_intercept: float
    viscous_slope: float
    viscous_intercept: float
    beta_inf: float
    beta_onset: float
    beta_scale: float
    stribeck_speed: float
    viscous_exponent: float
    attraction: float
    contact_pressure: float
    oil_slope: float
    oil_offset: float
    oil_origin: float
    oil_reference: float
    oil_viscous_gain: float
    motor_inertia: float


def viscosity_ratio(model: Model, temperature: float) -> float:
    """Factor r_T [-] of the viscous torque at `temperature` [K]."""
    A, B, T_0 = model.oil_slope, model.oil_offset, model.oil_origin
    mu = A * log10(max(temperature - T_0, 1.0)) + B  # Janssens 2010, eq. 6.3
    mu_ref = A * log10(model.oil_reference - T_0) + B
    return 1.0 + model.oil_viscous_gain * (mu / mu_ref - 1.0)  # rig.md, 6


def friction_state(model: Model, state: float, pressure: float, slip: float, step: float) -> float:
    """Normalised friction state m [-] after `step` [s] at `pressure` [Pa] and `slip` [rad/s]: exact exponential."""
    if slip == 0.0:
        return state
    beta_inf = model.beta_inf
    beta = min(1.0, beta_inf + (1.0 - beta_inf) * exp((model.beta_onset - pressure) / model.beta_scale))  # eq. 6.6
    s_n = 1.0 + (beta - 1.0) * exp(-model.stribeck_speed / abs(slip))  # eq. 6.2
    target = s_n if slip > 0.0 else -s_n
    return target + (state - target) * exp(-model.attraction * step / s_n)  # eq. 6.9, solved over the step


def torque_parts(model: Model, state: float, pressure: float, slip: float, temperature: float) -> tuple[float, float]:
    """Coulomb part M_C m and viscous part [Nm] of the torque, before level and viscous correction."""
    coulomb = max(0.0, model.coulomb_slope * pressure + model.coulomb_intercept) * state  # eq. 6.9, Table 6.4
    factor = max(0.0, model.viscous_slope * pressure + model.viscous_intercept)
    viscous = factor * viscosity_ratio(model, temperature) * abs(slip) ** model.viscous_exponent  # eq. 6.9
    return coulomb, viscous if slip >= 0.0 else -viscous
