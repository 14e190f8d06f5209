"""Friction coupled to a linear structure: the displacement of a step from the balance of forces at its end.

What            any law in any structure that is linear over a step, with friction taken at the end of the step
Equation        A u + F(u) = B;  for a mass with damping c and a spring k to ground:
                A = m/dt^2 + c/dt + k,  B = m v/dt + F_ext - k x
Assumptions     backward Euler for the mass: creates no energy; first order in dt
Valid range     A larger than the steepest fall of F with u (by the Stribeck curve: |ds/dv|/dt; with a bristle damper sigma_1:
                sigma_1/dt); then there is one root
Not modelled    terms of second order in dt
References      semi-implicit step with friction at end-of-step velocity, as MuJoCo issue 3443 and Newton PR 3855 do
"""

from dataclasses import dataclass

import numpy as np
from numba import njit, types
from numba.core.types import float64, int64

from plant_sim.friction.kernel import LAW, VECTOR
from plant_sim.friction.model import Array, FrictionModel, check_real, check_signal, require, require_type
from plant_sim.friction.whole_number import require_whole
from protocols.errors import InputError

PROBE_DISPLACEMENT = 1e-200  # m, a displacement so small that it only shows the force against motion in its direction
MOST_ITERATIONS = 100  # of the bracketed search; sticking needs 2, sliding about 6
PRECISION = 4e-15  # relative to the forces of the balance: a few units in the last place


@njit(
    types.UniTuple(float64, 2)(LAW, VECTOR, VECTOR, float64, float64, float64, float64, VECTOR),
    cache=True,
    error_model="numpy",
)
def balance(law, parameters, state, stiffness, drive, dt, load, new_state):
    """Return the displacement u [m] and friction [N] that solve stiffness u + F(u) = drive from `state`; writes `new_state`.

    `stiffness` A [N/m] above 0, `drive` B [N]. A contact that can hold the drive at rest stays at rest, and its friction is the
    drive, whatever force its state holds. The two differ for a law that jumps at velocity 0 (Coulomb; GMS in a step in which
    slip ends).
    """
    forward = law(parameters, state, PROBE_DISPLACEMENT, dt, load, new_state)
    backward = law(parameters, state, -PROBE_DISPLACEMENT, dt, load, new_state)
    if backward <= drive <= forward:
        law(parameters, state, 0.0, dt, load, new_state)
        return 0.0, drive
    near = 0.0
    near_rest = (forward if drive > forward else backward) - drive
    far = -near_rest / stiffness
    far_rest = stiffness * far + law(parameters, state, far, dt, load, new_state) - drive
    while far_rest * near_rest > 0.0:  # friction has fallen with u: the root is further away
        near, near_rest = far, far_rest
        far *= 2.0
        far_rest = stiffness * far + law(parameters, state, far, dt, load, new_state) - drive
    for _ in range(MOST_ITERATIONS):  # regula falsi with the Illinois weight
        u = far - far_rest * (far - near) / (far_rest - near_rest)
        if not min(near, far) <= u <= max(near, far):  # rounding of tiny forces
            u = 0.5 * (near + far)
        force = law(parameters, state, u, dt, load, new_state)
        rest = stiffness * u + force - drive
        if abs(rest) <= PRECISION * (abs(drive) + abs(force)) or u in (near, far):
            return u, force
        if rest * far_rest < 0.0:
            near, near_rest = far, far_rest
        else:
            near_rest *= 0.5
        far, far_rest = u, rest
    return u, force


_SLIDE_SIGNATURE = types.void(
    LAW, VECTOR, VECTOR, float64, float64, float64, types.UniTuple(float64, 2), VECTOR, VECTOR, float64,
    VECTOR, types.Array(types.float64, 2, "C"), int64,
)  # fmt: skip


@njit(_SLIDE_SIGNATURE, cache=True)
def slide_mass(law, parameters, state, mass, damping, stiffness, start, force, load, dt, anchor, motion, every):
    """Simulate as `simulate_slide`, compiled and without its checks: arrays of wrong lengths corrupt memory.

    `mass` [kg], `damping` [Ns/m] to ground, `stiffness` [N/m], `start` position [m] and velocity [m/s], applied `force` [N]
    (n,), `load` [N] (n,). Writes position [m], velocity [m/s] and friction [N] into `motion` (n // every, 3) at every
    `every`-th step; `state` is left at the last one.
    """
    position, velocity = start
    new_state = state.copy()
    A = mass / dt**2 + damping / dt + stiffness
    for i in range(force.size):
        B = mass * velocity / dt + force[i] + stiffness * (anchor[i] - position)
        u, friction = balance(law, parameters, state, A, B, dt, load[i], new_state)
        state[:] = new_state
        position += u
        velocity = u / dt
        if (i + 1) % every == 0:
            motion[i // every, 0] = position
            motion[i // every, 1] = velocity
            motion[i // every, 2] = friction


@dataclass(frozen=True)
class Motion:
    """Position [m], velocity [m/s] and friction [N] (k,) of a sliding mass, and the last state of its contact."""

    position: Array
    velocity: Array
    friction: Array
    state: Array


def simulate_slide(
    model: FrictionModel,
    mass: float,
    force: Array,
    dt: float,
    load: Array | float = 1.0,
    spring: float = 0.0,
    damping: float = 0.0,
    anchor: Array | float = 0.0,
    start: tuple[float, float] = (0.0, 0.0),
    every: int = 1,
) -> Motion:
    """Return the motion of a `mass` [kg] on friction under a `force` [N] (n,), in steps of `dt` [s].

    A `spring` [N/m] holds it to `anchor` [m], a `damping` [Ns/m] to ground; `load` [N] on the contact; these may be one value
    or (n,). `start` is position [m] and velocity [m/s]. Every `every`-th step is kept, n // every in all. Raises InputError.
    """
    require_type("model", model, FrictionModel)
    require("mass", mass, above=0.0, unit="kg")
    require("time step", dt, above=0.0, unit="s")
    require("spring stiffness", spring, least=0.0, unit="N/m")
    require("damping", damping, least=0.0, unit="Ns/m")
    force = check_real("force [N]", force)
    if force.ndim != 1 or force.size == 0:
        raise InputError(f"force has shape {force.shape}; one value or more is needed, in one dimension")
    if require_whole("every", every) > force.size:
        raise InputError(f"every is {every}; allowed is at most the {force.size} steps")
    loads, anchors = check_signal("load", load, force.size), check_signal("anchor", anchor, force.size)
    require("least load", float(loads.min()), least=0.0, unit="N")
    begin = check_real("start [m, m/s]", start)
    if begin.shape != (2,):
        raise InputError(f"start has shape {begin.shape}; it must be position and velocity")
    state, motion = model.rest(float(loads[0])), np.empty((force.size // every, 3))
    slide_mass(
        model.law, model.parameters, state, float(mass), float(damping), float(spring), (begin[0], begin[1]), force, loads,
        float(dt), anchors, motion, every,
    )  # fmt: skip
    position, velocity, friction = motion.T.copy()
    return Motion(position, velocity, friction, state)
