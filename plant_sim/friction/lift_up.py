"""Normal degree of freedom of the XGMS model: sliding lifts the body, and the lighter contact has less friction.

What            a lift-up force grows with speed and lags; it moves a mass on the contact; the contact force loads the friction
Equation        F_N(v) = F_N,inf (1 - exp(-|v|/v_N)), even in v                                                  (fig E.1)
                slip  dF_Ni/dt = C_N (alpha_i - F_Ni/F_N(v));  stick  dF_Ni/dt = -C_N F_Ni/F_N,inf                    (E.2)
                M h'' = sum F_Ni + F_c(h, h') - G,  F_c = K max(0, d - h - tau h')^p,  K d^p = G,
                tau = c/(p K d^(p-1)): a damper that leaves the contact with its stiffness, c at rest under G
                friction: XGMS under the load F_c
Assumptions     constant velocity over a step: the lift-up force is exact; the mass by the trapezoidal rule. G is the
                load given; when it changes, the static approach d follows at once: h is the lift above it
Valid range     normal motion small beside the thickness of the plates; the lift-up force below G
Not modelled    runout of the disks, tilt. The decay in stick is of this project: the thesis leaves it open. It prints sign(v)
                before C_N as for the friction; with F_N even, that equation has no steady state for v < 0 (F_N runs away),
                so there is none here. F_N does not fall with h: a lift-up force above G throws the body off
References      Janssens 2010, appendix E
"""

from dataclasses import dataclass
from functools import cached_property
from math import exp

import numpy as np
from numba import njit

from plant_sim.friction.kernel import law
from plant_sim.friction.model import Array, FrictionModel, check_real, check_velocity, require, require_type
from plant_sim.friction.xgms import HEADER_SIZE as TANGENTIAL_HEAD
from plant_sim.friction.xgms import XGMS, xgms
from protocols.errors import InputError

HEADER_SIZE = 7  # parameters before those of the tangential model
MOST_ITERATIONS = 50  # of Newton's method; the contact force is convex where it acts, so it needs about 4


@njit(inline="always")
def lift_force(speed, highest, speed_scale):
    """Return F_N [N] of steady sliding at `speed` [m/s]: even, 0 at rest, saturating (figs E.1, E.5)."""
    return highest * (1.0 - exp(-speed / speed_scale))


@njit(inline="always")
def contact_force(squeeze, stiffness, power):
    """Return F_c [N] of the contact at `squeeze` d - h - tau h' [m], and its derivative by it [N/m]; never pulls."""
    if squeeze <= 0.0:
        return 0.0, 0.0
    slope = stiffness * squeeze ** (power - 1.0)
    return slope * squeeze, power * slope


@law
def lifting_xgms(parameters, state, displacement, dt, load, new_state):
    """Return the friction [N]; `state` holds that of the XGMS model, F_Ni (n,), h [m], h' [m/s], F_c [N].

    Parameters F_N,inf, v_N, C_N, M, K, p, c and those of the XGMS model.
    """
    highest, speed_scale, attraction, mass = parameters[0], parameters[1], parameters[2], parameters[3]
    stiffness, power, damping = parameters[4], parameters[5], parameters[6]
    n = (state.size - 3) // 3
    tangential = 2 * n
    speed = abs(displacement) / dt
    now = lift_force(speed, highest, speed_scale)
    slide = exp(-attraction / now * dt) if now > 0.0 else 0.0
    rest = exp(-attraction / highest * dt) if highest > 0.0 else 0.0
    direction = np.sign(displacement)
    lift = 0.0
    for i in range(n):
        at = tangential + i
        if direction * state[n + i] > 0.0:
            end = parameters[HEADER_SIZE + TANGENTIAL_HEAD + n + i] * now  # alpha_i F_N(v)
            new_state[at] = end + (state[at] - end) * slide  # E.2, slip
        else:
            new_state[at] = state[at] * rest  # stick: the film squeezes out
        lift += new_state[at]
    approach = (load / stiffness) ** (1.0 / power)  # F_c(0) = G
    time = damping * approach / (power * load) if load > 0.0 else 0.0
    h, rate = state[tangential + n], state[tangential + n + 1]
    before = contact_force(approach - h - time * rate, stiffness, power)[0]
    push = lift - load
    reach = 0.5 * dt + time
    new_rate = rate
    for _ in range(
        MOST_ITERATIONS
    ):  # trapezoidal rule: M (r1 - r) = dt (push + (F_c + F_c1)/2), h1 = h + dt (r + r1)/2
        force, slope = contact_force(approach - h - 0.5 * dt * rate - reach * new_rate, stiffness, power)
        residual = mass * (new_rate - rate) - dt * (push + 0.5 * (before + force))
        change = residual / (mass + 0.5 * dt * reach * slope)
        new_rate -= change
        if abs(change) <= 1e-15 * (abs(new_rate) + speed_scale):
            break
    new_h = h + 0.5 * dt * (rate + new_rate)
    contact = contact_force(approach - new_h - time * new_rate, stiffness, power)[0]
    new_state[tangential + n] = new_h
    new_state[tangential + n + 1] = new_rate
    new_state[tangential + n + 2] = contact
    return xgms(parameters[HEADER_SIZE:], state[:tangential], displacement, dt, contact, new_state[:tangential])


@dataclass(frozen=True, eq=False)
class LiftUp:
    """Parameters of the normal direction.

    `highest` F_N,inf [N], `speed_scale` v_N [m/s], `attraction` C_N [N/s], `mass` M [kg], `stiffness` K [N/m^p] and
    `power` p [-] of the contact, `damping` c [Ns/m] of the contact at rest. Raises InputError.
    """

    highest: float
    speed_scale: float
    attraction: float
    mass: float
    stiffness: float
    power: float = 1.5
    damping: float = 0.0

    def __post_init__(self) -> None:
        require("highest lift-up force", self.highest, least=0.0, unit="N")
        require("speed scale v_N", self.speed_scale, above=0.0, unit="m/s")
        require("attraction C_N", self.attraction, above=0.0, most=np.inf, unit="N/s")
        require("mass", self.mass, above=0.0, unit="kg")
        require("contact stiffness", self.stiffness, above=0.0, unit="N/m^p")
        require("contact power", self.power, least=1.0, most=10.0)
        require("contact damping", self.damping, least=0.0, unit="Ns/m")


@dataclass(frozen=True, eq=False)
class LiftingXGMS(FrictionModel):
    """XGMS model `tangential` loaded by the contact of a body that `normal` lets move; the load given is G = M g + W_n."""

    tangential: XGMS
    normal: LiftUp
    law = staticmethod(lifting_xgms)

    def __post_init__(self) -> None:
        require_type("tangential", self.tangential, XGMS)
        if self.tangential.law is not xgms:
            raise InputError(f"tangential is a {type(self.tangential).__name__}; it must be an XGMS, whose law is used")
        require_type("normal", self.normal, LiftUp)

    @cached_property
    def parameters(self) -> Array:
        """F_N,inf, v_N, C_N, M, K, p, c, then those of the XGMS model."""
        n = self.normal
        head = (n.highest, n.speed_scale, n.attraction, n.mass, n.stiffness, n.power, n.damping)
        return np.concatenate([head, self.tangential.parameters])

    def rest(self, load: float = 1.0) -> Array:
        """Return the state of the XGMS model, F_Ni [N] (n,), h [m], h' [m/s], F_c [N]: at rest on the contact, unloaded."""
        return np.concatenate([self.tangential.rest(), np.zeros(self.tangential.stiffness.size + 3)])

    def steady_state(self, velocity: Array | float, load: Array | float = 1.0) -> Array:
        """Return S(v, F_s) [N] under the load that the lift-up force leaves."""
        loads = check_real("load", load)
        return self.tangential.steady_state(velocity, np.maximum(loads - self.steady_lift_force(velocity), 0.0))

    def steady_lift_force(self, velocity: Array | float) -> Array:
        """Return F_N(v) [N] (fig E.1), same shape as `velocity` [m/s]."""
        return self.normal.highest * -np.expm1(-np.abs(check_velocity(velocity)) / self.normal.speed_scale)

    def lift_force(self, state: Array) -> Array:
        """Return the sum of the lift-up forces [N] of `state` (m,) or (k, m)."""
        n = self.tangential.stiffness.size
        return state[..., 2 * n : 3 * n].sum(axis=-1)

    def lift(self, state: Array) -> Array:
        """Return the lift h [m] of `state` (m,) or (k, m); 0 at rest."""
        return state[..., -3]

    def contact_load(self, state: Array) -> Array:
        """Load on the friction [N] of `state` (m,) or (k, m)."""
        return state[..., -1]
