"""A follow-up begins with a report whose runs are what they were, and with a plant under test that is one thing."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from clutch_hil.bench.sealed import compute_checksum
from clutch_hil.command import make_application
from clutch_hil.discrepancy.experiment_design import Experiment
from clutch_hil.discrepancy.experiments.blind import GAP, draw_plant, measure_standard
from clutch_hil.discrepancy.experiments.follow_up import Report
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from plant_sim.effects.table import list_active_effects
from protocols.errors import InputError

PROPOSED = {"profile": "crawl", "settings": {"temperature": 45.0, "rate": 500}, "why": "they differ"}


@pytest.fixture
def runs(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / name for name in ("a.parquet", "b.parquet", "c.parquet")]
    for path in paths:
        path.write_text(path.stem)
    return paths


def report(folder: Path, files: list[Path], **changes: object) -> Path:
    document = {
        "verdict": "one_of", "rig": "wet_clutch", "experiment": PROPOSED, "runs": {str(p): compute_checksum(p) for p in files},
        "holdout": [str(files[-1])],
    }  # fmt: skip
    path = folder / "report.json"
    path.write_text(json.dumps(document | changes))
    return path


def test_a_report_tells_what_to_play_beside_which_runs(tmp_path: Path, runs: list[Path]) -> None:
    read = Report.read(report(tmp_path, runs))
    assert read.experiment == Experiment("crawl", 45.0, 500)
    assert (read.runs, read.held_out) == (tuple(runs[:2]), tuple(runs[2:]))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"experiment": None}, "proposes no experiment: its verdict needs none"),
        (
            {"experiment": {"profile": None, "why": "none separates them"}},
            "proposes no experiment: none separates them",
        ),
        ({"experiment": {"profile": "crawl", "settings": {}}}, "temperature and rate are needed"),
        ({"rig": "position_axis"}, "is of the rig 'position_axis'; experiments can be played on wet_clutch"),
        ({"runs": {}}, "names no runs"),
        ({"runs": {"gone.parquet": "00"}}, "run gone.parquet of report .* does not exist"),
    ],
)
def test_a_report_that_cannot_be_followed_is_told(
    tmp_path: Path, runs: list[Path], changes: dict, sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        Report.read(report(tmp_path, runs, **changes))


def test_a_run_that_was_changed_since_is_no_evidence(tmp_path: Path, runs: list[Path]) -> None:
    path = report(tmp_path, runs)
    runs[0].write_text("another")
    with pytest.raises(InputError, match=r"a.parquet has been changed since report"):
        Report.read(path)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "experiment needs one of EXPERIMENT, --standard and --for"),
        (["crawl", "--standard"], "experiment needs one of EXPERIMENT, --standard and --for"),
        (["--standard", "--holdout", "crawl"], "--holdout crawl needs experiments given by name"),
        (["crawl", "--running", "--draw", "3"], "--running and --draw cannot be combined"),
        (["crawl", "--draw", "3", "--scenario", "drift"], "--draw and --scenario were both given"),
        (["crawl", "--rate", "3"], "rate 3 Hz is not possible"),
        (["crawl", "--plant-parameters", "gone.toml"], "parameter file gone.toml does not exist"),
        (["--for", "gone.json"], "report gone.json does not exist"),
    ],
)
def test_a_command_that_means_nothing_is_refused_before_anything_is_written(
    tmp_path: Path, words: list[str], sentence: str
) -> None:
    done = CliRunner().invoke(make_application(), ["experiment", *words, "--out", str(tmp_path / "out")])
    assert isinstance(done.exception, InputError)
    assert sentence in str(done.exception)
    assert not list(tmp_path.iterdir())


def test_a_seed_draws_one_effect_that_the_standard_experiments_show() -> None:
    plant = draw_plant(4)
    assert plant.as_values() == draw_plant(4).as_values() != draw_plant(5).as_values()
    (name,) = list_active_effects(plant)
    assert (
        max(
            measure_standard().compute_gaps({n: p.value for n, p in plant.items() if n.startswith(f"{name}.")}).values()
        )
        >= GAP
    )
    assert any(plant[n].value != p.value for n, p in WetClutch().parameters.items())


@pytest.mark.parametrize(
    ("seed", "effect"),
    [
        (0, "return_spring_change"),
        (2, "torque_sensor_offset"),
        (7, "coulomb_temperature"),
    ],  # as docs/blind_exercise.md says
)
def test_a_seed_always_draws_the_same_effect(seed: int, effect: str) -> None:
    assert list(list_active_effects(draw_plant(seed))) == [effect]


@pytest.mark.parametrize("seed", [14, 23, 27])
def test_no_strength_of_a_drawn_plant_is_at_its_bound(seed: int) -> None:
    """Such a plant has a pressure channel that saturates at 0.1 V, and its run ends in a fault."""
    plant = draw_plant(seed)
    (name,) = list_active_effects(plant)
    (effect,) = (one for one in WetClutch().candidates if one.name == name)
    assert not effect.list_at_bounds({n: p.value for n, p in plant.items()})


def test_a_report_that_says_identify_first_is_not_followed_by_an_experiment(tmp_path: Path, runs: list[Path]) -> None:
    result = {
        "verdict": "identify_first",
        "experiment": None,
        "recalibration": {"command": "clutch-hil identify RUN..."},
    }
    with pytest.raises(InputError, match=r"identify the rig first, .*; type: clutch-hil identify RUN\.\.\."):
        Report.read(report(tmp_path, runs, **result))
