"""Mutation testing of the state logic: every change of a comparison, an operator, a condition or a constant of plausibility.py,
clutch_state.py and phases.py is noticed by its tests, but for the equivalent ones listed here with their reason."""

import ast
from types import ModuleType

import pytest

import rt_controller.clutch_state
import rt_controller.phases
import rt_controller.plausibility
from tests.mutation import checks, killed, plain_source, survivors

# Mutants no test can kill, by "line of source: column: change", and why.
EQUIVALENT: dict[str, dict[str, str]] = {"plausibility": {}, "clutch_state": {}, "phases": {}}
MODULES = [rt_controller.plausibility, rt_controller.clutch_state, rt_controller.phases]


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_every_mutant_of_the_state_logic_is_killed(module: ModuleType) -> None:
    name = module.__name__.rpartition(".")[2]
    file = f"test_{name}.py"
    assert not killed(ast.parse(plain_source(module)), checks(file, name)), "the unchanged module passes every check"
    population, alive = survivors(module, file, name)
    assert population > 30
    unexpected = sorted(set(alive) - set(EQUIVALENT[name]))
    assert not unexpected, f"{len(unexpected)} of {population} mutants survive:\n" + "\n".join(unexpected)
    assert not set(EQUIVALENT[name]) - set(alive), "an equivalent mutant is killed or gone: take it off the list"
