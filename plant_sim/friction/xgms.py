"""Extended GMS (XGMS): GMS under a normal load that varies.

What            friction for control: pre-sliding with non-local memory, Stribeck curve, friction lag, load dependence
Equation        F_s(W_n) from 4.2, s(v, F_s) = F_s (1 + (beta - 1) exp(-V_S/|v|)) with the sign of v                  (5.5, 4.1)
                stick dF_i/dt = k_i v, and on unloading |F_i| <= alpha_i F_s
                slip, normalised as in 6.2.3, F_i = m_i F_s:  dm_i/dt = sign(v) C (alpha_i - m_i/(s/F_s))           (5.5, 6.2.3)
                F = sum F_i + sign(v) F_s sigma_v |v|^gamma
Assumptions     constant velocity over a step, load as at its end: stick and slip under a constant load are exact for any step
Valid range     pre-sliding and gross sliding under any load, also 0; under a constant load it is GMS
Not modelled    dwell time; the normal motion (see `lift_up`). Not passive, as GMS: in slip an element gains force with time or
                load, without displacement (see `passive_xgms`)
References      Janssens 2010, secs. 5.5, 6.2.3, 4.2.3
"""

from dataclasses import dataclass
from functools import cached_property
from math import exp

import numpy as np
from numba import njit

from plant_sim.friction.gms import check_elements
from plant_sim.friction.kernel import law
from plant_sim.friction.load_law import Amontons, LoadLaw, static_force
from plant_sim.friction.model import Array, ElementModel, check_velocity, require, require_type
from plant_sim.friction.sliding_response import SlidingResponse, require_sliding
from plant_sim.friction.stribeck import Stribeck, relative_level, viscous_force

HEADER_SIZE = 8  # parameters before those of the elements


@njit(inline="always")
def advance(parameters, state, displacement, dt, load, new_state, passive):
    """Return the law; with `passive` no spring grows by more than its end moves (`passive_xgms`)."""
    n = state.size // 2
    static = static_force(load, parameters[0], parameters[1], parameters[2])
    direction = 1.0 if displacement >= 0.0 else -1.0
    distance = abs(displacement)
    speed = distance / dt
    relative = relative_level(speed, parameters[3], parameters[4])  # s/F_s
    decay = exp(-parameters[7] / relative * dt)
    highest = max(1.0, parameters[3])
    force = static * viscous_force(speed, parameters[5], parameters[6])  # along the motion, 5.5
    for i in range(n):
        weight, reach = parameters[HEADER_SIZE + n + i], parameters[HEADER_SIZE + i] * distance
        end, most = weight * relative, weight * highest * static
        along = direction * state[i]
        share = direction * state[n + i]  # m_i of an element that slips this way
        if distance == 0.0:  # standstill: sticks
            along = min(max(along, -most), most)
            share = 0.0
        elif share > 0.0:
            share = end + (share - end) * decay  # 6.2.3, slip
            along = min(share * static, along + reach) if passive else share * static
        elif along >= end * static:  # slips from here on
            share = end + (min(along, most) / static - end) * decay if static > 0.0 else end
            along = share * static
        else:
            along = max(along, -most) + reach  # 5.5, stick
            share = end if along >= end * static else 0.0
            along = min(along, end * static)
        new_state[i] = direction * along
        new_state[n + i] = direction * share
        force += along
    return direction * force


@law
def xgms(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; `state` holds F_i [N] (n,) and m_i of slip with its direction, 0 in stick (n,).

    Parameters mu_max, 1/a_2, L, beta, V_S, sigma_v, gamma, C, k_1..k_n, alpha_1..alpha_n.
    """
    return advance(parameters, state, displacement, dt, load, new_state, False)


@dataclass(frozen=True, eq=False)
class XGMS(ElementModel):
    """XGMS model of n elements.

    `friction` gives F_s from the normal load; `beta` [-] and `stribeck_velocity` V_S [m/s] shape s; `viscous` sigma_v
    [(s/m)^gamma] with `exponent` gamma [-] is relative to F_s. `stiffness` k_i [N/m] (n,), `weights` alpha_i [-] (n,) with sum
    1, `attraction` C [1/s] of the normalised force (infinite: no friction lag). Raises InputError.
    """

    friction: LoadLaw | Amontons
    stiffness: Array
    weights: Array
    beta: float = 1.0
    stribeck_velocity: float = np.inf
    viscous: float = 0.0
    exponent: float = 1.0
    attraction: float = np.inf
    law = staticmethod(xgms)

    def __post_init__(self) -> None:
        require_type("friction", self.friction, LoadLaw, Amontons)
        stiffness, weights = check_elements(self.stiffness, self.weights)
        object.__setattr__(self, "stiffness", stiffness)
        object.__setattr__(self, "weights", weights)
        require("beta", self.beta, above=0.0, most=10.0)
        require("Stribeck velocity", self.stribeck_velocity, above=0.0, most=np.inf, unit="m/s")
        require("viscous factor sigma_v", self.viscous, least=0.0, unit="(s/m)^gamma")
        require("viscous exponent", self.exponent, above=0.0, most=10.0)
        require("attraction", self.attraction, above=0.0, most=np.inf, unit="1/s")

    @cached_property
    def parameters(self) -> Array:
        """mu_max, 1/a_2, L, beta, V_S, sigma_v, gamma, C, k_1..k_n, alpha_1..alpha_n."""
        curve = (self.beta, self.stribeck_velocity, self.viscous, self.exponent, self.attraction)
        return np.array([*self.friction.block, *curve, *self.stiffness, *self.weights])

    def rest(self, load: float = 1.0) -> Array:
        """Return the element forces F_i [N] (n,) and normalised forces m_i of slip (n,): no force, all in stick."""
        return np.zeros(2 * self.stiffness.size)

    def steady_state(self, velocity: Array | float, load: Array | float = 1.0) -> Array:
        """Return S(v, F_s) [N] (eq 4.1)."""
        velocity = check_velocity(velocity)
        speed = np.abs(velocity)
        with np.errstate(divide="ignore"):
            relative = 1.0 + (self.beta - 1.0) * np.exp(-self.stribeck_velocity / speed)
        return np.sign(velocity) * self.friction(load) * (relative + self.viscous * speed**self.exponent)  # 4.1

    def linearise(self, velocity: float, load: float = 1.0) -> SlidingResponse:
        """Return the response to small changes of the speed in sliding at `velocity` [m/s], not 0. Raises InputError."""
        velocity = require_sliding(velocity)
        require("load", load, least=0.0, unit="N")
        curve = Stribeck(1.0, self.beta, self.stribeck_velocity, self.viscous, self.exponent)  # normalised, sec. 6.2.3
        static, (falling, viscous) = float(self.friction(load)), map(float, curve.slopes(velocity))
        return SlidingResponse(
            static * falling, static * viscous, abs(float(curve.s(velocity))) / self.attraction
        )  # 6.9
