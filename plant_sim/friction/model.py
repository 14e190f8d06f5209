"""Base class of the friction models: a jitted law, parameters and state as vectors, and traces computed with them."""

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import Any, ClassVar

import numpy as np

from plant_sim.friction import kernel
from protocols.errors import InputError

Array = np.ndarray
LARGEST = float(np.finfo(float).max)
FASTEST = 1e15  # m/s, of one sample; chosen: far above any motion, and its tenth power, the highest exponent, is finite


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
    def rest(self, load: float = 1.0) -> Array:
        """Return the state of a contact that has never moved, under `load` [N], float64 (m,)."""

    @abstractmethod
    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Return the force [N] after long sliding at constant `velocity` [m/s], same shape; 0 at velocity 0."""

    def start(self, state: Array | None, load: float) -> Array:
        """Return a copy of `state`, checked; without one the contact at rest under `load` [N]. Raises InputError."""
        rest = self.rest(load)
        if state is None:
            return rest
        checked = check_real("state", state)
        if checked.shape != rest.shape:
            raise InputError(f"state has shape {checked.shape}; that of this model has {rest.shape}")
        return checked

    def step(self, state: Array, displacement: float, dt: float, load: float = 1.0) -> tuple[float, Array]:
        """Return the force [N] and new state after `displacement` [m] in `dt` [s] under `load` [N]. Raises InputError."""
        require("displacement", displacement, least=-LARGEST, unit="m")
        require("time step", dt, above=0.0, unit="s")
        require("speed of the step", abs(float(displacement)) / float(dt), most=FASTEST, unit="m/s")
        require("load", load, least=0.0, unit="N")
        new_state = self.start(state, load)
        force = self.law(self.parameters, new_state, float(displacement), float(dt), float(load), new_state)
        return force, new_state

    def trace(self, position: Array, dt: float, load: Array | float = 1.0, state: Array | None = None) -> Trace:
        """Return the force and state at every sample of `position` [m] (n,), `dt` [s] apart, under `load` [N] (scalar or (n,)).

        The contact begins at position[0], at rest without force, or in `state` with the force that it holds at standstill.
        Raises InputError.
        """
        position, loads = check_motion(position, load)
        require("time step", dt, above=0.0, unit="s")
        with np.errstate(over="ignore"):
            fastest = float(np.abs(np.diff(position)).max(initial=0.0)) / float(dt)
        require("speed between two samples", fastest, most=FASTEST, unit="m/s")
        first = self.start(state, float(loads[0]))
        force, states = np.empty(position.size), np.empty((position.size, first.size))
        kernel.trace(self.law, self.parameters, first, position, float(dt), loads, force, states)
        if state is not None:
            force[0] = self.law(self.parameters, first, 0.0, float(dt), float(loads[0]), first)
        return Trace(force, states)


class ElementModel(FrictionModel):
    """A friction model of n springs in parallel, whose state begins with their forces."""

    stiffness: Array

    def forces(self, state: Array) -> Array:
        """Return the element forces F_i [N] of `state` (m,) or (k, m)."""
        return np.asarray(state, float)[..., : self.stiffness.size]

    def energy(self, state: Array) -> Array:
        """Return the energy in the springs [J] of `state` (m,) or (k, m)."""
        return (self.forces(state) ** 2 / (2.0 * self.stiffness)).sum(axis=-1)


def require(
    name: str, value: float, above: float = -inf, least: float = -inf, most: float = LARGEST, unit: str = "-"
) -> None:
    """Raise InputError unless above < value, least <= value <= most; infinity passes only where `most` is infinity."""
    try:
        if isinstance(value, str):
            raise TypeError
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} is {value!r:.60}; allowed is a number") from None
    if number > above and least <= number <= most:
        return
    bounds = {"above": (above, above > -inf), "at least": (least, least > -LARGEST), "at most": (most, most < LARGEST)}
    allowed = [f"{word} {bound:g}" for word, (bound, is_given) in bounds.items() if is_given]
    shown = f"{number:g}" if unit == "-" else f"{number:g} {unit}"
    raise InputError(
        f"{name} is {shown}; allowed is a {'finite ' * (not allowed)}number {' and '.join(allowed)}".rstrip()
    )


def require_type(name: str, value: object, *kinds: type) -> None:
    """Raise InputError unless `value` is an instance of one of `kinds`."""
    if not isinstance(value, kinds):
        names = " or ".join(k.__name__ for k in kinds)
        raise InputError(f"{name} is {value!r:.60}; a {names} is needed")


def check_real(name: str, values: object) -> Array:
    """Return a copy of `values` as float64, any shape, all finite. Raises InputError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", np.exceptions.ComplexWarning)
            array = np.array(values, float, order="C")
    except (TypeError, ValueError, np.exceptions.ComplexWarning):
        raise InputError(f"{name} is {values!r:.60}; allowed are numbers") from None
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds {array[~np.isfinite(array)][0]:g}; allowed are finite numbers")
    return array


def check_velocity(velocity: object) -> Array:
    """Return `velocity` [m/s] as float64, any shape, all within FASTEST. Raises InputError."""
    array = check_real("velocity", velocity)
    require("highest speed", float(np.abs(array).max(initial=0.0)), most=FASTEST, unit="m/s")
    return array


def check_signal(name: str, values: object, samples: int) -> Array:
    """Return `values`, one or one for each of the `samples`, as float64 (samples,). Raises InputError."""
    array = check_real(name, values)
    if array.shape not in ((), (samples,)):
        raise InputError(f"{name} has shape {array.shape}; allowed is one value, or one for each of {samples} samples")
    return np.array(np.broadcast_to(array, (samples,)))


def check_motion(position: object, load: object) -> tuple[Array, Array]:
    """Return the position (n,), n >= 1, and normal load (n,), 0 or more, of a motion for a model. Raises InputError."""
    positions = check_real("position", position)
    if positions.ndim != 1 or positions.size < 1:
        raise InputError(f"position has shape {positions.shape}; one value or more is needed, in one dimension")
    loads = check_signal("load", load, positions.size)
    require("least load", float(loads.min()), least=0.0)
    return positions, loads


def check_element_values(name: str, values: object, above: float = 0.0, infinite: bool = False) -> Array:
    """Return `values` as a float64 vector (n,), n >= 1, all above `above`; finite unless `infinite`. Raises InputError."""
    try:
        vector = np.array(values, float, ndmin=1)
    except (TypeError, ValueError):
        raise InputError(f"{name} is {values!r:.60}; allowed are numbers, one for each element") from None
    if vector.ndim != 1 or vector.size == 0:
        raise InputError(f"{name} has shape {vector.shape}; one value for each element is needed")
    bad = ~(vector > above) | (np.isinf(vector) & (not infinite))
    if bad.any():
        i = int(np.argmax(bad))
        raise InputError(
            f"{name} of element {i + 1} is {vector[i]:g}; allowed is a {'' if infinite else 'finite '}number above {above:g}"
        )
    vector.flags.writeable = False
    return vector
