"""Generic model: friction of a body on many asperities over a counter surface of steps, with a normal degree of freedom.

What            N asperities with drawn positions, heights and stiffness; each an adapted Maxwell-slip element while it is in
                contact (`asperity_contact.py`); the body's separation z_b follows from the normal load
Equation        F = sum F_t,i + sum F_m,i;  k_n = (2 - nu)/(2 (1 - nu)) k_t                               (2.1, 2.9)
                quasi-static:   sum k_n,i zeta_i = W, solved exactly (piecewise linear and monotone in z_b)
                dynamic:        M z_b'' + C z_b' = sum k_n,i zeta_i - W, backward Euler, solved exactly
                fixed:          z_b is given, as in the original model (sec. 2.2.5)
Assumptions     those of `asperity_contact.py`; asperities do not touch each other; masses act tangentially only
Valid range     any dt; displacement of one sample up to 1e5 times the narrowest step or recess (1e9 on a flat surface).
                A sample longer than the narrowest one is divided, so that no asperity passes a contact unnoticed. The cost
                grows with the distance; the division changes the state only by the order dt of the load balance.
                Backward Euler damps vibration of z_b: omega dt/2 is added to its damping ratio
Not modelled    plasticity, floor of the recesses, vibration of a free tip (its energy is lost at once), wear
References      Janssens 2010, sec. 2.2, appendices A and B

Lengths are in heights of a unit step, forces in (total k_t) x (that height), as the thesis's are dimensionless; any
consistent units do as well, when heights z_i and z_b are read from one step height (1 of the unit) down.
State: F_t (N), t (N), mode (N), place (N), then position of the body, z_b, dz_b/dt. A `Trace` holds all of them at every
sample, 32 N bytes each; `GenericModel.observe` keeps sums only.
"""

from dataclasses import dataclass
from functools import cached_property
from math import ceil, isfinite

import numpy as np
from numba import njit

from plant_sim.friction import asperity_contact as contact
from plant_sim.friction import kernel
from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.asperity_model import OBSERVE_SIGNATURE, AsperityModel
from plant_sim.friction.counter_surface import CounterSurface, FlatSurface, segment_at
from plant_sim.friction.model import Array, check_real, require, require_type

# numbers before the arrays: N, 2 N_w, mu_0, mu_inf, tau, period, longest travel, two of the normal motion
HEADER_SIZE = 9
# in `steady_state`; chosen: 200 change the mean force of the model of figure 2.5 by less than 0.02 %
SAMPLES_PER_PITCH = 50
MOST_PARTS = 1e5  # into which a sample is divided; chosen: this many take 1 s for 250 asperities
LONGEST_FLAT_TRAVEL = 1e9  # travel in one sample on a flat surface; chosen: its square, in m v^2/2, does not overflow


@njit(inline="always")
def split_parameters(parameters):
    """Return the position, height, k_t, k_n, mass (N,), edges (2 N_w,), inverse pitch up and down (2 N_w,)."""
    n, e = int(parameters[0]), int(parameters[1])
    a = parameters[HEADER_SIZE : HEADER_SIZE + 5 * n].reshape(5, n)
    b = parameters[HEADER_SIZE + 5 * n :].reshape(3, e)
    return a[0], a[1], a[2], a[3], a[4], b[0], b[1], b[2]


@njit(cache=True)
def _advance(parameters, state, displacement, dt, load, free, new_state):
    """Move by `displacement` and return the friction force; z_b follows from `load` if `free`, and else stays."""
    position, height, tangential, normal, mass, edges, up, down = split_parameters(parameters)
    mu_0, mu_inf, tau, period, longest = parameters[2:7]
    n = position.size
    new_state[:] = state
    asperities = new_state[: 4 * n].reshape(4, n)
    force, stick_time, mode, place = asperities[0], asperities[1], asperities[2], asperities[3]
    travelled, reach = np.empty(n), np.empty(n)
    steps = max(1, ceil(abs(displacement) / longest))
    travel, tick = displacement / steps, dt / steps
    inertia, damping = parameters[7] / tick / tick, parameters[8] / tick  # backward Euler's, as stiffness; if free
    total = 0.0
    for _ in range(steps):
        body = new_state[4 * n]
        contact.search_contacts(
            body, travel, position, height, tangential, edges, period, force, stick_time, mode, place, travelled, reach
        )
        new_state[4 * n] += travel
        if free:
            before, rate = new_state[4 * n + 1], new_state[4 * n + 2]
            offset = load - damping * before - inertia * (before + rate * tick)
            after = contact.balanced_separation(reach, normal, offset, damping + inertia, before)
            new_state[4 * n + 1], new_state[4 * n + 2] = after, (after - before) / tick
        separation = new_state[4 * n + 1]
        total = contact.hold_and_slide(
            reach, separation, tangential, normal, travelled, travel, tick, mu_0, mu_inf, tau, force, stick_time, mode
        )
        total += contact.inertial_force(travel / tick, height, separation, mass, place, up if travel > 0.0 else down)
    return total


@kernel.law
def balanced_law(parameters, state, displacement, dt, load, new_state):
    """Advance a body that is free in the normal direction and return its friction; `parameters` 7 and 8: mass and damping."""
    return _advance(parameters, state, displacement, dt, max(load, 0.0), True, new_state)


@kernel.law
def fixed_law(parameters, state, displacement, dt, load, new_state):
    """Advance a body at fixed separation and return its friction; the given load has no effect."""
    return _advance(parameters, state, displacement, dt, load, False, new_state)


@njit(OBSERVE_SIGNATURE, cache=True)
def _observe(law, parameters, state, position, dt, load, sums):
    """Play `position` from `state`, which becomes the last; write the sums of `AsperitySums` to `sums` (5, n)."""
    arrays, n = split_parameters(parameters), int(parameters[0])
    height, normal, mode = arrays[1], arrays[3], state[2 * n : 3 * n]
    for k in range(position.size):
        sums[0, k] = law(parameters, state, position[k] - position[k - 1], dt, load[k], state) if k > 0 else 0.0
        sums[1, k] = state[4 * n + 1]
        sums[2:, k] = 0.0
        for i in range(n):
            if mode[i] != contact.FREE:
                sums[2, k] += normal[i] * (1.0 - height[i] - state[4 * n + 1])  # 2.5
                sums[3, k] += 1.0
                sums[4, k] += 1.0 if mode[i] == contact.STICK else 0.0


@dataclass(frozen=True)
class AsperitySums:
    """Sums over the asperities at every sample (n,), and the last `state`.

    Friction `force`, `separation` z_b, `normal_force`, number in contact (`touching`), number of these in stick (`sticking`).
    """

    force: Array
    separation: Array
    normal_force: Array
    touching: Array
    sticking: Array
    state: Array


@dataclass(frozen=True, eq=False)
class GenericModel(AsperityModel):
    """The Generic model with quasi-static load balance: `asperities` over a `surface`, their `friction` coefficient.

    Raises InputError.
    """

    law = staticmethod(balanced_law)

    asperities: Asperities
    surface: CounterSurface | FlatSurface
    friction: StickTimeFriction

    def __post_init__(self) -> None:
        require_type("asperities", self.asperities, Asperities)
        require_type("counter surface", self.surface, CounterSurface, FlatSurface)
        require_type("friction coefficient", self.friction, StickTimeFriction)
        require("farthest asperity", float(np.abs(self.asperities.position).max()), most=self.longest)

    @property
    def longest(self) -> float:
        """The longest displacement of one sample: 1e5 of the narrowest step or recess, 1e9 on a flat surface."""
        narrowest = self.surface.narrowest
        return MOST_PARTS * narrowest if isfinite(narrowest) else LONGEST_FLAT_TRAVEL

    @property
    def _normal_motion(self) -> tuple[float, float]:
        return 0.0, 0.0  # mass and damping of the body in the normal direction

    @cached_property
    def parameters(self) -> Array:
        """The parameters as the law takes them, float64 (9 + 5 N + 6 N_w,)."""
        a, s, f = self.asperities, self.surface, self.friction
        header = (a.position.size, s.edges.size, f.mu_0, f.mu_inf, f.tau, s.period, s.narrowest, *self._normal_motion)
        arrays = (a.position, a.height, a.stiffness, a.normal_stiffness, np.asarray(a.mass), s.edges, *s.inverse_pitch)
        return np.concatenate((header, *arrays))

    def rest(self, load: float = 1.0) -> Array:
        """Return the state of a body just put down under `load`: undeflected, in stick where it touches (sec. 2.2.3).

        Raises InputError.
        """
        require("load", load, least=0.0)
        a, s = self.asperities, self.surface
        place = np.array([segment_at(p, 0, s.edges, s.period) for p in a.position], float)
        reach = np.where(place % 2 == 0, 1.0 - a.height, -np.inf)  # 2.4
        separation = self._find_separation_at_rest(reach, load)
        mode = np.where(reach > separation, contact.STICK, contact.FREE)
        zero = np.zeros(a.position.size)
        return np.concatenate((zero, zero, mode, place, (0.0, separation, 0.0)))

    def split(self, state: Array) -> tuple[Array, Array, Array, Array]:
        """Return tangential force, stick time, mode (FREE, STICK, sign of the slip) and place of each asperity.

        Shape (..., N) each.
        """
        force, stick_time, mode, place = np.split(state[..., :-3], 4, axis=-1)
        return force, stick_time, mode, place

    def observe(
        self, position: Array, dt: float, load: Array | float = 1.0, state: Array | None = None
    ) -> AsperitySums:
        """Return the sums over the asperities at every sample of `position` (n,), `dt` apart, under `load` (scalar or (n,)).

        Begins as `trace` does. Raises InputError.
        """
        (force, separation, normal_force, touching, sticking), last = self.play(_observe, position, dt, load, state)
        return AsperitySums(force, separation, normal_force, touching, sticking, last)

    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Return the mean force of long sliding at constant `velocity`, same shape; 0 at velocity 0. Computed by simulation.

        The mean is over one period of the surface, after all deflections have saturated and two steps were passed.
        Raises InputError.
        """
        return np.vectorize(lambda v: self._compute_mean_force(float(v), load), otypes=[float])(
            check_real("velocity", velocity)
        )

    def _compute_mean_force(self, velocity: float, load: float) -> float:
        if velocity == 0.0:
            return 0.0
        start, a = self.rest(load), self.asperities
        deepest = max(0.0, 1.0 - float(a.height.min()) - float(start[-2]))
        # F_t/k_t is never above this
        settling = 2.0 * self.friction.mu_inf * deepest * float((a.normal_stiffness / a.stiffness).max())
        if isinstance(self.surface, CounterSurface):
            pitch = self.surface.period / self.surface.width.size
            settling, stroke, travel = settling + 2.0 * pitch, self.surface.period, pitch / SAMPLES_PER_PITCH
        else:
            settling, stroke, travel = settling + 1e-12, 0.0, (settling + 1e-12) / SAMPLES_PER_PITCH
        before, during = int(np.ceil(settling / travel)), int(np.ceil(stroke / travel))
        position = np.copysign(travel, velocity) * np.arange(before + during + 1)
        return float(self.observe(position, travel / abs(velocity), load, start).force[before:].mean())

    def _find_separation_at_rest(self, reach: Array, load: float) -> float:
        lowest = 1.0 - float(self.asperities.height.max())  # below it all asperities bear load
        return float(contact.balanced_separation(reach, self.asperities.normal_stiffness, load, 0.0, lowest))


@dataclass(frozen=True, eq=False)
class DynamicGenericModel(GenericModel):
    """The Generic model whose body moves in the normal direction: `body_mass` M, `body_damping` C. Raises InputError."""

    body_mass: float
    body_damping: float

    def __post_init__(self) -> None:
        super().__post_init__()
        require("mass of the body", self.body_mass, least=0.0)
        require("damping of the body", self.body_damping, least=0.0)

    @property
    def _normal_motion(self) -> tuple[float, float]:
        return self.body_mass, self.body_damping


@dataclass(frozen=True, eq=False)
class FixedSeparationModel(GenericModel):
    """The original model: the body at a given `separation` z_b, whatever the load. Raises InputError."""

    law = staticmethod(fixed_law)

    separation: float

    def __post_init__(self) -> None:
        super().__post_init__()
        require("separation", self.separation)

    def _find_separation_at_rest(self, reach: Array, load: float) -> float:
        return self.separation
