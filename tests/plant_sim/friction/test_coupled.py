"""Friction and a structure over a step: balance, standstill, and the checked way in."""

import subprocess
import sys

import numpy as np
import pytest

from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.coupled import balance, simulate_slide
from plant_sim.friction.model import FrictionModel
from protocols.errors import InputError
from tests.plant_sim.friction.models import CASES, Case

DT = 1e-4  # s
every_model = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)


@every_model
def test_forces_balance_at_the_end_of_every_step(case: Case) -> None:
    model, random = case.model, np.random.default_rng(1)
    state, new = model.rest(), model.rest()
    for drive in random.normal(0.0, 5.0, 300):
        u, friction = balance(model.law, model.parameters, state, 1e8, drive, DT, 10.0, new)
        assert 1e8 * u + friction == pytest.approx(drive, rel=1e-9, abs=1e-12)
        state[:] = new


def test_a_force_below_break_away_moves_nothing_under_coulomb_friction() -> None:
    model = next(case.model for case in CASES if isinstance(case.model, Coulomb))
    motion = simulate_slide(model, 1.0, np.full(1000, 0.99 * model.stribeck.static_force), DT)
    assert np.all(motion.position == 0.0)
    assert np.all(motion.velocity == 0.0)
    np.testing.assert_array_equal(motion.friction, 0.99 * model.stribeck.static_force)


def test_every_nth_step_is_kept_and_a_spring_pulls() -> None:
    model = CASES[0].model
    fine = simulate_slide(
        model, 0.5, np.zeros(999), DT, spring=1e4, anchor=1e-3 * np.linspace(0.0, 1.0, 999), damping=3.0
    )
    coarse = simulate_slide(
        model, 0.5, np.zeros(999), DT, spring=1e4, anchor=1e-3 * np.linspace(0.0, 1.0, 999), damping=3.0, every=10
    )
    assert coarse.position.shape == (99,)
    np.testing.assert_array_equal(coarse.position, fine.position[9:990:10])
    assert fine.position[-1] > 0.0


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"model": "x"}, "model is 'x'; a FrictionModel"),
        ({"mass": 0.0}, "mass is 0 kg; allowed is a number above 0"),
        ({"mass": [1.0]}, r"mass is \[1.0\]; allowed is a number"),
        ({"force": []}, "force has shape"),
        ({"force": [1.0, np.nan]}, r"force \[N\] holds nan"),
        ({"dt": -1.0}, "time step is -1 s"),
        ({"load": [1.0, 2.0]}, r"load has shape \(2,\)"),
        ({"load": -1.0}, "least load is -1 N"),
        ({"anchor": [1.0]}, r"anchor has shape \(1,\)"),
        ({"spring": -1.0}, "spring stiffness is -1 N/m"),
        ({"damping": -1.0}, "damping is -1 Ns/m"),
        ({"start": 1.0}, r"start has shape \(\)"),
        ({"every": 0}, "every is 0; allowed is a whole number of 1 or more"),
        ({"every": 1.5}, "every is 1.5"),
        ({"every": 11}, "every is 11; allowed is at most the 10 steps"),
    ],
)
def test_wrong_input_is_one_sentence(changed: dict, sentence: str) -> None:
    arguments = {"model": CASES[0].model, "mass": 1.0, "force": np.ones(10), "dt": DT} | changed
    with pytest.raises(InputError, match=sentence):
        simulate_slide(**arguments)


@every_model
def test_a_step_checks_what_compiled_code_would_not(case: Case) -> None:
    model: FrictionModel = case.model
    state = model.rest()
    for wrong in (np.zeros(state.size + 1), np.empty(0), ["a"] * state.size, np.full(state.size, np.nan)):
        with pytest.raises(InputError, match="state"):
            model.step(wrong, 1e-6, DT)
    with pytest.raises(InputError, match="displacement is nan"):
        model.step(state, np.nan, DT)
    with pytest.raises(InputError, match="load is -5 N"):
        model.step(state, 1e-6, DT, -5.0)
    force, _ = model.step([float(value) for value in state], 1e-6, DT, 10.0)
    assert force == model.step(state, 1e-6, DT, 10.0)[0]


@every_model
def test_a_trace_goes_on_from_a_state_with_the_force_that_is_held(case: Case) -> None:
    """At standstill no law gives up force at once, but a viscous or damper part, which stops with the motion."""
    model = case.model
    before = model.trace(1e-6 * np.arange(200), DT, 10.0)
    after = model.trace(2e-4 + 1e-6 * np.arange(50), DT, 10.0, before.state[-1])
    held = model.step(before.state[-1], 0.0, DT, 10.0)[0]
    assert after.force[0] == held
    assert held > 0.0


def test_a_law_of_a_user_needs_no_file() -> None:
    """Typed into an interpreter, where numba can keep nothing on disk."""
    source = (
        "from plant_sim.friction.kernel import law\n"
        "import numpy as np\n"
        "@law\n"
        "def spring(parameters, state, displacement, dt, load, new_state):\n"
        "    new_state[0] = state[0] + parameters[0] * displacement\n"
        "    return new_state[0]\n"
        "print(spring(np.ones(1), np.zeros(1), 2.0, 1.0, 1.0, np.zeros(1)))\n"
    )
    done = subprocess.run([sys.executable, "-"], input=source, capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout == "2.0\n", done.stderr
