"""The Stribeck curve: friction at constant velocity.

What            the force after long sliding, from static friction over the velocity-weakening range to viscous friction
Equation        S(v) = sign(v) [s(|v|) + f(|v|)]
                s(v) = F_S (1 + (beta - 1) exp(-V_S/|v|)),  f(v) = C_v |v|^gamma                               (1.4, 1.5, 6.2)
                4.1 is the same with beta = 1 - 1/a_1 and C_v = F_s sigma_v; 4.2 gives F_s from the normal load
Assumptions     even in speed; the viscous part acts at once, the Stribeck part may lag
Valid range     any velocity; s falls from F_S at rest to beta F_S, and is flat at rest (all its derivatives are 0 there)
Not modelled    temperature, wear
References      Janssens 2010, secs. 1.6.3.3, 4.2.3, 5.6, 6.2.3
"""

from dataclasses import dataclass
from math import exp

import numpy as np
from numba import njit

from plant_sim.friction.model import Array, check_velocity, require

FLAT = 700.0  # V_S/|v|, above which exp(-V_S/|v|) is 0 in double precision beside any power of it


@njit(inline="always")
def relative_level(speed, beta, stribeck_velocity):
    """Return s/F_S [-] at `speed` = |v| [m/s]: 1 at rest, beta far above V_S (eq 1.4)."""
    if speed <= 0.0:
        return 1.0
    return 1.0 + (beta - 1.0) * exp(-stribeck_velocity / speed)  # 1.4


@njit(inline="always")
def viscous_force(speed, viscous, exponent):
    """Return C_v |v|^gamma [N] (eq 1.4)."""
    if viscous == 0.0 or speed <= 0.0:
        return 0.0
    return viscous * speed**exponent  # 1.4


@dataclass(frozen=True)
class Stribeck:
    """Stribeck curve of eq 1.4.

    `static_force` F_S [N], `beta` F_C/F_S [-], `stribeck_velocity` V_S [m/s] (infinite: Coulomb friction at F_S),
    `viscous` C_v [N/(m/s)^gamma], `exponent` gamma [-]. Raises InputError.
    """

    static_force: float
    beta: float = 1.0
    stribeck_velocity: float = np.inf
    viscous: float = 0.0
    exponent: float = 1.0

    def __post_init__(self) -> None:
        require("static force", self.static_force, above=0.0, unit="N")
        require("beta", self.beta, above=0.0, most=10.0)
        require("Stribeck velocity", self.stribeck_velocity, above=0.0, most=np.inf, unit="m/s")
        require("viscous factor", self.viscous, least=0.0, unit="N/(m/s)^gamma")
        require("viscous exponent", self.exponent, above=0.0, most=10.0)

    @classmethod
    def from_depth(cls, static_force: float, a_1: float, v_s: float, sigma_v: float, gamma: float) -> "Stribeck":
        """Return the curve in the parameters of eq 4.1: depth a_1 [-] (above 1), v_s [m/s], sigma_v [(s/m)^gamma]."""
        require("depth a_1", a_1, above=1.0)
        return cls(static_force, 1.0 - 1.0 / a_1, v_s, static_force * sigma_v, gamma)  # 4.1

    @property
    def block(self) -> tuple[float, ...]:
        """F_S, beta, V_S, C_v, gamma, in the order in which laws take them."""
        return (self.static_force, self.beta, self.stribeck_velocity, self.viscous, self.exponent)

    @property
    def highest(self) -> float:
        """The largest value of s over all velocities [N]."""
        return self.static_force * max(1.0, self.beta)

    def s(self, velocity: Array | float) -> Array:
        """Return the part that lags, s(v) [N], with the sign of v. Raises InputError."""
        velocity = check_velocity(velocity)
        with np.errstate(divide="ignore"):
            decay = np.exp(-self.stribeck_velocity / np.abs(velocity))
        return np.sign(velocity) * self.static_force * (1.0 + (self.beta - 1.0) * decay)  # 1.5

    def f(self, velocity: Array | float) -> Array:
        """Return the viscous part, f(v) [N], with the sign of v. Raises InputError."""
        velocity = check_velocity(velocity)
        return np.sign(velocity) * self.viscous * np.abs(velocity) ** self.exponent  # 1.4

    def slopes(self, velocity: Array | float) -> tuple[Array, Array]:
        """Return ds/dv and df/dv [Ns/m] at `velocity` [m/s], same shape, not 0; negative where friction falls with the speed.

        Raises InputError.
        """
        speed = np.abs(check_velocity(velocity))
        require("least speed", float(speed.min(initial=np.inf)), above=0.0, most=np.inf, unit="m/s")
        with np.errstate(over="ignore", invalid="ignore"):
            times = self.stribeck_velocity / speed  # of V_S
            steepness = np.where(times < FLAT, times / speed * np.exp(-times), 0.0)
        falling = self.static_force * (self.beta - 1.0) * steepness  # d/dv of 1.5
        return falling, self.viscous * self.exponent * speed ** (self.exponent - 1.0)  # d/dv of 1.4

    def __call__(self, velocity: Array | float) -> Array:
        """Return S(v) = s(v) + f(v) [N] at `velocity` [m/s], any shape; 0 at velocity 0. Raises InputError."""
        return self.s(velocity) + self.f(velocity)
