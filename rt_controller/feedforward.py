"""Torque feedforward: the linearised inverse of the XGMS model.

Equation        p_ff = M_d / (level a_Mc + (level + viscous) a_Cv |omega|^gamma) + p_contact                      (6.8)
                With level 1 and viscous 0 this is eq. 6.8 to the letter.
Assumptions     Coulomb friction with a viscous part, both proportional to the pressure above contact
Not modelled    Stribeck effect, oil temperature (unless the adaptation schedules `viscous` with it)
References      Janssens 2010, eq. 6.8
"""

from typing import Protocol

from rt_controller.estimator import Model


class Feedforward(Protocol):
    """Pressure demand [Pa] before feedback."""

    def __call__(self, demand: float, slip: float, level: float, viscous: float) -> float:
        """`demand` [Nm], `slip` [rad/s], `level` and `viscous` [-]."""
        ...


class InverseModel:
    """Feedforward of eq. 6.8."""

    def __init__(self, model: Model) -> None:
        self._model = model

    def __call__(self, demand: float, slip: float, level: float, viscous: float) -> float:
        """See `Feedforward`."""
        model = self._model
        slope = model.viscous_slope * abs(slip) ** model.viscous_exponent
        return demand / (level * model.coulomb_slope + (level + viscous) * slope) + model.contact_pressure  # eq. 6.8


class ContactOnly:
    """No feedforward: the clutch is held filled at the contact pressure, the rest is feedback."""

    def __init__(self, model: Model) -> None:
        self._pressure = model.contact_pressure

    def __call__(self, demand: float, slip: float, level: float, viscous: float) -> float:
        """See `Feedforward`."""
        return self._pressure
