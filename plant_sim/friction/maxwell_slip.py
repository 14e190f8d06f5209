"""Maxwell-slip: hysteresis with non-local memory.

What            N springs in parallel, each with a Coulomb slider (Jenkins elements; also called the parallel Iwan model)
Equation        stick dF_i/dt = k_i v while |F_i| < W_i;  slip dF_i/dt = 0;  F = sum F_i
Assumptions     rate independent; exact for any monotone displacement
Valid range     pre-sliding, and sliding at a constant level
Not modelled    Stribeck effect, viscous friction, friction lag
References      Janssens 2010, sec. 5.2 and appendix D; Iwan 1966; Lampaert 2003
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from plant_sim.friction.kernel import law
from plant_sim.friction.model import Array, ElementModel, check_element_values, check_velocity
from protocols.errors import InputError


@njit(inline="always")
def element(force, displacement, stiffness, limit):
    """Return the force of one element [N] after a displacement [m] from `force` [N]; stiffness [N/m], limit W [N]."""
    return min(max(force + stiffness * displacement, -limit), limit)  # 5.2, stick and slip


@law
def maxwell_slip(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; `state` holds F_i (n,). Parameters k_1..k_n, W_1..W_n."""
    n = state.size
    force = 0.0
    for i in range(n):
        new_state[i] = element(state[i], displacement, parameters[i], parameters[n + i])
        force += new_state[i]
    return force


@dataclass(frozen=True, eq=False)
class MaxwellSlip(ElementModel):
    """Maxwell-slip model of N elements: `stiffness` k_i [N/m] (n,), `limits` W_i [N] (n,).

    An infinite limit makes an element that never slips (appendix D: the non-saturating element). Raises InputError.
    """

    stiffness: Array
    limits: Array
    law = staticmethod(maxwell_slip)

    def __post_init__(self) -> None:
        object.__setattr__(self, "stiffness", check_element_values("stiffness [N/m]", self.stiffness))
        object.__setattr__(self, "limits", check_element_values("limit [N]", self.limits, infinite=True))
        if self.stiffness.size != self.limits.size:
            raise InputError(
                f"there are {self.stiffness.size} stiffnesses and {self.limits.size} limits; the numbers must be equal"
            )

    @cached_property
    def parameters(self) -> Array:
        """k_1..k_n, W_1..W_n."""
        return np.concatenate([self.stiffness, self.limits])

    def rest(self, load: float = 1.0) -> Array:
        """Return the element forces [N]: none."""
        return np.zeros(self.stiffness.size)

    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Return the sum of the limits with the sign of the velocity [N]."""
        velocity, total = check_velocity(velocity), self.limits.sum()
        return np.where(velocity == 0.0, 0.0, np.copysign(total, velocity))
