"""The commands that identify a clutch and take its calibration: options, files, courses."""

import json
from html import escape
from pathlib import Path

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.bench.run_file import read_run
from clutch_hil.commands.identify import FILES
from clutch_hil.identify.courses.clutch_courses import COURSES, HIGHEST, MOST, SCALE, Span, write_course
from clutch_hil.identify.recorded_runs.run_evidence import read_evidence
from clutch_hil.identify.report.report_pictures import shorten_names
from plant_sim.profiles.profile import load_profile
from protocols.errors import InputError
from protocols.files.runs import write_run
from tests.processes import play_here

LONGEST = 24.0  # s of a course


def run_command(*words: object) -> tuple[int, str]:
    """Exit code and text of a command: what it prints, or its sentence where it is refused."""
    done = play_here(*words)
    return done.returncode, done.stderr if done.returncode == 2 else done.stdout


@pytest.fixture(scope="module")
def run_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / r"loads \frac$_{$ & <b>.parquet"  # no formula, and no mark of a page
    write_run(ch.simulate(profile="loads_and_slips", seed=4), path)
    return path


def test_a_run_becomes_files_and_a_verdict(tmp_path: Path, run_file: Path) -> None:
    code, text = run_command("identify", run_file, "--out", tmp_path / "mine")
    assert code == 0
    assert sorted(path.name for path in (tmp_path / "mine").iterdir()) == sorted(FILES)
    assert "parameters identified from 1 run;" in text
    document = json.loads((tmp_path / "mine" / FILES[1]).read_text(encoding="utf-8"))
    page = (tmp_path / "mine" / FILES[2]).read_text(encoding="utf-8")
    assert "http" not in page.replace("http-equiv", "")  # it needs no network
    assert ", ".join([FILES[0], FILES[1], *FILES[3:]]) in page  # the files beside it
    for one in document["parameters"]:
        exact = [one["value"], *one["ci95"], one["declared"]]
        assert all(f'<data value="{value!r}">' in page for value in exact), one["name"]
    assert all(escape(sentence) in page for sentence in [*document["warnings"], *document["runs"].values()])
    assert document["warnings"]  # a single run does not excite everything
    assert any("stick stiffness" in sentence for sentence in document["warnings"])
    (absent,) = [line for line in text.splitlines() if line.startswith("absent: ")]
    assert document["absent"]
    assert all(f"{one['name']} (" in absent for one in document["absent"])
    code, text = run_command("identify", run_file, "--out", tmp_path / "mine")
    assert code == 2
    assert "--overwrite" in text
    calibration = tmp_path / "mine" / FILES[0]
    for command in ("up", "simulate"):
        code, text = run_command(command, "--calibration", calibration, "--plant-parameters", run_file)
        assert code == 2
        assert "--calibration and --plant-parameters were both given" in text
    words = ["simulate", "--profile", "engagement", "--seconds", "1", "--json", "--out", tmp_path]
    code, text = run_command(*words, "--calibration", calibration)
    assert code == 0
    result = {
        part: read_run(json.loads(text)["run"]).metadata[f"{part}_parameters"] for part in ("plant", "controller")
    }
    assert result["plant"]["valve.gain"] == result["controller"]["pressure.valve_gain"] != 2.5


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--hold", "valve.gain=x"], "'x'"),
        (["--hold", "=1"], "'=1'"),
        (["--hold", "valve.gain=inf"], "'inf'"),
        (["--bounds", "valve.gain"], "'valve.gain'"),
        (["--bounds", "valve.gain=1"], "LOW:HIGH"),
        (["--bounds", "valve.gain=3:2"], "valve.gain"),
        (["--tie", "valve.gain"], "NAME=VALUE"),
        (["--tie", "valve.gain=valve.nosuch"], "valve.nosuch"),
        (["--rig", "nosuch"], "nosuch"),
        (["--rig", "power_shift"], "is a run of the rig wet_clutch, but power_shift is identified"),
        (["--position", "x"], "--friction"),
        (["--seed", "0"], "--seed is only for --friction"),
        (["--starts", "3"], "--starts is only for --friction"),
        (["--elements", "0"], "--elements is only for --friction"),
        (["--friction", "gms", "--tie", "a=b"], "--tie"),
    ],
)
def test_a_wrong_option_is_one_sentence(tmp_path: Path, run_file: Path, words: list[str], sentence: str) -> None:
    code, text = run_command("identify", run_file, *words, "--out", tmp_path / "mine")
    assert code == 2
    assert sentence in text
    assert not list(tmp_path.glob("mine/*"))


@pytest.mark.parametrize(
    ("column", "instead"),
    [
        ("cylinder_pressure_bar", "nothing can replace it"),
        ("oil_temperature_degc", "a `constant` temperature"),
        ("slip_speed_rad_s", "a difference of speeds, can replace it"),
        ("valve_voltage_v", "the valve's current"),
    ],
)
def test_a_missing_sensor_is_refused_with_what_can_take_its_place(run_file: Path, column: str, instead: str) -> None:
    run = read_run(run_file)
    lacking = ch.Run({name: values for name, values in run.columns.items() if name != column}, {})
    with pytest.raises(InputError, match=rf"run 1 lacks the column {column}; .*{instead}.*docs/identify\.md"):
        ch.identify_clutch([lacking])
    with pytest.raises(InputError, match=rf"run number 1 lacks the column {column}; .*{instead}.*docs/identify\.md"):
        ch.find_discrepancy([lacking])


def test_runs_of_two_folders_may_have_one_name_but_not_one_content(tmp_path: Path) -> None:
    first, second = (tmp_path / folder / "run.parquet" for folder in "ab")
    for seed, path in enumerate((first, second)):
        path.parent.mkdir()
        write_run(ch.simulate(profile="engagement", seconds=1.0, seed=seed), path)
    needed = ("time_s", "clutch_torque_nm")
    assert list(read_evidence([first, second], "wet_clutch", needed).measured) == ["run.parquet", str(second)]
    (tmp_path / "copy.parquet").write_bytes(first.read_bytes())
    with pytest.raises(InputError, match="was given twice; give it once"):
        read_evidence([second, first, first], "wet_clutch", needed)
    sentence = r"run copy\.parquet: time_s, rows 0 to 999, are rows 0 to 999 of run run\.parquet: .*--force-checks"
    with pytest.raises(InputError, match=sentence):
        ch.identify_clutch([first, tmp_path / "copy.parquet"])


@pytest.mark.parametrize(
    ("names", "short"),
    [
        (["20261126-112737-identify_scale.parquet", "20261126-112755-identify_crawl_a.parquet"], ["scale", "crawl_a"]),
        (["a/20261126-112737-drift.parquet"], ["drift"]),
        (["one.mf4", "one_two.mf4"], ["one", "one_two"]),
        (["a/run.parquet", "b/run.parquet"], ["run", "run"]),
        (["a_very_long_name_of_somebody.csv"], ["a_very_long_name_…"]),
    ],
)  # fmt: skip
def test_names_of_runs_in_a_picture_are_what_tells_them_apart(names: list[str], short: list[str]) -> None:
    assert shorten_names(names) == short


def test_a_number_after_calibration_is_told_its_new_option(run_file: Path, tmp_path: Path) -> None:
    code, text = run_command("discrepancy", run_file, "--calibration", "0.5", "--out", tmp_path / "d")
    assert code == 2
    assert "--refit-within 0.5" in text


@pytest.mark.parametrize("name", [*COURSES, "scale"])
@pytest.mark.parametrize("span", [Span(2.35), Span(1.7), Span.of_line(14.0, 3.0, 30.0), Span.of_line(25.0, 2.65, 30.0)])
def test_courses_are_profiles_within_the_span_of_the_clutch(tmp_path: Path, name: str, span: Span) -> None:
    make = SCALE[0] if name == "scale" else COURSES[name][0]
    path = tmp_path / "course.csv"
    path.write_text(write_course(make(span), "A course."), encoding="utf-8")
    profile = load_profile(str(path))
    assert profile.duration <= LONGEST
    assert max(profile.pressure) <= max(HIGHEST, span.contact + 0.2) + 1e-9
    assert max(profile.pressure) <= span.contact + span.reach + 1e-4
    assert max(np.abs(profile.speed)) <= 26.2  # rad/s, the speed limit of the maps
    assert profile.pressure[-1] == 0.0


def test_a_steep_clutch_gets_no_more_than_its_torque() -> None:
    assert Span.of_line(20.0, 2.35, 30.0).reach == pytest.approx(1.5)
    assert Span.of_line(14.0, 2.35, 30.0).reach == MOST


def test_files_appear_together_or_not_at_all(tmp_path: Path, run_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An interruption while the last of them is written leaves none, so that the command can be given again."""

    def interrupt(*given: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("clutch_hil.identify.report.quantity_pictures.draw_maps", interrupt)
    run_command("identify", run_file, "--out", tmp_path / "mine")
    assert not (tmp_path / "mine").exists()
