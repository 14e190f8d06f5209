"""Bad parameters and bad inputs are refused in one sentence that names the thing, its value and what is allowed."""

from collections.abc import Callable

import numpy as np
import pytest

from plant_sim.friction.dahl import Dahl
from plant_sim.friction.elasto_plastic import ElastoPlastic
from plant_sim.friction.gms import GMS
from plant_sim.friction.leuven import Leuven
from plant_sim.friction.lift_up import LiftingXGMS, LiftUp
from plant_sim.friction.load_law import Amontons, LoadLaw
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.passive_xgms import PassiveXGMS
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.xgms import XGMS
from protocols.errors import InputError
from tests.plant_sim.friction.models import LOAD, Case, every_model

CURVE, NAN, INF = Stribeck(2.0), float("nan"), float("inf")

# what is built, the thing that must be named, its value
BAD: list[tuple[Callable[[], object], str, str]] = [
    (lambda: Stribeck(0.0), "static force", "0"),
    (lambda: Stribeck(-1.0), "static force", "-1"),
    (lambda: Stribeck(NAN), "static force", "nan"),
    (lambda: Stribeck(INF), "static force", "inf"),
    (lambda: Stribeck(1.0, 0.0), "beta", "0"),
    (lambda: Stribeck(1.0, 11.0), "beta", "11"),
    (lambda: Stribeck(1.0, 0.5, 0.0), "Stribeck velocity", "0"),
    (lambda: Stribeck(1.0, 0.5, NAN), "Stribeck velocity", "nan"),
    (lambda: Stribeck(1.0, viscous=-0.1), "viscous factor", "-0.1"),
    (lambda: Stribeck(1.0, viscous=INF), "viscous factor", "inf"),
    (lambda: Stribeck(1.0, exponent=0.0), "viscous exponent", "0"),
    (lambda: Stribeck.from_depth(1.0, 1.0, 0.1, 0.0, 1.0), "a_1", "1"),
    (lambda: LoadLaw(0.0, 2.0, 10.0), "friction coefficient", "0"),
    (lambda: LoadLaw(0.1, 1.0, 10.0), "a_2", "1"),
    (lambda: LoadLaw(0.1, 2.0, -5.0), "load scale", "-5"),
    (lambda: Amontons(-0.1), "friction coefficient", "-0.1"),
    (lambda: Dahl(0.0, 1.0), "Coulomb force", "0"),
    (lambda: Dahl(1.0, -2.0), "stiffness", "-2"),
    (lambda: Dahl(1.0, 1.0, 0.0), "shape", "0"),
    (lambda: LuGre(CURVE, 0.0), "stiffness", "0"),
    (lambda: LuGre(CURVE, 1.0, -1.0), "damping", "-1"),
    (lambda: ElastoPlastic(CURVE, INF), "stiffness", "inf"),
    (lambda: ElastoPlastic(CURVE, 1.0, break_away=1.0), "break-away", "1"),
    (lambda: ElastoPlastic(CURVE, 1.0, break_away=-0.1), "break-away", "-0.1"),
    (lambda: MaxwellSlip([1.0, 0.0], [1.0, 1.0]), "stiffness [N/m] of element 2", "0"),
    (lambda: MaxwellSlip([1.0, 2.0], [1.0, NAN]), "limit [N] of element 2", "nan"),
    (lambda: MaxwellSlip([1.0, INF], [1.0, 1.0]), "stiffness [N/m] of element 2", "inf"),
    (lambda: MaxwellSlip([1.0, 2.0], [1.0]), "stiffnesses", "2"),
    (lambda: MaxwellSlip([], []), "stiffness", "(0,)"),
    (lambda: MaxwellSlip([[1.0]], [1.0]), "stiffness", "(1, 1)"),
    (lambda: GMS(CURVE, [1.0, 1.0], [0.5, 0.6]), "weights", "1.1"),
    (lambda: GMS(CURVE, [1.0, 1.0], [1.5, -0.5]), "weight of element 2", "-0.5"),
    (lambda: GMS(CURVE, [1.0, 1.0], [1.0]), "weights", "1"),
    (lambda: GMS(CURVE, [1.0], [1.0], 0.0), "attraction", "0"),
    (lambda: GMS(CURVE, [1.0], [1.0], NAN), "attraction", "nan"),
    (lambda: XGMS(Amontons(0.1), [1.0], [0.9]), "weights", "0.9"),
    (lambda: XGMS(Amontons(0.1), [1.0], [1.0], beta=-0.1), "beta", "-0.1"),
    (lambda: XGMS(Amontons(0.1), [1.0], [1.0], stribeck_velocity=0.0), "Stribeck velocity", "0"),
    (lambda: XGMS(Amontons(0.1), [1.0], [1.0], viscous=-3.0), "viscous factor", "-3"),
    (lambda: XGMS(Amontons(0.1), [1.0], [1.0], exponent=NAN), "viscous exponent", "nan"),
    (lambda: XGMS(Amontons(0.1), [1.0], [1.0], attraction=-1.0), "attraction", "-1"),
    (lambda: Leuven(CURVE, [1.0], [1.9]), "limits", "1.9"),
    (lambda: Leuven(CURVE, [1.0], [2.0], power=0.5), "power", "0.5"),
    (lambda: Leuven(CURVE, [1.0], [2.0], damping=NAN), "damping", "nan"),
]


@pytest.mark.parametrize(("build", "thing", "value"), BAD, ids=[f"{thing}={value}" for _, thing, value in BAD])
def test_bad_parameters_are_refused(build: Callable[[], object], thing: str, value: str) -> None:
    with pytest.raises(InputError) as refused:
        build()
    message = str(refused.value)
    assert thing in message
    assert value in message
    assert any(word in message for word in ("allowed", "needed", "must be"))
    assert "\n" not in message
    assert ". " not in message.strip(".")  # one sentence


@every_model
def test_bad_motions_are_refused(case: Case) -> None:
    model, line = case.model, np.linspace(0.0, 1.0, 5)
    for bad in (
        lambda: model.trace(line, 0.0),
        lambda: model.trace(line, -1.0),
        lambda: model.trace(line, NAN),
        lambda: model.trace(line, INF),
        lambda: model.trace([], 1.0),
        lambda: model.trace([[0.0, 1.0]], 1.0),
        lambda: model.trace([0.0, NAN], 1.0),
        lambda: model.trace([0.0, INF], 1.0),
        lambda: model.trace(line, 1.0, -1.0),
        lambda: model.trace(line, 1.0, NAN),
        lambda: model.trace(line, 1.0, [1.0, 2.0]),
        lambda: model.trace(line, 1.0, state=np.zeros(model.rest().size + 1)),
        lambda: model.trace(line, 1.0, state=np.full(model.rest().size, NAN)),
    ):
        with pytest.raises(InputError):
            bad()


@every_model
def test_a_trace_takes_any_kind_of_array(case: Case) -> None:
    """Lists, integers, slices, arrays that may not be written."""
    position = np.array([0.0, 1.0, -2.0, 5.0, 5.0])
    expected = case.model.trace(position, 1e-3, LOAD).force
    fixed = position.copy()
    fixed.flags.writeable = False
    loads = np.full(5, LOAD)
    for given in (list(position), position.astype(int), np.repeat(position, 2)[::2], fixed):
        np.testing.assert_array_equal(case.model.trace(given, 1e-3, loads).force, expected)
    assert expected[0] == 0.0


@every_model
def test_a_second_trace_goes_on_where_the_first_ended(case: Case) -> None:
    position = np.concatenate([np.linspace(0.0, 2e-5, 40), np.linspace(2e-5, -1e-5, 40)])
    whole = case.model.trace(position, 1e-3, LOAD)
    first = case.model.trace(position[:41], 1e-3, LOAD)
    second = case.model.trace(position[40:], 1e-3, LOAD, first.state[-1])
    np.testing.assert_array_equal(second.force[1:], whole.force[41:])
    np.testing.assert_array_equal(second.state, whole.state[40:])


def test_a_lifting_model_takes_no_other_law_than_it_runs() -> None:
    passive = PassiveXGMS(Amontons(0.1), [1.0], [1.0])
    with pytest.raises(InputError, match="tangential is a PassiveXGMS; it must be an XGMS"):
        LiftingXGMS(passive, LiftUp(1.0, 0.1, 1.0, 1.0, 1e6))
