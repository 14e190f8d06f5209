"""Stiffness of an elastic sphere pressed on a flat: normal after Hertz, tangential after Mindlin.

What            why the normal stiffness of an asperity follows from its tangential stiffness
Equation        a = (3 W R / 4 E*)^(1/3),  delta = a^2/R,  W = 4/3 E* R^(1/2) delta^(3/2)
                k_n = dW/ddelta = 2 E* R^(1/2) delta^(1/2) = 2 E* a
                delta_t = 3 mu W/(16 a G*) [1 - (1 - Q/(mu W))^(2/3)],  k_t = dQ/ddelta_t = 8 G* a (1 - Q/(mu W))^(1/3)
                k_n/k_t = E*/(4 G*), for equal materials (2 - nu)/(2 (1 - nu))                            (2.1)
Assumptions     elastic half-spaces, a much smaller than R; tangential force at constant normal load, from rest
Valid range     0 <= Q <= mu W; eq 2.1 holds for full stick, Q much smaller than mu W
Not modelled    plasticity, adhesion of the surfaces, unloading and reversal of Q
References      Janssens 2010, appendix B (Mindlin [62])

The print has 2 E/(1 - nu^2) where E* of two equal bodies is E/(2 (1 - nu^2)); only that gives its own result, eq 2.1.
"""

from dataclasses import dataclass

import numpy as np

from plant_sim.friction.model import Array, check_real, require, require_type
from protocols.errors import InputError


def stiffness_ratio(poisson: float) -> float:
    """Return the normal over tangential stiffness k_n/k_t [-] of one material with Poisson coefficient `poisson` (eq 2.1).

    Raises InputError.
    """
    require("Poisson coefficient", poisson, above=-1.0, most=0.5)  # limits of an isotropic elastic solid
    return (2.0 - poisson) / (2.0 * (1.0 - poisson))  # 2.1


@dataclass(frozen=True)
class Material:
    """Isotropic elastic material: `modulus` E [Pa], `poisson` nu [-]. Raises InputError."""

    modulus: float
    poisson: float

    def __post_init__(self) -> None:
        require("Young's modulus", self.modulus, above=0.0, unit="Pa")
        stiffness_ratio(self.poisson)

    @property
    def shear_modulus(self) -> float:
        """G [Pa]."""
        return self.modulus / (2.0 * (1.0 + self.poisson))


@dataclass(frozen=True)
class SphereOnFlat:
    """Sphere of `radius` R [m] and material `sphere` on a flat of material `flat`. Loads W [N] may be arrays.

    It and its methods raise InputError: loads are 0 or more, those under a tangential force above 0.
    """

    radius: float
    sphere: Material
    flat: Material

    def __post_init__(self) -> None:
        require("radius", self.radius, above=0.0, unit="m")
        for name in ("sphere", "flat"):
            require_type(f"material of the {name}", getattr(self, name), Material)

    @property
    def plane_modulus(self) -> float:
        """E* [Pa]."""
        return 1.0 / sum((1.0 - m.poisson**2) / m.modulus for m in (self.sphere, self.flat))

    @property
    def tangential_modulus(self) -> float:
        """G* [Pa] of appendix B: 1/G* = (2 - nu_1)/G_1 + (2 - nu_2)/G_2."""
        return 1.0 / sum((2.0 - m.poisson) / m.shear_modulus for m in (self.sphere, self.flat))

    def contact_radius(self, load: Array | float) -> Array:
        """Return the radius a [m] of the contact."""
        return np.cbrt(3.0 * _check_loads(load) * self.radius / (4.0 * self.plane_modulus))

    def deflection(self, load: Array | float) -> Array:
        """Return the normal approach delta [m]."""
        return self.contact_radius(load) ** 2 / self.radius

    def load(self, deflection: Array | float) -> Array:
        """Return the normal load W [N] at the approach `deflection` [m]; 0 without contact."""
        depth = np.maximum(check_real("approach", deflection), 0.0)
        return 4.0 / 3.0 * self.plane_modulus * np.sqrt(self.radius) * depth**1.5

    def normal_stiffness(self, load: Array | float) -> Array:
        """Return the local normal stiffness dW/ddelta [N/m]; the global one, W/delta, is 2/3 of it."""
        return 2.0 * self.plane_modulus * self.contact_radius(load)

    def tangential_stiffness(self, load: Array | float, mu: float = 1.0, force: Array | float = 0.0) -> Array:
        """Return the local tangential stiffness dQ/ddelta_t [N/m] at the tangential `force` Q [N]; full stick at Q = 0."""
        return 8.0 * self.tangential_modulus * self.contact_radius(load) * np.cbrt(1.0 - _utilisation(load, mu, force))

    def tangential_deflection(self, load: Array | float, mu: float, force: Array | float) -> Array:
        """Return the tangential displacement delta_t [m] under `force` Q [N], applied from rest.

        Gross sliding begins at Q = mu W.
        """
        left = 1.0 - _utilisation(load, mu, force)
        scale = 3.0 * mu * check_real("load", load) / (16.0 * self.contact_radius(load) * self.tangential_modulus)
        return scale * (1.0 - np.cbrt(left) ** 2)


def _check_loads(load: object) -> Array:
    """Return the loads [N], checked to be 0 or more."""
    loads = check_real("load", load)
    require("least load", float(loads.min(initial=0.0)), least=0.0, unit="N")
    return loads


def _utilisation(load: Array | float, mu: float, force: Array | float) -> Array:
    """Return Q/(mu W) [-], checked to be within 0..1."""
    require("friction coefficient", mu, above=0.0)
    loads = _check_loads(load)
    require("least load under a tangential force", float(loads.min(initial=np.inf)), above=0.0, most=np.inf, unit="N")
    used = check_real("tangential force", force) / (mu * loads)
    if not ((used >= 0.0) & (used <= 1.0)).all():
        raise InputError(f"tangential force is up to {np.max(used):g} of mu W; allowed is 0 to 1")
    return used
