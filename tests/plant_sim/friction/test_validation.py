"""Bad parameters and bad inputs are refused in one sentence that names the thing, its value and what is allowed."""

from collections.abc import Callable

import numpy as np
import pytest

from clutch_hil import friction
from plant_sim.friction.asperities import StickTimeFriction
from plant_sim.friction.dahl import Dahl
from plant_sim.friction.directed import Directed
from plant_sim.friction.elasto_plastic import ElastoPlastic
from plant_sim.friction.gms import GMS
from plant_sim.friction.identification.maxwell_slip import virgin_force
from plant_sim.friction.leuven import Leuven
from plant_sim.friction.lift_up import LiftingXGMS, LiftUp
from plant_sim.friction.load_law import Amontons, LoadLaw
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.mindlin import Material, SphereOnFlat
from plant_sim.friction.passive_xgms import PassiveXGMS
from plant_sim.friction.step_bearing import StepBearing
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.tip_film import TipFilm
from plant_sim.friction.xgms import XGMS
from protocols.errors import InputError
from tests.plant_sim.friction.models import CASES, LOAD, Case, every_model

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


XGMS_MODEL = XGMS(Amontons(0.1), [1.0], [1.0])
LIFTING = LiftingXGMS(XGMS_MODEL, LiftUp(1.0, 0.1, 1.0, 1.0, 1e6))
STEEL = Material(2.1e11, 0.3)
BALL, FILM = SphereOnFlat(0.01, STEEL, STEEL), TipFilm(1.5, 2e-4, 4e-6, 1e-6, 1.0)
BEARING = StepBearing(1.5, 0.1, 1e-8)
# evaluations of the library that take a number or an array
OF_A_SPEED = {
    **{case.name: case.model.steady_state for case in CASES},
    "directed": Directed(XGMS_MODEL, XGMS_MODEL).steady_state,
    "lifting": LIFTING.steady_state,
    "lift force": LIFTING.steady_lift_force,
    "curve": CURVE,
    "s": CURVE.s,
    "f": CURVE.f,
    "slopes": CURVE.slopes,
}
OF_A_SIZE = {
    "contact radius": BALL.contact_radius,
    "deflection": BALL.deflection,
    "normal stiffness": BALL.normal_stiffness,
    "tangential stiffness": BALL.tangential_stiffness,
    "stick time": StickTimeFriction(0.2, 0.4, 0.5),
    "virgin force": lambda x: virgin_force(MaxwellSlip([1.0], [1.0]), x),
    "film ratio": FILM.ratio,
    "film coefficient": FILM.coefficient,
    "bearing under load": lambda load: BEARING.steady_gap(1.0, load),
    "bearing's curve": lambda load: BEARING.stribeck([1.0], load),
}
OF_A_LOAD = {
    "load law": LoadLaw(0.2, 2.0, 10.0),
    "Amontons": Amontons(0.2),
    "xgms": lambda load: XGMS_MODEL.steady_state(1.0, load),
    "directed": lambda load: Directed(XGMS_MODEL, XGMS_MODEL).steady_state(1.0, load),
    "lifting": lambda load: LIFTING.steady_state(1.0, load),
    "sphere": BALL.load,
    "sliding of a bearing": lambda sliding: BEARING.steady_gap(sliding, 1.0),
}
NO_NUMBERS = (NAN, INF, -INF, "fast", None, 1j)


@pytest.mark.parametrize("name", OF_A_SPEED | OF_A_SIZE | OF_A_LOAD)
@pytest.mark.parametrize("value", NO_NUMBERS, ids=str)
def test_what_is_no_number_is_refused_and_not_evaluated(name: str, value: object) -> None:
    for table in (OF_A_SPEED, OF_A_SIZE, OF_A_LOAD):
        if name in table:
            with pytest.raises(InputError) as refused:
                table[name](value)
            message = str(refused.value)
            assert any(word in message for word in ("allowed", "needed", "must be"))
            assert "\n" not in message


@pytest.mark.parametrize("name", OF_A_SIZE)
def test_what_is_below_0_is_refused_and_not_evaluated(name: str) -> None:
    with pytest.raises(InputError, match="is -2"):
        OF_A_SIZE[name](-2.0)


@pytest.mark.parametrize("name", OF_A_SPEED)
def test_an_evaluation_takes_any_shape_and_leaves_what_it_was_given(name: str) -> None:
    speeds = np.array([[0.0, -1e-3, 2e-3], [1e10, -1e15, 1e-300]])
    if name == "slopes":
        speeds[0, 0] = 1.0
    kept = speeds.copy()
    whole = np.asarray(OF_A_SPEED[name](speeds))
    assert whole.shape[-2:] == speeds.shape
    assert np.isfinite(whole).all()
    np.testing.assert_array_equal(speeds, kept)
    for i, j in np.ndindex(speeds.shape):
        np.testing.assert_array_equal(np.asarray(OF_A_SPEED[name](float(speeds[i, j]))), whole[..., i, j])
    assert np.asarray(OF_A_SPEED[name](speeds.tolist())).shape == whole.shape
    assert np.asarray(OF_A_SPEED[name]([])).size == 0


@every_model
def test_a_speed_that_overflows_is_refused(case: Case) -> None:
    """It gave NaN or infinity, and a state that the next step refused."""
    for displacement, dt in ((1e308, 1e-3), (-1e308, 1e-300), (1.0, 1e-300)):
        with pytest.raises(InputError, match=r"speed of the step is .* m/s; allowed is a number at most 1e\+15"):
            case.model.step(case.model.rest(), displacement, dt, LOAD)
        with pytest.raises(
            InputError, match=r"speed between two samples is .* m/s; allowed is a number at most 1e\+15"
        ):
            case.model.trace([0.0, displacement], dt, LOAD)
    force, state = case.model.step(case.model.rest(), 1e15, 1.0, LOAD)
    assert np.isfinite(force)
    assert np.isfinite(state).all()


def test_a_tangential_force_needs_a_load_that_presses() -> None:
    with pytest.raises(InputError, match="least load under a tangential force is 0 N; allowed is a number above 0"):
        BALL.tangential_deflection([1.0, 0.0], 0.3, 0.1)
    with pytest.raises(InputError, match="material of the flat is 'steel'; a Material is needed"):
        SphereOnFlat(0.01, STEEL, "steel")


def test_only_a_model_is_simulated() -> None:
    with pytest.raises(InputError, match="model is 'gms'; a FrictionModel is needed"):
        friction.simulate("gms", [0.0, 1.0], 1e-3)
