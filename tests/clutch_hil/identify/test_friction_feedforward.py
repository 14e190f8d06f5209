"""The position axis with an identified law in its feedforward follows as well as with its true one."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.discrepancy.models.position_axis import to_columns
from clutch_hil.identify.friction.identification import identify_friction
from clutch_hil.identify.friction.result import read_friction
from clutch_hil.thesis.control_models.friction_compensation import SETTLING_TIME, TASKS
from plant_sim.friction.gms import GMS
from plant_sim.friction.stribeck import Stribeck
from plant_sim.rigs.position_axis import PositionAxis
from plant_sim.rigs.position_feedforward import Feedforward, Frictionless
from plant_sim.rigs.position_identification import NOMINAL_TIME, run_experiment
from protocols.files.run import Run

LIMITS, POINTS = np.array([8.0, 6.0, 7.0, 5.0]), np.array([2e-6, 6e-6, 1.5e-5, 4e-5])  # N, m
MOST_RATIO = 1.2  # of the tracking error with the identified law over that with the true one


@pytest.fixture(scope="module")
def feedforwards(tmp_path_factory: pytest.TempPathFactory) -> tuple[PositionAxis, dict[str, Feedforward]]:
    """The axis, and its feedforwards: without friction, the true one, and one from a file identified by a noisy run."""
    level = LIMITS.sum()
    axis = PositionAxis(GMS(Stribeck(level, 0.75, 4e-3, 60.0), LIMITS / POINTS, LIMITS / level, 1500.0))
    columns = to_columns(run_experiment(axis))
    kept = columns["time_s"] < NOMINAL_TIME
    run = Run({name: values[kept] for name, values in columns.items() if name != "normal_load_n"}, {})
    terms = ("mass", "stribeck", "lag", "viscous", "delay")
    result = identify_friction(run, "gms", low_pass=250.0, rate=1000.0, elements=LIMITS.size, terms=terms, starts=1)
    path: Path = result.write(tmp_path_factory.mktemp("friction") / "axis.toml")
    own = {
        "none": Feedforward(axis.mass, Frictionless()),
        "true": Feedforward(axis.mass, axis.friction),
        "identified": read_friction(path).feedforward(),
    }
    return axis, own


@pytest.mark.parametrize("task", TASKS)
def test_follows_as_with_the_true_law(task: str, feedforwards: tuple[PositionAxis, dict[str, Feedforward]]) -> None:
    axis, own = feedforwards
    trajectory, seconds = TASKS[task]
    errors = {}
    for name, feedforward in own.items():
        run = axis.simulate(trajectory, seconds, feedforward.force(trajectory, axis.times(seconds), axis.load))
        errors[name] = float(np.sqrt(np.mean(run.error[run.time_s >= SETTLING_TIME] ** 2)))
    assert errors["identified"] <= MOST_RATIO * errors["true"], errors
    assert errors["none"] > 20.0 * errors["identified"]
