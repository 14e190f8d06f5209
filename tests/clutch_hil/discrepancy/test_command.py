"""`clutch-hil discrepancy`: what it takes, what it refuses in one sentence, what it writes."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import clutch_hil as ch
from clutch_hil.command import make_application
from protocols.errors import InputError
from protocols.files.run import Run
from protocols.files.runs import read_run, write_run
from tests.clutch_hil.fitting.test_fit import record_run

MODEL = "tests/clutch_hil/fitting/test_fit.py:Amplifier"
HIDDEN = {"cubic.share": 0.3}


def invoke_command(*arguments: object) -> Result:
    return CliRunner().invoke(make_application(), ["discrepancy", *map(str, arguments)], catch_exceptions=False)


@pytest.fixture
def paths(tmp_path: Path) -> list[Path]:
    """Five runs with a hidden cubic."""
    outcome = [tmp_path / f"run-{seed}.parquet" for seed in range(1, 6)]
    for seed, path in enumerate(outcome, 1):
        write_run(Run(record_run(seed, HIDDEN), {}), path)
    return outcome


def test_all_files_are_written_and_the_last_line_is_the_verdict(paths: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = invoke_command(*paths[:3], "--holdout", *paths[3:], "--rig", MODEL, "--out", out)
    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[-1].startswith("verdict: named: cubic (confidence ")
    names = {"report.json", "report.html", "model.toml", "atlas.png", "gap.png", "evidence.rrd"}
    assert {path.name for path in out.iterdir()} == names
    report = json.loads((out / "report.json").read_text())
    # every path behind --holdout is held out
    assert report["holdout"] == [str(path) for path in paths[3:]]
    assert set(report["runs"]) == set(map(str, paths))
    (parameter,) = report["parameters"]
    assert parameter["name"] == "cubic.share"
    assert parameter["ci95"][0] <= 0.3 <= parameter["ci95"][1]
    gap = report["gap"]["holdout"]["output_v"]
    assert gap["before"] > 2.0 * gap["floor"]
    assert gap["after"] < 1.1 * gap["floor"]


def test_the_same_document_goes_to_machines(paths: list[Path], tmp_path: Path) -> None:
    done = invoke_command(*paths[:2], "--rig", MODEL, "--effects", "cubic,offset", "--out", tmp_path / "out", "--json")
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    assert printed["verdict"] == "named"
    assert {rival["name"] for rival in printed["rivals"]} == {"cubic", "offset"}


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--rig", "wet_cluch"], "rig 'wet_cluch' is neither known nor PATH.py:CLASS; did you mean wet_clutch?"),
        (["--rig", "nowhere.py:Rig"], "rig nowhere.py:Rig: the file nowhere.py does not exist"),
        (["--rig", "tests/clutch_hil/fitting/test_fit.py"], "is not of the form PATH.py:CLASS"),
        (["--rig", "tests/clutch_hil/fitting/test_fit.py:Amplifyer"], "has no class 'Amplifyer'"),
        (["--rig", "tests/clutch_hil/fitting/test_fit.py:CandidateSearch"], "cannot be made without arguments"),
        (["--rig", MODEL, "--effects", "cubik"], "effect 'cubik' is not a candidate of the rig amplifier"),
        (["--rig", MODEL, "--refit-within", "0"], "--refit-within 0 is not possible"),
        (["--rig", MODEL, "--effects", ","], "--effects is ','; allowed are names separated by commas"),
        (["--rig", MODEL, "--model", "nowhere.toml"], "parameter file nowhere.toml does not exist"),
        ([], "lacks the column"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_before_anything_is_written(
    arguments: list[str], sentence: str, paths: list[Path], tmp_path: Path
) -> None:
    with pytest.raises(InputError) as refused:  # which `clutch-hil` turns into exit code 2
        invoke_command(paths[0], *arguments, "--out", tmp_path / "out")
    assert sentence in str(refused.value)
    assert not (tmp_path / "out" / "report.json").exists()


def test_a_run_is_fitted_or_held_out_once(paths: list[Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="was given twice; each run can be fitted or held out only once"):
        invoke_command(*paths[:2], "--holdout", paths[0], "--rig", MODEL, "--out", tmp_path / "out")


def test_a_copy_of_a_run_in_another_format_is_no_other_run(paths: list[Path], tmp_path: Path) -> None:
    write_run(read_run(paths[0], ()), tmp_path / "other.csv")
    with pytest.raises(
        InputError, match=r"other\.csv: time_s, rows 0 to \d+, are rows 0 to \d+ of run .*run-1\.parquet"
    ):
        invoke_command(*paths[:3], "--holdout", tmp_path / "other.csv", "--rig", MODEL, "--out", tmp_path / "out")


def test_from_python_runs_in_memory_are_as_good_as_files(paths: list[Path], tmp_path: Path) -> None:
    """And nothing is written until that is asked for."""
    runs = [ch.Run(record_run(seed, HIDDEN), {}) for seed in range(1, 6)]
    outcome = ch.find_discrepancy(runs[:3], runs[3:], rig=MODEL)
    by_file = ch.find_discrepancy(paths[:3], paths[3:], rig=MODEL)
    assert str(outcome) == str(by_file)
    assert str(outcome).startswith("named: cubic (confidence ")
    assert outcome.result.parameters == by_file.result.parameters
    assert not (tmp_path / "out").exists()
    written = outcome.write(tmp_path / "out")
    assert {path.name for path in written} >= {"report.json", "report.html", "model.toml"}
    assert all(path.exists() for path in written)
    assert json.loads((tmp_path / "out" / "report.json").read_text())["holdout"] == ["number 4", "number 5"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"runs": []}, "has no runs"),
        ({"runs": ["nowhere.parquet"]}, "run nowhere.parquet does not exist"),
        ({"runs": [ch.Run({}, {})]}, "run number 1 lacks the column"),
        ({"runs": [ch.Run(record_run(1, HIDDEN), {})], "effects": ["cubik"]}, "effect 'cubik' is not a candidate"),
        ({"runs": [ch.Run(record_run(1, HIDDEN), {})], "calibration": 0.0}, "calibration 0 is not possible"),
        ({"runs": [], "rig": None}, "rig is None; a name is needed"),
        ({"runs": [], "effects": ["cubic", 3]}, "effects is 3; a name is needed"),
        ({"runs": [], "force": "no"}, "force is 'no'; allowed are True and False"),
        ({"runs": ["a.parquet"], "calibration": "1"}, "calibration is '1'; a number is needed"),
        ({"runs": ["a.parquet"], "model": 3}, "model is 3; the path of a file is needed"),
    ],
)
def test_from_python_what_cannot_be_is_refused_in_one_sentence(arguments: dict, sentence: str) -> None:
    with pytest.raises(ch.InputError, match=sentence):
        ch.find_discrepancy(**{"rig": MODEL, **arguments})


@pytest.mark.parametrize(
    ("experiment", "sentence"),
    [
        ("no_such", "experiment 'no_such' is unknown"),
        (None, "the result proposes no experiment: its verdict needs none"),
        ({"profile": "crawl", "settings": {}}, "temperature and rate are needed"),
    ],
)
def test_an_experiment_that_cannot_be_played_is_told(experiment: object, sentence: str) -> None:
    with pytest.raises(ch.InputError, match=sentence):
        ch.play_experiment(experiment)  # type: ignore[arg-type]


def test_files_appear_together_or_not_at_all(
    paths: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An interruption while the last of them is written leaves none, so that the command can be given again."""
    out = tmp_path / "out"
    words = (*paths[:2], "--rig", MODEL, "--effects", "cubic,offset", "--out", out)

    def interrupt(*given: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("clutch_hil.discrepancy.report.rrd.write_evidence", interrupt)
        CliRunner().invoke(make_application(), ["discrepancy", *map(str, words)])
    assert not out.exists()
    assert invoke_command(*words).exit_code == 0
