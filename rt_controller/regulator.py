"""Feedback: PI on the estimated torque, PI on the measured pressure, both with a frozen integrator.

Equation        p_fb = k_p e + I,  I' = k_i e,  e = M_d - M_sim                                        (fig 6.16)
                u = p_d + k_p (p_d - p) + I,  I' = k_i (p_d - p),  V = u / k_v                          (rig.md)
Assumptions     `frozen` is true in saturation, out of contact and when the sample is not fresh
References      Janssens 2010, sec. 6.5, fig 6.16; gains of the pressure loop from rig.md
"""

from typing import Protocol


def proportional_integral(
    integral: float, error: float, step: float, k_p: float, k_i: float, frozen: bool
) -> tuple[float, float, float]:
    """Return (proportional term, integral term, next integral term), in the unit of `k_p * error`; `step` [s]."""
    return k_p * error, integral, integral if frozen else integral + k_i * error * step


class TorqueFeedback(Protocol):
    """Pressure [Pa] added to the feedforward; `gains` are k_p [Pa/Nm] and k_i [Pa/(Nm s)], the rest publishes its parts."""

    gains: tuple[float, float]
    proportional: float
    integral: float

    def follow(self, integral: float) -> None:
        """Begin at this `integral` [Pa] when the loop closes."""

    def __call__(self, error: float, step: float, frozen: bool) -> float:
        """`error` [Nm], `step` [s]."""
        ...


class EstimatedTorquePI:
    """PI on demand minus estimated torque."""

    def __init__(self, proportional_gain: float = 0.0, integral_gain: float = 0.0) -> None:
        self.gains = proportional_gain, integral_gain
        self.proportional = self.integral = self._next = 0.0

    def follow(self, integral: float) -> None:
        """See `TorqueFeedback`."""
        self.proportional, self.integral, self._next = 0.0, integral, integral

    def __call__(self, error: float, step: float, frozen: bool) -> float:
        """See `TorqueFeedback`."""
        self.proportional, self.integral, self._next = proportional_integral(
            self._next, error, step, *self.gains, frozen
        )
        return self.proportional + self.integral


class NoFeedback:
    """Feedforward alone."""

    gains = (0.0, 0.0)
    proportional = integral = 0.0

    def follow(self, integral: float) -> None:
        """There is no integral."""

    def __call__(self, error: float, step: float, frozen: bool) -> float:
        """See `TorqueFeedback`."""
        return 0.0
