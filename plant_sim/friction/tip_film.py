"""Oil film under the tip of an asperity: two Rayleigh steps back to back, and when the tip slides on it.

What            the Rayleigh-step bearing in the units of the asperities, its friction coefficient, thresholds of wet slip
Equation        Lambda = 6 eta V L/dh^2,  sigma = 12 eta L^2/dh^2 (time in its own unit),  W_n = W/A           (2.55, 2.56)
                steady: Lambda A/W = 2 (h^3 + alpha H^3)/(alpha (1 + alpha)) = r(h)                                   (2.27)
                mu = dh/L [1/(1 + alpha) + r/3 (1/H + alpha/h)]: pressure of one step, shear of both                    (2.34)
                wet slip may begin where Lambda A/W >= r(h_thr)
Assumptions     as rayleigh_step; the same film under every tip; at h = h_thr the tip rests on the surface
Valid range     mu above the least one of the film, where friction falls with speed
Not modelled    the film before the contact begins (a tip arrives dry)
References      Janssens 2010, sec. 2.4.2
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from plant_sim.friction.model import require
from protocols.errors import InputError

THINNEST, THICKEST = 1e-9, 1e3  # h [-], range in which thresholds are searched; chosen


@dataclass(frozen=True)
class TipFilm:
    """Film under a tip: ratio `alpha` [-], `length` L and `step` dh of its steps, `area` A = L times width, `viscosity` eta.

    In any units consistent with those of the asperities. Raises InputError.
    """

    alpha: float
    length: float
    step: float
    area: float
    viscosity: float

    def __post_init__(self) -> None:
        require("length ratio alpha", self.alpha, above=0.0, most=1e6)
        require("length of the tip L", self.length, above=0.0)
        require("step height dh", self.step, above=0.0)
        require("area of the film", self.area, above=0.0)
        require("viscosity", self.viscosity, above=0.0)

    @property
    def slope(self) -> float:
        """dh/L [-]."""
        return self.step / self.length

    @property
    def sliding_per_velocity(self) -> float:
        """Lambda/V."""
        return 6.0 * self.viscosity * self.length / self.step**2  # 2.55

    @property
    def squeeze_number(self) -> float:
        """sigma, with time in its own unit (omega = 1)."""
        return 12.0 * self.viscosity * (self.length / self.step) ** 2  # 2.56

    def ratio(self, gap: float) -> float:
        """Return Lambda A/W [-] at which the film carries W at `gap` h above 0 in steady sliding. Raises InputError."""
        require("gap of the film", gap, above=0.0)
        return 2.0 * (gap**3 + self.alpha * (gap + 1.0) ** 3) / (self.alpha * (1.0 + self.alpha))  # 2.27

    def coefficient(self, gap: float) -> float:
        """Return the friction coefficient [-] of steady sliding at `gap` h above 0. Raises InputError."""
        shear = self.ratio(gap) / 3.0 * (1.0 / (gap + 1.0) + self.alpha / gap)  # both steps
        return self.slope * (1.0 / (1.0 + self.alpha) + shear)  # 2.34

    @cached_property
    def least(self) -> tuple[float, float]:
        """Gap h of the least friction coefficient, and that coefficient [-]."""
        bounds = (np.log(THINNEST), np.log(THICKEST))
        minimum = minimize_scalar(
            lambda x: np.log(self.coefficient(np.exp(x))), bounds=bounds, method="bounded", options={"xatol": 1e-10}
        )
        gap = float(np.exp(minimum.x))
        return gap, self.coefficient(gap)

    def gap_at(self, mu: float) -> float:
        """Return the gap h at which the friction coefficient has fallen to `mu` [-]. Raises InputError."""
        gap, least = self.least
        require("friction coefficient where the film begins", mu, above=least, most=self.coefficient(THINNEST))
        return float(brentq(lambda h: self.coefficient(h) - mu, THINNEST, gap, xtol=1e-15, rtol=1e-14))


@dataclass(frozen=True)
class SlidingThreshold:
    """Wet slip above the Lambda at which a steady film is `gap` h_thr thick, dry below it at once. Raises InputError."""

    gap: float

    def __post_init__(self) -> None:
        require("gap of the threshold", self.gap, above=0.0)

    @classmethod
    def at_friction(cls, film: TipFilm, mu: float) -> "SlidingThreshold":
        """Return the threshold at which the film's coefficient is `mu` [-]: mu_0 for a continuous Stribeck curve.

        Raises InputError.
        """
        return cls(film.gap_at(mu))

    @property
    def dry_below(self) -> float:
        """Gap h below which a film too slow to carry its load becomes dry contact: any."""
        return np.inf


@dataclass(frozen=True)
class GapThreshold(SlidingThreshold):
    """Wet slip begins at the same Lambda, but lasts until the film is squeezed to `gap` h_thr. Raises InputError."""

    @property
    def dry_below(self) -> float:
        """Gap h below which a film too slow to carry its load becomes dry contact: h_thr."""
        return self.gap


def check_threshold(film: TipFilm, threshold: SlidingThreshold, mu_0: float, mu_inf: float) -> None:
    """Raise InputError unless the film's coefficient falls at the threshold and lies within mu_0..mu_inf (sec. 2.4.2)."""
    require("gap of the threshold", threshold.gap, most=film.least[0])
    mu = film.coefficient(threshold.gap)
    if not mu_0 * (1.0 - 1e-9) <= mu <= mu_inf * (1.0 + 1e-9):
        raise InputError(
            f"friction coefficient of the film at the threshold is {mu:g}; allowed is mu_0 to mu_inf, {mu_0:g} to {mu_inf:g}"
        )
