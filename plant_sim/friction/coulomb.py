"""Coulomb friction with a Stribeck curve: the static model.

What            friction as a function of velocity alone; at rest the force is whatever is applied, up to F_S
Equation        F = S(v) for v != 0                                                                              (1.2-1.4)
Assumptions     no displacement before sliding, no lag
Valid range     gross sliding
Not modelled    pre-sliding, friction lag, break-away that depends on the rate
References      Janssens 2010, sec. 1.6.3.3
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plant_sim.friction.kernel import law
from plant_sim.friction.model import Array, FrictionModel, require_type
from plant_sim.friction.sliding_response import SlidingResponse, require_sliding
from plant_sim.friction.stribeck import Stribeck, relative_level, viscous_force


@law
def coulomb(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; `state` holds the last force, which a contact at rest keeps up to F_S."""
    static_force = parameters[0]
    if displacement == 0.0:
        force = min(max(state[0], -static_force), static_force)  # 1.2: F_a
    else:
        speed = abs(displacement) / dt
        level = static_force * relative_level(speed, parameters[1], parameters[2])
        force = np.sign(displacement) * (level + viscous_force(speed, parameters[3], parameters[4]))  # 1.4
    new_state[0] = force
    return force


@dataclass(frozen=True)
class Coulomb(FrictionModel):
    """Static friction along the curve `stribeck`; with a curve of only F_S Coulomb friction in the narrow sense.

    Raises InputError.
    """

    stribeck: Stribeck
    law = staticmethod(coulomb)

    def __post_init__(self) -> None:
        require_type("stribeck", self.stribeck, Stribeck)

    @cached_property
    def parameters(self) -> Array:
        """F_S, beta, V_S, C_v, gamma."""
        return np.array(self.stribeck.block)

    def rest(self, load: float = 1.0) -> Array:
        """Return the last force [N]: none."""
        return np.zeros(1)

    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Return S(v) [N] (eq 1.4)."""
        return self.stribeck(velocity)

    def linearise(self, velocity: float, load: float = 1.0) -> SlidingResponse:
        """Return the response to small changes of the speed in sliding at `velocity` [m/s], not 0. Raises InputError."""
        return SlidingResponse(*map(float, self.stribeck.slopes(require_sliding(velocity))))
