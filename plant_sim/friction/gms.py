"""Generalised Maxwell-slip (GMS): hysteresis with non-local memory, Stribeck curve and friction lag.

What            the Maxwell-slip model with a sliding law in its elements
Equation        stick dF_i/dt = k_i v;  slip dF_i/dt = sign(v) C (alpha_i - F_i/s(v)), s(v) with the sign of v          (5.4)
                an element slips when |F_i| reaches alpha_i |s(v)|, and until v reverses or becomes zero
                F = sum F_i + f(v)
Assumptions     constant velocity over a step: stick, the change to slip and slip are then exact for any step
Valid range     pre-sliding and gross sliding under a constant load
Not modelled    normal load (see `xgms`), dwell time. Not passive: in slip an element may gain force without displacement, so
                a motion that is fast while it loads the springs and slow while it slips takes energy out
References      Janssens 2010, sec. 5.4; Lampaert, Al-Bender, Swevers 2003; Al-Bender, Lampaert, Swevers 2005 (IEEE TAC 50:1883)
"""

from dataclasses import dataclass
from functools import cached_property
from math import exp

import numpy as np

from plant_sim.friction.kernel import law
from plant_sim.friction.model import Array, ElementModel, check_element_values, require, require_type
from plant_sim.friction.sliding_response import SlidingResponse, require_sliding
from plant_sim.friction.stribeck import Stribeck, relative_level, viscous_force
from protocols.errors import InputError

HEADER_SIZE = 6  # parameters before those of the elements


@law
def gms(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; `state` holds F_i (n,) and the latch (n,): direction of slip, 0 in stick.

    Parameters F_S, beta, V_S, C_v, gamma, C, k_1..k_n, alpha_1..alpha_n.
    """
    n = state.size // 2
    direction = np.sign(displacement)
    force = 0.0
    if direction == 0.0:  # standstill: all stick
        for i in range(n):
            new_state[i] = state[i]
            new_state[n + i] = 0.0
            force += state[i]
        return force
    distance = abs(displacement)
    speed = distance / dt
    level = parameters[0] * relative_level(speed, parameters[1], parameters[2])  # |s(v)|, 1.5
    decay = exp(-parameters[5] / level * dt)  # solution of the slip law over the step, 5.4
    for i in range(n):
        along = direction * state[i]
        limit = parameters[HEADER_SIZE + n + i] * level  # W_i = alpha_i s(v), 5.4
        latch = direction
        if state[n + i] == direction or along >= limit:
            along = limit + (along - limit) * decay  # 5.4, slip
        else:
            along += parameters[HEADER_SIZE + i] * distance  # 5.4, stick
            if along >= limit:
                along = limit  # slips from here on, at the force of steady sliding
            else:
                latch = 0.0
        new_state[i] = direction * along
        new_state[n + i] = latch
        force += along
    return direction * (force + viscous_force(speed, parameters[3], parameters[4]))


@dataclass(frozen=True, eq=False)
class GMS(ElementModel):
    """GMS model of n elements.

    `stribeck` is the curve s(v) + f(v), `stiffness` k_i [N/m] (n,), `weights` alpha_i [-] (n,) with sum 1, `attraction`
    C [N/s] (infinite: no friction lag). Raises InputError.
    """

    stribeck: Stribeck
    stiffness: Array
    weights: Array
    attraction: float = np.inf
    law = staticmethod(gms)

    def __post_init__(self) -> None:
        require_type("stribeck", self.stribeck, Stribeck)
        stiffness, weights = check_elements(self.stiffness, self.weights)
        object.__setattr__(self, "stiffness", stiffness)
        object.__setattr__(self, "weights", weights)
        require("attraction", self.attraction, above=0.0, most=np.inf, unit="N/s")

    @cached_property
    def parameters(self) -> Array:
        """F_S, beta, V_S, C_v, gamma, C, k_1..k_n, alpha_1..alpha_n."""
        return np.array([*self.stribeck.block, self.attraction, *self.stiffness, *self.weights])

    def rest(self, load: float = 1.0) -> Array:
        """Return the element forces [N] (n,) and latches (n,): no force, all in stick."""
        return np.zeros(2 * self.stiffness.size)

    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Return S(v) [N] (eq 1.4)."""
        return self.stribeck(velocity)

    def linearise(self, velocity: float, load: float = 1.0) -> SlidingResponse:
        """Return the response to small changes of the speed in sliding at `velocity` [m/s], not 0. Raises InputError."""
        velocity = require_sliding(velocity)
        falling, viscous = map(float, self.stribeck.slopes(velocity))
        return SlidingResponse(falling, viscous, abs(float(self.stribeck.s(velocity))) / self.attraction)  # 5.4


def check_elements(stiffness: object, weights: object) -> tuple[Array, Array]:
    """Return the stiffnesses [N/m] and weights [-] of the elements, equal in number, the weights with sum 1.

    Raises InputError.
    """
    k, alpha = check_element_values("stiffness [N/m]", stiffness), check_element_values("weight", weights)
    if k.size != alpha.size:
        raise InputError(f"there are {k.size} stiffnesses and {alpha.size} weights; the numbers must be equal")
    if abs(alpha.sum() - 1.0) > 1e-9:
        raise InputError(f"the weights have the sum {alpha.sum():.12g}; it must be 1")
    return k, alpha
