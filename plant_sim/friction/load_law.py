"""Static friction as a function of the normal load.

What            the friction coefficient falls with load towards a limit
Equation        F_s(W_n) = W_n mu_max [1 - (1/a_2) exp(-L/W_n)]                                                          (4.2)
Assumptions     F_s follows the load at once, without memory
Valid range     W_n >= 0; measured 50 to 1100 N on the tribometer, 500 to 2000 N on the clutch
Not modelled    temperature, dwell time
References      Janssens 2010, sec. 4.2.3, figs 4.14 and 4.16
"""

from dataclasses import dataclass
from math import exp

import numpy as np
from numba import njit

from plant_sim.friction.model import Array, check_real, require


@njit(inline="always")
def static_force(load, coefficient, fall, load_scale):
    """Return F_s [N] under `load` W_n [N]; mu_max, 1/a_2 [-], L [N] (eq 4.2)."""
    if load <= 0.0:
        return 0.0
    if fall == 0.0:
        return load * coefficient
    return load * coefficient * (1.0 - fall * exp(-load_scale / load))  # 4.2


@dataclass(frozen=True)
class LoadLaw:
    """Load dependence of eq 4.2: `coefficient` mu_max [-], `a_2` [-] above 1, `load_scale` L [N]. Raises InputError."""

    coefficient: float
    a_2: float
    load_scale: float

    def __post_init__(self) -> None:
        require("friction coefficient", self.coefficient, above=0.0, most=10.0)
        require("a_2", self.a_2, above=1.0)
        require("load scale", self.load_scale, above=0.0, unit="N")

    @property
    def block(self) -> tuple[float, float, float]:
        """mu_max, 1/a_2, L, in the order in which laws take them."""
        return (self.coefficient, 1.0 / self.a_2, self.load_scale)

    def __call__(self, load: Array | float) -> Array:
        """Return F_s [N] for `load` [N], same shape; 0 where the contact is open (load below 0). Raises InputError."""
        load = np.maximum(check_real("load", load), 0.0)
        coefficient, fall, scale = self.block
        with np.errstate(divide="ignore", over="ignore"):
            return load * coefficient * (1.0 - fall * np.exp(-scale / load))  # 4.2


@dataclass(frozen=True)
class Amontons:
    """Friction proportional to load, F_s = mu W_n: eq 4.2 with 1/a_2 = 0. Raises InputError."""

    coefficient: float

    def __post_init__(self) -> None:
        require("friction coefficient", self.coefficient, above=0.0, most=10.0)

    @property
    def block(self) -> tuple[float, float, float]:
        """mu, 0, 1, in the order in which laws take them."""
        return (self.coefficient, 0.0, 1.0)

    def __call__(self, load: Array | float) -> Array:
        """Return F_s [N] for `load` [N], same shape; 0 where the contact is open (load below 0). Raises InputError."""
        return self.coefficient * np.maximum(check_real("load", load), 0.0)
