"""Dahl's model: pre-sliding as one smooth hysteresis.

What            force approaches the Coulomb level with the distance since reversal
Equation        dF/dx = sigma |1 - sign(v) F/F_C|^i sign(1 - sign(v) F/F_C)   solved exactly over each displacement
Assumptions     depends on displacement alone; sigma is the stiffness at F = 0
Valid range     pre-sliding and sliding without velocity dependence
Not modelled    non-local memory, Stribeck effect, friction lag
References      Dahl 1968 (Aerospace Corp. TOR-0158(3107-18)-1); Janssens 2010, ref 48
"""

from dataclasses import dataclass
from functools import cached_property
from math import exp

import numpy as np

from plant_sim.friction.kernel import law
from plant_sim.friction.model import Array, FrictionModel, check_velocity, require


@law
def dahl(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; `state` holds it. Parameters F_C, sigma, i."""
    coulomb_force, stiffness, shape = parameters[0], parameters[1], parameters[2]
    direction = np.sign(displacement)
    lack = 1.0 - direction * state[0] / coulomb_force  # 0 when fully sliding, 2 just after a reversal
    distance = stiffness * abs(displacement) / coulomb_force
    if displacement == 0.0 or lack == 0.0:
        new_state[0] = state[0]
        return new_state[0]
    if shape == 1.0:
        left = abs(lack) * exp(-distance)
    else:
        power = abs(lack) ** (1.0 - shape) + (shape - 1.0) * distance
        left = power ** (1.0 / (1.0 - shape)) if power > 0.0 else 0.0  # i < 1 arrives after a finite distance
    new_state[0] = direction * coulomb_force * (1.0 - np.sign(lack) * left)
    return new_state[0]


@dataclass(frozen=True)
class Dahl(FrictionModel):
    """Dahl's model: `coulomb_force` F_C [N], `stiffness` sigma [N/m], `shape` i [-]. Raises InputError."""

    coulomb_force: float
    stiffness: float
    shape: float = 1.0
    law = staticmethod(dahl)

    def __post_init__(self) -> None:
        require("Coulomb force", self.coulomb_force, above=0.0, unit="N")
        require("stiffness", self.stiffness, above=0.0, unit="N/m")
        require("shape i", self.shape, above=0.0, most=10.0)

    @cached_property
    def parameters(self) -> Array:
        """F_C, sigma, i."""
        return np.array([self.coulomb_force, self.stiffness, self.shape])

    def rest(self, load: float = 1.0) -> Array:
        """Return the force [N]: none."""
        return np.zeros(1)

    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Return F_C with the sign of the velocity [N]."""
        return self.coulomb_force * np.sign(check_velocity(velocity))
