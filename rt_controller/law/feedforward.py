"""Torque feedforward: the linearised inverse of the XGMS model.

Equation        p_ff = M_d / (level a_Mc + (level + viscous) a_Cv |omega|^gamma) + p_contact                      (6.8)
                With level 1 and viscous 0 this is eq. 6.8. With demand 0 the result is the contact pressure.
Assumptions     Coulomb friction with a viscous part, both proportional to the pressure above contact
Not modelled    Stribeck effect, oil temperature, unless the adaptation changes `viscous` with it
References      Janssens 2010, eq. 6.8
"""

from numba import njit


@njit
def inverse_model(model, demand, slip, level, viscous):
    """Return the pressure demand [Pa] for a torque `demand` [Nm] at `slip` [rad/s]; `level` and `viscous` [-]."""
    slope = model.viscous_slope * abs(slip) ** model.viscous_exponent
    return demand / (level * model.coulomb_slope + (level + viscous) * slope) + model.contact_pressure  # eq. 6.8


@njit
def holding_pressure(model, torque, level):
    """Return the pressure [Pa] at which the plates slide from `torque` [Nm] on: Table 6.4 solved for p; `level` [-]."""
    return (torque / level - model.coulomb_intercept) / model.coulomb_slope
