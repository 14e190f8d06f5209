"""Asperities of the Generic model with random properties, and their stick-time-dependent friction coefficient.

Equation        mu(t) = mu_0 + (mu_inf - mu_0) (1 - exp(-t/tau_t))                                        (2.2)
                k_n = (2 - nu)/(2 (1 - nu)) k_t                                                           (2.1)
References      Janssens 2010, secs. 2.2.1 and 2.2.3
"""

from dataclasses import dataclass

import numpy as np

from plant_sim.friction.mindlin import stiffness_ratio
from plant_sim.friction.model import Array, check_element_values, check_real, require
from plant_sim.friction.whole_number import require_whole
from protocols.errors import InputError


@dataclass(frozen=True)
class StickTimeFriction:
    """Friction coefficient that grows from `mu_0` to `mu_inf` [-] with the time in stick, time constant `tau` (eq 2.2).

    Raises InputError.
    """

    mu_0: float
    mu_inf: float
    tau: float

    def __post_init__(self) -> None:
        require("friction coefficient mu_0", self.mu_0, above=0.0)
        require("friction coefficient mu_inf", self.mu_inf, least=self.mu_0)
        require("time constant tau_t", self.tau, above=0.0, unit="s")

    def __call__(self, stick_time: Array | float) -> Array:
        """Return the coefficient [-] after `stick_time` [s] of 0 or more, same shape (eq 2.2). Raises InputError."""
        times = check_real("time in stick", stick_time)
        require("least time in stick", float(times.min(initial=0.0)), least=0.0, unit="s")
        return self.mu_0 - (self.mu_inf - self.mu_0) * np.expm1(-times / self.tau)  # 2.2


@dataclass(frozen=True, eq=False)
class Asperities:
    """N asperities: tangential `position`, `height` z, tangential `stiffness` k_t, `mass`, each (N,).

    Heights count as in eq 2.4: the larger z_i, the later an asperity touches.

    `poisson` nu [-] gives the normal stiffness (eq 2.1). Raises InputError.
    """

    position: Array
    height: Array
    stiffness: Array
    mass: Array | float = 0.0
    poisson: float = 0.3  # of steel; chosen: the thesis gives no material

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", check_element_values("asperity position", self.position, above=-np.inf))
        object.__setattr__(self, "height", check_element_values("asperity height", self.height, above=-np.inf))
        object.__setattr__(self, "stiffness", check_element_values("tangential stiffness", self.stiffness))
        mass = np.full(self.position.size, self.mass) if np.ndim(self.mass) == 0 else self.mass
        object.__setattr__(self, "mass", check_element_values("asperity mass", mass, above=-np.inf))
        require("least asperity mass", float(np.min(self.mass)), least=0.0)
        sizes = [v.size for v in (self.position, self.height, self.stiffness, np.asarray(self.mass))]
        if len(set(sizes)) != 1:
            counts = ", ".join(map(str, sizes))
            raise InputError(
                f"asperities have {counts} positions, heights, stiffnesses, masses; the numbers must be equal"
            )
        stiffness_ratio(self.poisson)

    @classmethod
    def draw(
        cls,
        count: int,
        rng: np.random.Generator,
        length: float = 20.0,
        roughness: float = 0.05,
        spread: float = 0.3,
        mass: float = 0.0,
        poisson: float = 0.3,
    ) -> "Asperities":
        """Draw `count` asperities N with the total tangential stiffness 1 and the total `mass`.

        Positions are uniform over `length`, heights normal with standard deviation `roughness`, stiffness log-normal
        with standard deviation `spread` of its logarithm (the thesis names no distributions; these are chosen here, log-normal
        because a stiffness is positive). Raises InputError.
        """
        require_whole("number of asperities", count)
        require("length", length, least=0.0)
        require("roughness", roughness, least=0.0)
        require("spread of the stiffness", spread, least=0.0, most=10.0)
        position = rng.uniform(0.0, length, count)
        height = roughness * rng.standard_normal(count)
        stiffness = np.exp(spread * rng.standard_normal(count))
        return cls(position, height, stiffness / stiffness.sum(), mass / count, poisson)

    @property
    def normal_stiffness(self) -> Array:
        """Normal stiffness k_n (N,)."""
        return stiffness_ratio(self.poisson) * self.stiffness  # 2.1
