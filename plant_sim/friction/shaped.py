"""Maxwell-slip whose force depends on the place: asymmetric loops that close and do not drift (appendix D.3).

Equation        F = g(x) sum F_i,  g = 1 + c_1 (x/reach) + c_2 (x/reach)^2 + ...,  F_i of `maxwell_slip`
Assumptions     g depends on the position alone, so the memory of the elements is kept
Valid range     |x| up to `reach`, beyond which g keeps its value
Not modelled    Stribeck effect, viscous friction, friction lag
References      Janssens 2010, app. D.3, last sentence; identified by `identification.asymmetric.fit_shaped`
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plant_sim.friction.identification.asymmetric import ShapedElements
from plant_sim.friction.kernel import law
from plant_sim.friction.maxwell_slip import MaxwellSlip, element
from plant_sim.friction.model import LARGEST, Array, FrictionModel, Trace, check_motion, require, require_type


@law
def shaped_maxwell_slip(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; `state` holds F_i (n,) and the position x. Parameters reach, k_1..k_n, W_1..W_n, c_1..c_m."""
    n = state.size - 1
    force = 0.0
    for i in range(n):
        new_state[i] = element(state[i], displacement, parameters[1 + i], parameters[1 + n + i])
        force += new_state[i]
    new_state[n] = state[n] + displacement
    place = min(max(new_state[n] / parameters[0], -1.0), 1.0)
    factor, power = 1.0, 1.0
    for j in range(1 + 2 * n, parameters.size):
        power *= place
        factor += parameters[j] * power
    return factor * force


@dataclass(frozen=True, eq=False)
class ShapedMaxwellSlip(FrictionModel):
    """Maxwell-slip with a shape of its loops: `shaped`, and where a contact at rest is, `start_position` [m].

    Raises InputError.
    """

    shaped: ShapedElements
    start_position: float = 0.0
    law = staticmethod(shaped_maxwell_slip)

    def __post_init__(self) -> None:
        require_type("shaped elements", self.shaped, ShapedElements)
        require("start position", self.start_position, least=-LARGEST, unit="m")

    @property
    def elements(self) -> MaxwellSlip:
        """The elements without the shape."""
        return self.shaped.elements

    @cached_property
    def parameters(self) -> Array:
        """reach, k_1..k_n, W_1..W_n, c_1..c_m."""
        return np.array([self.shaped.reach, *self.elements.parameters, *np.ravel(self.shaped.shape)])

    def rest(self, load: float = 1.0) -> Array:
        """No force, at `start_position`."""
        return np.append(self.elements.rest(load), self.start_position)

    def trace(self, position: Array, dt: float, load: Array | float = 1.0, state: Array | None = None) -> Trace:
        """See `FrictionModel`; without a state the contact is at position[0]."""
        if state is None:
            state = np.append(self.elements.rest(), check_motion(position, load)[0][0])
        return super().trace(position, dt, load, state)

    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Return the force [N] at position 0, where the shape is 1."""
        return self.elements.steady_state(velocity, load)
