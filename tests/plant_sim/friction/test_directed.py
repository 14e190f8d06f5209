"""Friction that differs with the direction, or with the place: what it is on each side, and that its loops close."""

from itertools import pairwise

import numpy as np
import pytest

from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.coupled import simulate_slide
from plant_sim.friction.directed import Directed
from plant_sim.friction.gms import GMS
from plant_sim.friction.identification.asymmetric import ShapedElements
from plant_sim.friction.load_law import Amontons
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import FrictionModel
from plant_sim.friction.shaped import ShapedMaxwellSlip
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.xgms import XGMS
from protocols.errors import InputError

LOAD, DT = 10.0, 1e-3
STIFFNESS, WEIGHTS = [2e4, 1e4], [0.5, 0.5]


def make_model(name: str, level: float, viscous: float) -> FrictionModel:
    curve = Stribeck(level, 0.7, 0.01, viscous)
    if name == "xgms":
        return XGMS(Amontons(level / LOAD), STIFFNESS, WEIGHTS, 0.7, 0.01, viscous / level)
    made = {
        "coulomb": lambda: Coulomb(curve),
        "lugre": lambda: LuGre(curve, 3e4),
        "gms": lambda: GMS(curve, STIFFNESS, WEIGHTS),
    }
    return made[name]()


families = pytest.mark.parametrize("name", ["coulomb", "lugre", "gms", "xgms"])


@families
def test_each_direction_has_its_own_steady_friction(name: str) -> None:
    up, down = make_model(name, 3.0, 5.0), make_model(name, 2.0, 8.0)
    both = Directed(up, down)
    for speed, one in ((0.05, up), (-0.05, down)):
        force = both.trace(speed * DT * np.arange(2000), DT, LOAD).force[-1]
        assert force == pytest.approx(float(one.steady_state(speed, LOAD)), rel=1e-9)
        assert force == pytest.approx(float(both.steady_state(speed, LOAD)), rel=1e-9)


@families
def test_two_equal_sides_are_the_model_itself(name: str) -> None:
    one = make_model(name, 3.0, 5.0)
    position = 2e-3 * np.sin(2.0 * np.pi * np.arange(3000) * DT)
    both = Directed(one, one).trace(position, DT, LOAD)
    assert np.array_equal(both.force, one.trace(position, DT, LOAD).force)


@pytest.mark.parametrize(("held", "kept"), [(2.5, 2.5), (-2.5, -2.0), (9.0, 3.0)])
def test_at_standstill_the_side_counts_that_the_contact_pushes_against(held: float, kept: float) -> None:
    both = Directed(make_model("coulomb", 3.0, 0.0), make_model("coulomb", 2.0, 0.0))
    assert both.step(np.array([held]), 0.0, DT, LOAD)[0] == kept


def test_preload_adds_to_the_load() -> None:
    one = make_model("xgms", 3.0, 0.0)
    position = 2e-3 * np.sin(2.0 * np.pi * np.arange(3000) * DT)
    preloaded = Directed(one, one, preload=4.0).trace(position, DT, LOAD - 4.0)
    assert preloaded.force == pytest.approx(one.trace(position, DT, LOAD).force, abs=1e-12)


@pytest.mark.parametrize("name", ["gms", "xgms"])
def test_a_small_stroke_does_not_drift(name: str) -> None:
    """Condition 1 of app. D.3: the springs are equal; a loop that no element slips in closes however often it is made."""
    both = Directed(make_model(name, 3.0, 0.0), make_model(name, 2.0, 0.0))
    position = 1e-6 * np.sin(2.0 * np.pi * np.arange(20_001) / 20.0)
    force = both.trace(position, DT, LOAD).force
    assert np.ptp(force[::20]) < 1e-9


def test_a_mass_slides_with_it() -> None:
    """The rigs take it: pushed with 2.5 N it slides backwards, where 2 N hold it, and not forwards, where 3 N do."""
    both = Directed(Coulomb(Stribeck(3.0)), Coulomb(Stribeck(2.0)))
    forwards, backwards = (simulate_slide(both, 1.0, np.full(500, force), DT).position[-1] for force in (2.5, -2.5))
    assert abs(forwards) < 1e-9
    assert backwards == pytest.approx(-0.5 * 0.5 * 0.5**2, rel=0.01)


def test_what_does_not_belong_together_is_refused() -> None:
    with pytest.raises(InputError, match="springs are"):
        Directed(GMS(Stribeck(1.0), STIFFNESS, WEIGHTS), GMS(Stribeck(1.0), [1e4, 1e4], WEIGHTS))
    with pytest.raises(InputError, match="a Coulomb"):
        Directed(Coulomb(Stribeck(1.0)), make_model("lugre", 1.0, 0.0))
    with pytest.raises(InputError, match="preload is -1 N"):
        Directed(make_model("xgms", 1.0, 0.0), make_model("xgms", 1.0, 0.0), preload=-1.0)


class TestShaped:
    SHAPED = ShapedElements(MaxwellSlip([3e4, 1e4], [1.0, 2.0]), np.array([0.2, 0.1]), 1e-3)

    def test_is_the_law_of_the_identification(self) -> None:
        position = 5e-4 * np.sin(np.arange(500) * 0.05) + 2e-4
        assert ShapedMaxwellSlip(self.SHAPED).trace(position, DT).force == pytest.approx(
            self.SHAPED.force(position), abs=1e-12
        )

    def test_returns_through_the_extreme_it_left(self) -> None:
        """Condition 2 of app. D.3, for every stroke."""
        turns = np.array([0.0, 8e-4, 5e-4, 8e-4, -2e-4, 8e-4])
        position = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(turns)])
        force = ShapedMaxwellSlip(self.SHAPED).trace(position, DT).force
        assert force[599] == pytest.approx(force[199])
        assert force[-1] == pytest.approx(force[199])

    def test_starts_where_it_is_put(self) -> None:
        model = ShapedMaxwellSlip(self.SHAPED, start_position=5e-4)
        force, _ = model.step(model.rest(), 1e-6, DT)
        assert force == pytest.approx(float(self.SHAPED.factor(np.array(5.01e-4))) * 4e4 * 1e-6)


def test_beyond_its_reach_a_shape_keeps_its_value() -> None:
    shaped = ShapedElements(MaxwellSlip([1e4, 2e4], [1.0, 3.0]), np.array([0.3, -0.1]), reach=1e-3)
    position = np.concatenate([np.linspace(0.0, 3e-3, 60), np.linspace(3e-3, -2e-3, 100)])
    force = ShapedMaxwellSlip(shaped).trace(position, DT).force
    assert force == pytest.approx(shaped.force(position), rel=1e-12)
    assert force[59] == pytest.approx(4.0 * (1.0 + 0.3 - 0.1), rel=1e-12)
