"""Leuven model: LuGre with the hysteresis of a Maxwell-slip model in the place of its spring.

What            one deflection z whose force F_h(z) has non-local memory; sliding bends z back
Equation        dz/dt = v [1 - sign(F_h/s) |F_h/s|^n],  s(v) with the sign of v,  F = F_h(z) + sigma_1 dz/dt + f(v)
                F_h from N Maxwell-slip elements over z (Lampaert's form: no stack of reversal points)
Assumptions     constant velocity over a step; z is integrated over the displacement by implicit steps of first order
Valid range     pre-sliding with non-local memory, sliding, friction lag
Not modelled    exact closure of inner loops: z creeps whenever F_h is not 0
References      Swevers, Al-Bender, Ganseman, Prajogo 2000 (IEEE TAC 45:675); Lampaert, Swevers, Al-Bender 2002 (IEEE TAC
                47:683); Janssens 2010, ref 22
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from plant_sim.friction.kernel import law
from plant_sim.friction.model import Array, FrictionModel, check_element_values, require, require_type
from plant_sim.friction.stribeck import Stribeck, relative_level, viscous_force
from protocols.errors import InputError

HEADER_SIZE = 7  # parameters before those of the elements
STEP = 0.05  # of s/(n sum k): longest step of z while the number of steps is not yet MOST_STEPS
MOST_STEPS = 200  # the implicit step is stable at any length; a longer one comes from gross sliding, where z is at rest


@njit(inline="always")
def _hysteresis(parameters, state, n, displacement):
    """Return F_h [N] and dF_h/dz [N/m] after `displacement` [m] of z."""
    force = slope = 0.0
    for i in range(n):
        limit = parameters[HEADER_SIZE + n + i]
        trial = state[i] + parameters[HEADER_SIZE + i] * displacement
        if abs(trial) < limit:
            slope += parameters[HEADER_SIZE + i]
        force += min(max(trial, -limit), limit)
    return force, slope


@njit(inline="always")
def _creep(force, level, power):
    """Return 1 - dz/dx [-] for F_h `force` along the motion."""
    ratio = force / level
    return np.sign(ratio) * abs(ratio) ** power


@njit(inline="always")
def _implicit_step(parameters, state, n, direction, h, level, power, scale):
    """Return the motion y of z over a displacement `h`: root of y - h (1 - creep(F_h(y))), which grows with y.

    Bracketed Newton to 1e-13 of `scale` [m].
    """
    start = direction * _hysteresis(parameters, state, n, 0.0)[0]
    y = h * (
        1.0 - _creep(start, level, power)
    )  # the motion without the change of F_h along it: the far end of the bracket
    low, high = min(y, 0.0), max(y, 0.0)
    for _ in range(60):
        force, slope = _hysteresis(parameters, state, n, direction * y)
        force *= direction
        rest = y - h * (1.0 - _creep(force, level, power))
        if rest > 0.0:
            high = y
        else:
            low = y
        step = rest / (1.0 + h * power * abs(force / level) ** (power - 1.0) * slope / level)
        if abs(step) <= 1e-13 * min(h, scale):
            break
        y -= step
        if not low <= y <= high:
            y = 0.5 * (low + high)
    return y


@law
def leuven(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; `state` holds the forces of the elements over z (N,).

    Parameters F_S, beta, V_S, C_v, gamma, sigma_1, n, k_1..k_N, W_1..W_N.
    """
    n = state.size
    damping, power = parameters[5], parameters[6]
    total_stiffness = 0.0
    for i in range(n):
        new_state[i] = state[i]
        total_stiffness += parameters[HEADER_SIZE + i]
    if displacement == 0.0:
        return _hysteresis(parameters, new_state, n, 0.0)[0]
    speed, direction = abs(displacement) / dt, np.sign(displacement)
    level = parameters[0] * relative_level(speed, parameters[1], parameters[2])
    scale = level / total_stiffness  # m, over which F_h changes by s at most
    count = int(min(abs(displacement) * power / (STEP * scale), MOST_STEPS - 1.0)) + 1
    h = abs(displacement) / count
    for _ in range(count):
        y = _implicit_step(parameters, new_state, n, direction, h, level, power, scale)
        for i in range(n):
            limit = parameters[HEADER_SIZE + n + i]
            new_state[i] = min(max(new_state[i] + parameters[HEADER_SIZE + i] * direction * y, -limit), limit)
    force = _hysteresis(parameters, new_state, n, 0.0)[0]
    rate = displacement / dt * (1.0 - _creep(direction * force, level, power))
    return force + damping * rate + direction * viscous_force(speed, parameters[3], parameters[4])


@dataclass(frozen=True, eq=False)
class Leuven(FrictionModel):
    """Leuven model in Lampaert's form.

    `stribeck` is the curve, `stiffness` k_i [N/m] and `limits` W_i [N] (N,) describe F_h(z), their sum at least F_S;
    `power` n [-] sharpens the change to sliding, `damping` sigma_1 [Ns/m]. Raises InputError.
    """

    stribeck: Stribeck
    stiffness: Array
    limits: Array
    power: float = 2.0
    damping: float = 0.0
    law = staticmethod(leuven)

    def __post_init__(self) -> None:
        require_type("stribeck", self.stribeck, Stribeck)
        object.__setattr__(self, "stiffness", check_element_values("stiffness [N/m]", self.stiffness))
        object.__setattr__(self, "limits", check_element_values("limit [N]", self.limits, infinite=True))
        require("power n", self.power, least=1.0, most=50.0)
        require("damping", self.damping, least=0.0, unit="Ns/m")
        if self.stiffness.size != self.limits.size:
            raise InputError(
                f"there are {self.stiffness.size} stiffnesses and {self.limits.size} limits; the numbers must be equal"
            )
        if self.limits.sum() < self.stribeck.highest:
            raise InputError(
                f"the limits have the sum {self.limits.sum():g} N; allowed is at least the highest friction, "
                f"{self.stribeck.highest:g} N"
            )

    @cached_property
    def parameters(self) -> Array:
        """F_S, beta, V_S, C_v, gamma, sigma_1, n, k_1..k_N, W_1..W_N."""
        return np.array([*self.stribeck.block, self.damping, self.power, *self.stiffness, *self.limits])

    def rest(self, load: float = 1.0) -> Array:
        """Return the element forces over z [N]: none."""
        return np.zeros(self.stiffness.size)

    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Return S(v) [N] (eq 1.4)."""
        return self.stribeck(velocity)
