"""LuGre: bristles with a Stribeck curve.

What            one bristle deflection z that relaxes to s(v)/sigma_0 with the distance slid
Equation        dz/dt = v - sigma_0 |v|/s(v) z,   F = sigma_0 z + sigma_1 dz/dt + f(v)
Assumptions     constant velocity over a step: z is then exact
Valid range     sliding, friction lag, break-away. Passive (it never gives out energy) for linear viscous friction with
                sigma_2 > sigma_1 (F_S - F_C)/F_C
Not modelled    non-local memory; under a steady load below F_C a small oscillation makes it drift
References      Canudas de Wit, Olsson, Astrom, Lischinsky 1995 (IEEE TAC 40:419); Barabanov, Ortega 2000 (IEEE TAC 45:830);
                Janssens 2010, ref 50
"""

from dataclasses import dataclass
from functools import cached_property
from math import exp

import numpy as np

from plant_sim.friction.kernel import law
from plant_sim.friction.model import Array, FrictionModel, require, require_type
from plant_sim.friction.sliding_response import SlidingResponse, require_sliding
from plant_sim.friction.stribeck import Stribeck, relative_level, viscous_force


@law
def lugre(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; `state` holds the bristle deflection z [m].

    Parameters F_S, beta, V_S, C_v, gamma, sigma_0, sigma_1.
    """
    stiffness, damping = parameters[5], parameters[6]
    if displacement == 0.0:
        new_state[0] = state[0]
        return stiffness * state[0]
    speed, direction = abs(displacement) / dt, np.sign(displacement)
    level = parameters[0] * relative_level(speed, parameters[1], parameters[2])
    end = direction * level / stiffness
    new_state[0] = end + (state[0] - end) * exp(-stiffness * abs(displacement) / level)
    rate = displacement / dt - stiffness * speed / level * new_state[0]
    viscous = direction * viscous_force(speed, parameters[3], parameters[4])
    return stiffness * new_state[0] + damping * rate + viscous


@dataclass(frozen=True)
class LuGre(FrictionModel):
    """LuGre with the curve `stribeck`, bristle `stiffness` sigma_0 [N/m], `damping` sigma_1 [Ns/m]. Raises InputError."""

    stribeck: Stribeck
    stiffness: float
    damping: float = 0.0
    law = staticmethod(lugre)

    def __post_init__(self) -> None:
        require_type("stribeck", self.stribeck, Stribeck)
        require("bristle stiffness", self.stiffness, above=0.0, unit="N/m")
        require("bristle damping", self.damping, least=0.0, unit="Ns/m")

    @property
    def passive(self) -> bool:
        """Whether the model can never give out energy (Barabanov and Ortega; shown for a linear viscous part)."""
        curve = self.stribeck
        if self.damping == 0.0 or curve.beta >= 1.0 or np.isinf(curve.stribeck_velocity):
            return True
        return curve.exponent == 1.0 and curve.viscous > self.damping * (1.0 / curve.beta - 1.0)

    @cached_property
    def parameters(self) -> Array:
        """F_S, beta, V_S, C_v, gamma, sigma_0, sigma_1."""
        return np.array([*self.stribeck.block, self.stiffness, self.damping])

    def rest(self, load: float = 1.0) -> Array:
        """Return the bristle deflection [m]: none."""
        return np.zeros(1)

    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Return S(v) [N] (eq 1.4)."""
        return self.stribeck(velocity)

    def linearise(self, velocity: float, load: float = 1.0) -> SlidingResponse:
        """Return the response to small changes of the speed in sliding at `velocity` [m/s], not 0. Raises InputError."""
        velocity = require_sliding(velocity)
        falling, viscous = map(float, self.stribeck.slopes(velocity))
        lag = float(self.stribeck.s(velocity)) / (self.stiffness * velocity)
        return SlidingResponse(falling, viscous, lag, self.damping / self.stiffness)
