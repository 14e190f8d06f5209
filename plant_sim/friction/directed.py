"""A contact whose friction differs with the direction of motion, or whose load has a part that is not measured.

What            two models of one family, `up` for motion forwards and `down` for motion backwards, that share one state
Equation        F = F_up for dx > 0, F_down for dx < 0, both under the load W + W_0, W_0 the preload
Assumptions     both have the same springs, so that the state of one is that of the other, and a small stroke does not drift
                (app. D.3, condition 1). At standstill the side counts that the first element pushes against
Valid range     that of the two models
Not modelled    branches of another shape: see `shaped`
References      Janssens 2010, app. D.3 (asymmetric loops); Janot, Gautier and Brunot 2019 (viscous friction that differs)
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from plant_sim.friction import coulomb as _coulomb
from plant_sim.friction import gms as _gms
from plant_sim.friction import lugre as _lugre
from plant_sim.friction import xgms as _xgms
from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.gms import GMS
from plant_sim.friction.kernel import law
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.model import Array, FrictionModel, check_real, check_velocity, require, require_type
from plant_sim.friction.xgms import XGMS
from protocols.errors import InputError

HEADER_SIZE = 1  # parameters before those of the two models: the preload


@njit(inline="always")
def _pick_side(parameters, state, displacement):
    """Return the parameters of the model that acts."""
    half = (parameters.size - HEADER_SIZE) // 2
    forwards = displacement > 0.0 or (displacement == 0.0 and state[0] >= 0.0)
    begin = HEADER_SIZE if forwards else HEADER_SIZE + half
    return parameters[begin : begin + half]


@law
def directed_coulomb(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; parameters W_0, those of `coulomb` forwards, and backwards."""
    return _coulomb.coulomb(
        _pick_side(parameters, state, displacement), state, displacement, dt, load + parameters[0], new_state
    )


@law
def directed_lugre(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; parameters W_0, those of `lugre` forwards, and backwards."""
    return _lugre.lugre(
        _pick_side(parameters, state, displacement), state, displacement, dt, load + parameters[0], new_state
    )


@law
def directed_gms(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; parameters W_0, those of `gms` forwards, and backwards."""
    return _gms.gms(
        _pick_side(parameters, state, displacement), state, displacement, dt, load + parameters[0], new_state
    )


@law
def directed_xgms(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; parameters W_0, those of `xgms` forwards, and backwards."""
    return _xgms.xgms(
        _pick_side(parameters, state, displacement), state, displacement, dt, load + parameters[0], new_state
    )


_LAWS = {Coulomb: directed_coulomb, LuGre: directed_lugre, GMS: directed_gms, XGMS: directed_xgms}


@dataclass(frozen=True, eq=False)
class Directed(FrictionModel):
    """`up` for motion forwards and `down` backwards, of one family, under the load given and `preload` W_0 [N].

    Families are Coulomb, LuGre, GMS and XGMS; the springs of both must be equal. Raises InputError.
    """

    up: FrictionModel
    down: FrictionModel
    preload: float = 0.0

    def __post_init__(self) -> None:
        require_type("model forwards", self.up, *_LAWS)
        require_type("model backwards", self.down, type(self.up))
        require("preload", self.preload, least=0.0, unit="N")
        springs = [np.ravel(getattr(one, "stiffness", 0.0)) for one in (self.up, self.down)]
        if springs[0].shape != springs[1].shape or not np.allclose(springs[0], springs[1], rtol=1e-9, atol=0.0):
            raise InputError(
                f"springs are {springs[0]} N/m forwards and {springs[1]} N/m backwards; they must be equal"
            )
        object.__setattr__(self, "law", _LAWS[type(self.up)])

    @cached_property
    def parameters(self) -> Array:
        """W_0, those of the model forwards, and backwards."""
        return np.concatenate([[self.preload], self.up.parameters, self.down.parameters])

    def rest(self, load: float = 1.0) -> Array:
        """Return the state that both models share."""
        return self.up.rest(load + self.preload)

    def steady_state(self, velocity: Array | float, load: Array | float = 1.0) -> Array:
        """Return the force [N] after long sliding at `velocity` [m/s], same shape."""
        velocity = check_velocity(velocity)
        loads = check_real("load", load) + self.preload
        forwards, backwards = (one.steady_state(velocity, loads) for one in (self.up, self.down))  # type: ignore[arg-type]
        return np.where(velocity >= 0.0, forwards, backwards)
