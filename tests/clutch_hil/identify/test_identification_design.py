"""`clutch-hil experiment identify --design`: shorter than the fixed set, within the limits, and right.

Ten rigs are `python -m benchmarks.identification_design`.
"""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.identification import draw, list_true_values
from benchmarks.identification_design import TruthBench
from clutch_hil.discrepancy.experiments.identification_design import (
    CONFIRMATION,
    MARGIN,
    SURVEY,
    Design,
    design_experiment,
)
from clutch_hil.discrepancy.experiments.identification_set import play_designed
from clutch_hil.discrepancy.models.wet_clutch_experiments import WetClutchBench
from clutch_hil.fitting.model import Values
from clutch_hil.identify.controller_values import derive_pressures
from clutch_hil.identify.courses.clutch_courses import COURSES, HIGHEST, SCALE, Span
from clutch_hil.identify.courses.course_pieces import LIBRARY, compose
from clutch_hil.identify.goals import GOALS, stand
from clutch_hil.identify.identification import Identification, identify_clutch
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.node import load_node

SEED = 2  # of a rig within 30 %, whose valve gain is 21 % and whose contact pressure 10 % off
# Where the fixed set ends on this rig: after its fourth course, 74.7 s (benchmarks/identification_design.py)
FIXED = sum(
    make(Span(2.35)).rows[-1][0] for make, _ in (SCALE, *(COURSES[name] for name in ("stribeck", "dynamics", "fills")))
)


class _Bench(TruthBench):
    """The rig, and what its controller was told."""

    def tell_controller(self, values: Values) -> None:
        super().tell_controller(values)
        self.told = values

    @property
    def span(self) -> Span:
        return Span(self.told["model.contact_pressure"])


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> _Bench:
    return _Bench(draw(SEED), SEED, tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="module")
def runs(bench: _Bench, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The staircase, and what is designed after it."""
    courses = play_designed(tmp_path_factory.mktemp("courses"), bench, identify_clutch, lambda line: None)
    return [next(courses), next(courses)]


@pytest.fixture(scope="module")
def result(runs: list[Path]) -> Identification:
    return identify_clutch(runs)


@pytest.fixture(scope="module")
def design(bench: _Bench, result: Identification) -> Design:
    return design_experiment(result, bench.span, bench.told)


def test_a_survey_gives_starting_values_of_the_whole_rig(result: Identification, bench: _Bench) -> None:
    true = list_true_values(draw(SEED))
    for standing in stand(result.calibration):
        exact = standing.goal.of(true)
        assert np.all(np.abs(standing.values - exact) <= 2.0 * standing.half)
    assert max(result.misfit.values()) < 1.2


def test_all_goals_are_predicted_in_less_time_than_the_fixed_set_takes(result: Identification, design: Design) -> None:
    played = sum(float(run["time_s"][-1]) for run in result.measured.values())
    assert played + design.seconds + CONFIRMATION < 0.9 * FIXED
    for goal in GOALS:
        assert design.predicted[goal.name] <= MARGIN * goal.limit
    assert not design.confirms


def test_where_all_is_reached_a_short_experiment_confirms_it(bench: _Bench, result: Identification) -> None:
    reached = tuple(standing.goal for standing in stand(result.calibration) if standing.is_reached)
    last = design_experiment(result, bench.span, bench.told, goals=reached)
    assert reached
    assert last.confirms
    assert str(last).startswith(f"{last.seconds:.1f} s to confirm it: ")
    assert CONFIRMATION < last.seconds < 2.5 * CONFIRMATION


def test_what_would_reach_a_limit_of_the_guard_is_refused(
    bench: _Bench, result: Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(WetClutchBench, "plan_inputs", lambda *_: None)
    with pytest.raises(InputError, match=r"up to 4\.\d* bar would reach the limits"):
        design_experiment(result, bench.span, bench.told)


@pytest.mark.parametrize(
    "span", [Span(2.35), Span(1.75), Span.of_line(14.0, 3.0, 30.0), Span.of_line(25.0, 2.65, 30.0)]
)
def test_pieces_keep_to_the_span(span: Span) -> None:
    course, times = compose(list(LIBRARY), span)
    _, _, speed, pressure = np.array(course.rows).T
    assert pressure[-1] == 0.0
    assert pressure.max() <= min(HIGHEST, span.contact + span.reach) + 1e-9
    assert np.abs(speed).max() <= 22.0
    assert all(0.4 < end - begin < 2.0 for begin, end in times)
    assert set(SURVEY) <= set(LIBRARY)


def test_pieces_that_are_asked_for_twice_are_played_twice() -> None:
    once, twice = (compose(["hold"] * count, Span(2.35))[1] for count in (1, 2))
    assert (len(once), len(twice)) == (1, 2)


def test_a_controller_is_told_what_holds_a_clutch_at_a_pressure() -> None:
    nominal = {name: p.value for name, p in wet_clutch.load_nominal().items()}
    parameters = load_node("controller")().parameters
    sentence = derive_pressures(2.65, 2.0, nominal, parameters)
    assert sentence["model.contact_pressure"] == 2.65
    assert sentence["pressure.valve_gain"] == 2.0
    assert sentence["phases.fill_pressure"] == pytest.approx(parameters["phases.fill_pressure"].value + 0.3)
    assert not [name for name in sentence if "coulomb" in name or "viscous" in name]
    assert derive_pressures(nominal["piston.contact_pressure"], 2.5, nominal, parameters) == pytest.approx(
        {name: parameters[name].value for name in sentence}
    )
