"""The contacts of chapter 4: paper-based friction material on steel, dry and in transmission oil.

What            friction models for the tribometer, one for each load, with the parameters of `tribometer_contacts.toml`
Equation        F_s(W) eq 4.2; S(v, F_s) eq 4.1; elements of equal stiffness whose limits rise evenly to the travel before gross
                sliding: the virgin curve is a parabola. Stiffness and lift-up force are in proportion to F_s and to the load
Assumptions     a contact that is built for a load is used under it, as stiffness does not follow later changes
Valid range     50 to 1400 N, up to 6.4 rad/s
Not modelled    temperature, running-in, friction that depends on the place
References      Janssens 2010, chapter 4; secs. 2.2, 5.5, appendix E
"""

from pathlib import Path

import numpy as np

from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.counter_surface import FlatSurface
from plant_sim.friction.generic import GenericModel
from plant_sim.friction.lift_up import LiftingXGMS, LiftUp
from plant_sim.friction.load_law import LoadLaw
from plant_sim.friction.model import require
from plant_sim.friction.xgms import XGMS
from plant_sim.rigs.tribometer import Tribometer, load_nominal, mean_radius
from protocols.files.parameters import ParameterSet, load_defaults

DEFAULTS = Path(__file__).parents[1] / "parameters" / "tribometer_contacts.toml"
ELEMENTS = 10  # chosen: with more, the pre-sliding curve is not visibly smoother


class Contacts:
    """Tribometers with the contacts of chapter 4; `parameters` are those of `load_contacts()`, or as changed by a user.

    `seed`: of the sensors' noise, which differs from load to load.
    """

    def __init__(self, parameters: ParameterSet | None = None, seed: int = 0) -> None:
        self.parameters = load_contacts() if parameters is None else parameters
        self._seed = seed
        self._rig = load_nominal()
        self._radius = mean_radius(self._rig)  # m

    def make_dry_rig(self, load: float) -> Tribometer:
        """Return the rig with the dry contact as it is under `load` [N]. Raises InputError."""
        return Tribometer(self._make_xgms("dry", load), self._rig, seed=self._seed + round(load))

    def make_lubricated_rig(self, load: float) -> Tribometer:
        """Return the rig with the contact in oil under `load` [N], which lifts the disk. Raises InputError."""
        film = self.parameters.list_si("film")
        lift = LiftUp(
            highest=film["share"] * load,
            speed_scale=film["speed"] * self._radius,
            attraction=max(film["rate"] * film["share"] * load, np.finfo(float).tiny),
            mass=self._rig["normal.disk_mass"].si + self._rig["normal.shaft_mass"].si,
            stiffness=self._rig["normal.contact_load"].si
            / self._rig["normal.contact_approach"].si ** self._rig["normal.contact_exponent"].si,
            power=self._rig["normal.contact_exponent"].si,
            damping=film["damping"],
        )
        rig = self._rig.with_values({f"lift.{name}": film[name] for name in ("height", "speed", "rate")})
        return Tribometer(LiftingXGMS(self._make_xgms("lubricated", load), lift), rig, seed=self._seed + round(load))

    def make_creeping_rig(self, load: float) -> Tribometer:
        """Return the rig with dry asperities whose friction coefficient grows in stick (eq 2.2).

        It is as stiff as `dry` under `load` [N].

        They break away at most at the static friction of the dry contact and slide at beta of it. Raises InputError.
        """
        values = self.parameters.list_si("asperities")
        static = self.static_coefficient("dry", load)
        beta = self.parameters["dry.beta"].si
        rough = Asperities.draw(round(values["number"]), np.random.default_rng(1), roughness=values["roughness"])
        stiffness = static * load / (0.5 * self.parameters["dry.travel"].si * self._radius)  # N/m
        tips = Asperities(rough.position, rough.height, stiffness * rough.stiffness)
        friction = StickTimeFriction(beta * static, static, values["creep"])
        return Tribometer(GenericModel(tips, FlatSurface(), friction), self._rig, seed=self._seed + round(load))

    def load_law(self, condition: str) -> LoadLaw:
        """Return F_s(W) [N] of the `dry` or `lubricated` contact (eq 4.2)."""
        p = self.parameters.list_si(condition)
        return LoadLaw(p["coefficient"], 1.0 / p["fall"], p["load_scale"])

    def static_coefficient(self, condition: str, load: float) -> float:
        """Return F_s/W [-] of the `dry` or `lubricated` contact under `load` [N]."""
        return float(self.load_law(condition)(load)) / load

    def _make_xgms(self, condition: str, load: float) -> XGMS:
        require("load", load, above=0.0, most=self._rig["load.most"].si, unit="N")
        p = self.parameters.list_si(condition)
        reach = np.arange(1, ELEMENTS + 1) / ELEMENTS * p["travel"] * self._radius  # m, where an element begins to slip
        weights = reach / reach.sum()
        stiffness = np.full(ELEMENTS, float(self.load_law(condition)(load)) / reach.sum())
        return XGMS(
            self.load_law(condition),
            stiffness,
            weights,
            beta=p["beta"],
            stribeck_velocity=p["stribeck_speed"] * self._radius,
            viscous=p["viscous"] / self._radius ** p["exponent"],
            exponent=p["exponent"],
            attraction=p["attraction"],
        )


def load_contacts() -> ParameterSet:
    """Load the parameters of `parameters/tribometer_contacts.toml`."""
    return load_defaults(DEFAULTS)
