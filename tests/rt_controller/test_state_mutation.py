"""Mutation testing of the state logic: every change of a comparison, an operator, a condition or a constant of these modules is
noticed by their tests, but for the equivalent ones listed here with their reason."""

from types import ModuleType

import numpy as np
import pytest

import rt_controller.law.clutch_state
import rt_controller.law.motion
import rt_controller.law.phases
import rt_controller.law.plausibility
import rt_controller.law.presliding
import rt_controller.law.trim
from tests.mutation.mutants import find_survivors, is_killed, load_checks, parse_plain

MODULES = [
    rt_controller.law.clutch_state, rt_controller.law.motion, rt_controller.law.phases, rt_controller.law.plausibility,
    rt_controller.law.presliding, rt_controller.law.trim,
]  # fmt: skip
# Mutants no test can kill, by "line of source: column: change", and why.
EQUIVALENT: dict[str, dict[str, str]] = {
    "presliding": {
        "if slips or (along >= level and turned != 0.0):: column 21: GtE to Gt": (
            "at the level exactly it slips either way, and stays there"
        ),
    },
}
LEAST = 10  # mutants of the smallest of them


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_every_mutant_of_the_state_logic_is_killed(module: ModuleType) -> None:
    name = module.__name__.rpartition(".")[2]
    file, equivalent = f"rt_controller/test_{name}.py", EQUIVALENT.get(name, {})
    assert not is_killed(parse_plain(module), load_checks([file], name)), "the unchanged module passes every check"
    with np.errstate(all="ignore"):  # what a mutant divides by
        population, alive = find_survivors(module, [file], name)
    assert population > LEAST
    unexpected = sorted(set(alive) - set(equivalent))
    assert not unexpected, f"{len(unexpected)} of {population} mutants survive:\n" + "\n".join(unexpected)
    assert not set(equivalent) - set(alive), "an equivalent mutant is killed or gone: take it off the list"
