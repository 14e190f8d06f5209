"""The five laws that can be identified: which terms each may have, and the friction model that values of its parameters make.

A law begins with its static friction, or with elements, and may get further terms:

viscous             C_v |v|, with `exponent` C_v |v|^gamma                                                    (eq 1.4)
stribeck            beta and V_S of the Stribeck curve                                                          (eq 1.5)
lag                 attraction C of GMS and XGMS                                                                (eq 5.4)
damping             sigma_1 of LuGre
viscous_asymmetry   C_v (1 + b) forwards, C_v (1 - b) backwards
level_asymmetry     the same of the static friction, where the load varies: else an offset of the force is the same
shape               Maxwell-slip: a factor that depends on the place                                            (app. D.3)
fall                friction coefficient that falls with the load                                               (eq 4.2)
preload             a constant part of the load, as of a seal
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.directed import Directed
from plant_sim.friction.gms import GMS
from plant_sim.friction.identification.asymmetric import ShapedElements
from plant_sim.friction.load_law import Amontons, LoadLaw
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import FrictionModel
from plant_sim.friction.shaped import ShapedMaxwellSlip
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.xgms import XGMS
from protocols.errors import InputError, suggest_closest

Values = Mapping[str, float]

RIGID = ("mass", "offset", "delay", "load_gain")  # terms of the rig around the contact (motion_model.py)
# Parameters of each term
PARAMETERS: Mapping[str, tuple[str, ...]] = {
    "mass": ("mass",), "offset": ("offset",), "delay": ("delay",), "load_gain": ("load_gain",), "viscous": ("viscous",),
    "exponent": ("exponent",), "stribeck": ("beta", "stribeck_velocity"), "lag": ("attraction",), "damping": ("damping",),
    "viscous_asymmetry": ("viscous_asymmetry",), "level_asymmetry": ("level_asymmetry",), "shape": ("shape_1", "shape_2"),
    "fall": ("fall", "load_scale"), "preload": ("preload",),
}  # fmt: skip
# A term that needs another one first
NEEDS = {"exponent": "viscous", "viscous_asymmetry": "viscous", "lag": "stribeck"}
EXCLUSIVE = frozenset(
    ("fall", "preload")
)  # two ways in which friction is not proportional to the load; both at once run away
CONSTANTS = ("reference_load", "reach")  # values that are not fitted: load of the limits, half the path of the shape


@dataclass(frozen=True)
class Law:
    """A law by its `name`: the `terms` it may have, numbers of `elements` that are tried, whether it knows the load.

    centred: driven by the speed at a sample, not by the step before it; for a law without memory.
    """

    name: str
    terms: tuple[str, ...]
    elements: tuple[int, ...] = ()
    knows_load: bool = False
    centred: bool = False


LAWS = {
    law.name: law
    for law in (
        Law("stribeck", ("viscous", "stribeck", "exponent", "viscous_asymmetry"), centred=True),
        Law("maxwell-slip", ("shape",), (1, 2, 4, 8)),
        Law("gms", ("viscous", "stribeck", "lag", "viscous_asymmetry"), (1, 2, 4, 8)),
        Law(
            "xgms",
            ("viscous", "stribeck", "lag", "viscous_asymmetry", "level_asymmetry", "fall", "preload"),
            (1, 2, 4, 8),
            knows_load=True,
        ),
        Law("lugre", ("viscous", "stribeck", "damping", "viscous_asymmetry")),
    )
}


def find_law(name: str) -> Law:
    """The law `name`. Raises InputError."""
    if name not in LAWS:
        raise InputError(f"friction law {name!r} is unknown; {suggest_closest(name, LAWS)}")
    return LAWS[name]


@dataclass(frozen=True)
class Structure:
    """A `law` with `elements` (0 where it has none) and `terms`, those of the rig too."""

    law: Law
    elements: int
    terms: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that are fitted."""
        if self.elements:
            numbers = range(1, self.elements + 1)
            own = (*(f"limit_{i}" for i in numbers), *(f"break_point_{i}" for i in numbers))
        else:
            own = ("static_force", *(("stiffness",) if self.law.name == "lugre" else ()))
        return (*own, *(name for term in self.terms for name in PARAMETERS[term]))

    def __str__(self) -> str:
        elements = [f"{self.elements} element{'s' * (self.elements > 1)}"] if self.elements else []
        return " + ".join([self.law.name, *elements, *self.terms])

    def build(self, values: Values) -> FrictionModel:
        """The friction model of `values`. Raises InputError."""
        if self.law.name == "maxwell-slip":
            elements = MaxwellSlip(*self._make_elements(values))
            if "shape" not in self.terms:
                return elements
            shape = np.array([values["shape_1"], values["shape_2"]])
            return ShapedMaxwellSlip(ShapedElements(elements, shape, values["reach"]))
        if {"viscous_asymmetry", "level_asymmetry", "preload"} & set(self.terms):
            return Directed(self._make_side(values, 1.0), self._make_side(values, -1.0), values.get("preload", 0.0))
        return self._make_side(values, 0.0)

    def _make_elements(self, values: Values) -> tuple[np.ndarray, np.ndarray]:
        """Stiffness [N/m] and limit [N] of the elements, (n,)."""
        limits, points = (
            np.array([values[f"{what}_{i}"] for i in range(1, self.elements + 1)]) for what in ("limit", "break_point")
        )
        return limits / points, limits

    def _make_side(self, values: Values, side: float) -> FrictionModel:
        """The model of one direction: 1 forwards, -1 backwards, 0 where both are alike."""
        share = 1.0 + side * values.get("level_asymmetry", 0.0)
        viscous = values.get("viscous", 0.0) * (1.0 + side * values.get("viscous_asymmetry", 0.0))
        beta, speed = values.get("beta", 1.0), values.get("stribeck_velocity", np.inf)
        exponent, attraction = values.get("exponent", 1.0), values.get("attraction", np.inf)
        if not self.elements:
            curve = Stribeck(values["static_force"], beta, speed, viscous, exponent)
            if self.law.name == "stribeck":
                return Coulomb(curve)
            return LuGre(curve, values["stiffness"], values.get("damping", 0.0))
        stiffness, limits = self._make_elements(values)
        level, weights = float(limits.sum()), limits / limits.sum()
        if self.law.name == "gms":
            curve = Stribeck(level, beta, speed, viscous, exponent)
            return GMS(curve, stiffness, weights, attraction * level)
        friction: LoadLaw | Amontons
        load = values["reference_load"] + values.get("preload", 0.0)
        if "fall" in self.terms:
            unit = LoadLaw(1.0, 1.0 / values["fall"], values["load_scale"])
            friction = LoadLaw(share * level / float(unit(load)), unit.a_2, unit.load_scale)
        else:
            friction = Amontons(share * level / load)
        return XGMS(friction, stiffness, weights, beta, speed, viscous / (share * level), exponent, attraction)
