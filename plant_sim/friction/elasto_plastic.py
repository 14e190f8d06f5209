"""Elasto-plastic model: LuGre with a range in which the bristles do not creep.

What            below the deflection z_ba the bristle is a spring; then it yields and slides
Equation        dz/dt = v [1 - alpha(z, v) sign(v) z/z_ss],  z_ss = s(v)/sigma_0,  F = sigma_0 z + sigma_1 dz/dt + f(v)
                alpha = 0 below z_ba and while z opposes v, 1 above z_ss, a half sine between
Assumptions     constant velocity over a step; the yielding range is integrated over the displacement; z_ba falls with s(v)
                as z_ss does, their ratio is constant
Valid range     pre-sliding, without drift while the deflection stays below z_ba, sliding, friction lag
Not modelled    non-local memory
References      Dupont, Hayward, Armstrong, Altpeter 2002 (IEEE TAC 47:787); Janssens 2010, refs 51, 52
"""

from dataclasses import dataclass
from functools import cached_property
from math import cos, pi, sin

import numpy as np
from numba import njit

from plant_sim.friction.kernel import law
from plant_sim.friction.model import Array, FrictionModel, require, require_type
from plant_sim.friction.stribeck import Stribeck, relative_level, viscous_force

SATURATION_DISTANCE = 30.0  # z_ss; after this distance the deflection differs from z_ss by less than 1e-12 z_ss
# z_ss, longest step of the fourth-order integration in the yielding range; its error is below 1e-7 z_ss
LONGEST_STEP = 0.12


@njit(inline="always")
def _yield_share(deflection, break_away):
    """Return alpha [-] for a deflection in the direction of motion, both in units of z_ss."""
    if deflection <= break_away:
        return 0.0
    if deflection >= 1.0:
        return 1.0
    return 0.5 * sin(pi * (deflection - 0.5 * (1.0 + break_away)) / (1.0 - break_away)) + 0.5


@njit(inline="always")
def _steepness(deflection, break_away):
    """Return the largest d alpha/dz [-] from here to z_ss, per z_ss: what sets the step."""
    middle = 0.5 * (1.0 + break_away)
    angle = pi * max(deflection - middle, 0.0) / (1.0 - break_away)
    return 0.5 * pi / (1.0 - break_away) * cos(angle) if angle < 0.5 * pi else 0.0


@njit(inline="always")
def _slope(deflection, break_away):
    return 1.0 - _yield_share(deflection, break_away) * deflection


@law
def elasto_plastic(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; `state` holds the deflection z [m].

    Parameters F_S, beta, V_S, C_v, gamma, sigma_0, sigma_1, ratio.
    """
    stiffness, damping, ratio = parameters[5], parameters[6], parameters[7]
    if displacement == 0.0:
        new_state[0] = state[0]
        return stiffness * state[0]
    speed, direction = abs(displacement) / dt, np.sign(displacement)
    level = parameters[0] * relative_level(speed, parameters[1], parameters[2])
    whole = level / stiffness  # z_ss [m]
    z, left = direction * state[0] / whole, abs(displacement) / whole
    elastic = min(max(ratio - z, 0.0), left)
    z += elastic  # alpha = 0: a spring
    left -= elastic
    if left > SATURATION_DISTANCE:
        z = 1.0
    elif left > 0.0:
        while left > 0.0:
            h = min(left, LONGEST_STEP / (1.0 + _steepness(z, ratio)))
            a = _slope(z, ratio)
            b = _slope(z + 0.5 * h * a, ratio)
            c = _slope(z + 0.5 * h * b, ratio)
            z += h * (a + 2.0 * b + 2.0 * c + _slope(z + h * c, ratio)) / 6.0
            left -= h
    new_state[0] = direction * z * whole
    rate = displacement / dt * _slope(z, ratio)
    viscous = direction * viscous_force(speed, parameters[3], parameters[4])
    return stiffness * new_state[0] + damping * rate + viscous


@dataclass(frozen=True)
class ElastoPlastic(FrictionModel):
    """Elasto-plastic model with the curve `stribeck`, `stiffness` sigma_0 [N/m], `damping` sigma_1 [Ns/m].

    `break_away` z_ba/z_ss [-], 0 to below 1, is where yielding begins. Raises InputError.
    """

    stribeck: Stribeck
    stiffness: float
    damping: float = 0.0
    break_away: float = 0.7
    law = staticmethod(elasto_plastic)

    def __post_init__(self) -> None:
        require_type("stribeck", self.stribeck, Stribeck)
        require("bristle stiffness", self.stiffness, above=0.0, unit="N/m")
        require("bristle damping", self.damping, least=0.0, unit="Ns/m")
        require("break-away ratio", self.break_away, least=0.0, most=0.999)

    @cached_property
    def parameters(self) -> Array:
        """F_S, beta, V_S, C_v, gamma, sigma_0, sigma_1, z_ba/z_ss."""
        return np.array([*self.stribeck.block, self.stiffness, self.damping, self.break_away])

    def rest(self, load: float = 1.0) -> Array:
        """Return the bristle deflection [m]: none."""
        return np.zeros(1)

    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Return S(v) [N] (eq 1.4)."""
        return self.stribeck(velocity)
