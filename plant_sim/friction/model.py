"""What every friction model offers: a jitted law, its parameters and state as vectors, and traces made with them."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite
from typing import Any, ClassVar

import numpy as np

from plant_sim.friction import kernel
from protocols.errors import InputError

Array = np.ndarray
MOST = float(np.finfo(float).max)


@dataclass(frozen=True)
class Trace:
    """Friction `force` [N] (n,) and `state` (n, m) at every sample of a played position."""

    force: Array
    state: Array


class FrictionModel(ABC):
    """A friction law with its parameters, validated at construction.

    `law` is the jitted function (`plant_sim.friction.kernel`), `parameters` its float64 vector. The model itself keeps no
    state: it is passed in and comes out.
    """

    law: ClassVar[Any]  # a `kernel.Law`, as staticmethod

    @cached_property
    @abstractmethod
    def parameters(self) -> Array:
        """The parameters as the law takes them, float64 (p,)."""

    @abstractmethod
    def rest(self) -> Array:
        """The state of a contact that has never moved, float64 (m,)."""

    @abstractmethod
    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Force [N] after long sliding at constant `velocity` [m/s], same shape; 0 at velocity 0."""

    def step(self, state: Array, displacement: float, dt: float, load: float = 1.0) -> tuple[float, Array]:
        """Force [N] and new state after `displacement` [m] in `dt` [s] under `load` [N]. Raises InputError."""
        require("time step", dt, above=0.0, unit="s")
        new_state = np.empty_like(state)
        return self.law(self.parameters, state, displacement, dt, load, new_state), new_state

    def trace(self, position: Array, dt: float, load: Array | float = 1.0, state: Array | None = None) -> Trace:
        """Force and state at every sample of `position` [m] (n,), `dt` [s] apart, under `load` [N] (scalar or (n,)).

        The contact begins in `state`, else at rest, at position[0]; the force of that sample is 0.
        Raises InputError.
        """
        position, loads = real("position [m]", position), real("load [N]", load)
        require("time step", dt, above=0.0, unit="s")
        if position.ndim != 1 or position.size < 1:
            raise InputError(f"position has shape {position.shape}; needed is one value or more in one dimension")
        if loads.shape not in ((), position.shape):
            raise InputError(
                f"load has shape {loads.shape}; allowed is one value, or one for each of {position.size} positions"
            )
        require("least load", float(loads.min()), least=0.0, unit="N")
        start = self.rest() if state is None else real("state", state)
        if start.shape != self.rest().shape:
            raise InputError(f"state has shape {start.shape}; that of this model has {self.rest().shape}")
        loads = np.array(np.broadcast_to(loads, position.shape))
        force, states = np.empty(position.size), np.empty((position.size, start.size))
        kernel.trace(self.law, self.parameters, start, position, float(dt), loads, force, states)
        return Trace(force, states)


def require(
    name: str, value: float, above: float = -inf, least: float = -inf, most: float = MOST, unit: str = "-"
) -> None:
    """Raise InputError unless above < value, least <= value <= most; infinity passes only where `most` is infinity."""
    if value > above and least <= value <= most:
        return
    allowed = [f"above {above:g}"] * isfinite(above) + [f"at least {least:g}"] * isfinite(least)
    allowed += [f"at most {most:g}"] * (most < MOST)
    raise InputError(f"{name} is {value:g} {unit}; allowed is a number {' and '.join(allowed)}")


def real(name: str, values: object) -> Array:
    """A copy of `values` as float64, any shape, all finite. Raises InputError."""
    try:
        array = np.array(values, float, order="C")
    except (TypeError, ValueError):
        raise InputError(f"{name} is {values!r:.60}; allowed are numbers") from None
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds {array[~np.isfinite(array)][0]:g}; allowed are finite numbers")
    return array


def elements(name: str, values: object, above: float = 0.0, infinite: bool = False) -> Array:
    """`values` as a float64 vector (n,), n >= 1, all above `above`; finite unless `infinite`. Raises InputError."""
    try:
        vector = np.array(values, float, ndmin=1)
    except (TypeError, ValueError):
        raise InputError(f"{name} is {values!r:.60}; allowed are numbers, one for each element") from None
    if vector.ndim != 1 or vector.size == 0:
        raise InputError(f"{name} has shape {vector.shape}; needed is one value for each element")
    bad = ~(vector > above) | (np.isinf(vector) & (not infinite))
    if bad.any():
        i = int(np.argmax(bad))
        raise InputError(
            f"{name} of element {i + 1} is {vector[i]:g}; allowed is a {'' if infinite else 'finite '}number above {above:g}"
        )
    vector.flags.writeable = False
    return vector
