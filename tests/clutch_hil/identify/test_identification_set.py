"""`clutch-hil experiment identify`: when it ends early, what it says of runs that are whole, wrong input, a running bench."""

import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.bench.run_file import read_run
from clutch_hil.commands.experiment_identify import play_own_courses, running_courses
from clutch_hil.discrepancy.experiments.identification_set import MISMATCH, ORDER, UNCALIBRATED, play_until_reached
from clutch_hil.discrepancy.experiments.laboratory import plant_under_test
from clutch_hil.identify.calibration import Calibration, Identified
from clutch_hil.identify.goals import GOALS, Progress, Standing, stand
from clutch_hil.live.tuning.tune import request_parameters
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError, InterruptionError
from protocols.realtime.child import list_command
from protocols.telemetry.feed import find_bench
from protocols.telemetry.session import open_consumer_session
from tests.clutch_hil.live.running import running_bench
from tests.processes import PATIENCE, list_errors, play_here

NEEDED = {name for goal in GOALS for name in goal.needs}
CONTACT = wet_clutch.load_nominal()["piston.contact_pressure"].value  # bar
NARROW, WIDE = 1e-4, 0.5  # half width over value
OTHER = """
[valve]
gain = 2.0
[piston]
area = 1.6e-2
contact_pressure = 3.1
preload_pressure = 2.0
[clutch]
coulomb_intercept = -33.5
viscous_intercept = -8.3
beta_onset = 3.45
"""
EXPECTED = """
[model]
contact_pressure = 3.1
[phases]
fill_pressure = 3.35
[pressure]
valve_gain = 2.0
"""
FROZEN = """
title = "Identification: the pressure sensor freezes after the staircase"
about = "The staircase has released the clutch by then."
rig = "wet_clutch"
[run]
profile = "engagement"
[[inject]]
at = 10.6
freeze = "pressure"
"""


@dataclass(frozen=True)
class FakeIdentification:
    """What is looked at of an `Identification`."""

    calibration: Calibration
    misfit: dict[str, float]


def make_identification(
    half: float = NARROW, moved: float = 0.0, misfit: float = 1.0, without: str = ""
) -> FakeIdentification:
    """An identification of the nominal rig with half widths of `half` times the values, `moved` by that share."""
    nominal = wet_clutch.load_nominal()
    result = [
        Identified(n, nominal[n].value * (1.0 + moved), half * abs(nominal[n].value), nominal[n].unit, nominal[n].value)
        for n in sorted(NEEDED - {without})
    ]
    return FakeIdentification(Calibration("wet_clutch", result, {}, np.eye(len(result)), {}), {"pressure": misfit})


def test_one_identification_that_reaches_all_is_not_enough() -> None:
    progress = Progress()
    done, _, missing = progress.add(make_identification())  # type: ignore[arg-type]
    assert (done, missing) == (False, ["one more run must confirm it"])
    assert progress.add(make_identification())[0]  # type: ignore[arg-type]


def test_two_that_disagree_are_a_false_minimum() -> None:
    progress = Progress()
    progress.add(make_identification())  # type: ignore[arg-type]
    done, _, missing = progress.add(make_identification(moved=0.01))  # type: ignore[arg-type]
    assert not done
    assert "V_S" in missing[0]
    assert "moved by more than both intervals" in missing[0]
    assert progress.add(make_identification(moved=0.01))[0]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("second", "sentence"),
    [
        (make_identification(half=WIDE), "V_S ± 50 % (goal 10 %)"),
        (make_identification(misfit=1.6), "the residual is 1.6 times its noise, allowed is 1.2"),
        (make_identification(misfit=1.201), "the residual is 1.21 times its noise, allowed is 1.2"),
        (make_identification(without="clutch.attraction"), "C not identified (goal 10 %)"),
    ],
)
def test_what_is_not_reached_goes_on_and_begins_anew(second: FakeIdentification, sentence: str) -> None:
    progress = Progress()
    progress.add(make_identification())  # type: ignore[arg-type]
    done, _, missing = progress.add(second)  # type: ignore[arg-type]
    assert not done
    assert sentence in missing
    assert progress.add(make_identification())[2] == ["one more run must confirm it"]  # type: ignore[arg-type]


def test_the_half_width_of_a_map_follows_from_those_of_its_parameters() -> None:
    nominal, slope, intercept = wet_clutch.load_nominal(), 0.1, 0.3
    result = [
        Identified("clutch.coulomb_slope", 10.8, slope, "Nm/bar", 10.8),
        Identified("clutch.coulomb_intercept", -25.1, intercept, "Nm", -25.1),
    ]
    r = -0.9
    calibration = Calibration("wet_clutch", result, {}, np.array([[1.0, r], [r, 1.0]]), {})
    (standing,) = [one for one in stand(calibration) if one.goal.name == "M_C(p)"]
    p = nominal["piston.contact_pressure"].value + np.linspace(0.35, 1.85, 9)
    expected = np.sqrt((p * slope) ** 2 + intercept**2 + 2.0 * r * p * slope * intercept)
    assert standing.half == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("values", "half", "worst", "shown"),
    [
        ([2.0, 4.0], [0.1, 0.1], 5.0, "± 5 %"),
        ([0.0, 4.0], [0.0, 0.1], np.inf, "not identified"),
        ([0.0, 4.0], [np.nan, np.nan], np.nan, "not identified"),
        ([-2.0, 4.0], [0.1, 0.1], 5.0, "± 5 %"),
    ],
)  # fmt: skip
def test_no_share_of_a_quantity_that_is_0_is_known(
    values: list[float], half: list[float], worst: float, shown: str
) -> None:
    standing = Standing(GOALS[2], np.array(values), np.array(half))
    assert standing.worst == pytest.approx(worst, nan_ok=True)
    assert str(standing) == f"C_v(p) {shown} (goal 2 %)"
    assert not standing.is_reached


def list_paths(count: int, then: BaseException | None = None) -> Iterator[Path]:
    for number in range(count):
        yield Path(f"run{number}.parquet")
    if then:
        raise then


def play(answers: Sequence[object], courses: Iterator[Path], everything: bool = False) -> tuple[object, list[str]]:
    """Play with these identifications, one after the other; what came out, and the lines told."""
    lines: list[str] = []
    given = iter(answers)

    def identify(runs: Sequence[Path]) -> object:
        answer = next(given)
        if isinstance(answer, BaseException):
            raise answer
        return answer

    return play_until_reached(courses, everything, lines.append, identify), lines  # type: ignore[arg-type]


def test_it_ends_as_soon_as_two_agree() -> None:
    played, lines = play([make_identification(half=WIDE), make_identification(), make_identification()], list_paths(6))
    assert len(played.runs) == 4  # type: ignore[attr-defined]
    assert played.left_out == ORDER[3:]  # type: ignore[attr-defined]
    assert any("one more run" in line for line in lines)


def test_an_identification_that_is_refused_is_told_and_play_goes_on() -> None:
    played, lines = play([InputError("no torque"), make_identification(), make_identification()], list_paths(6))
    assert len(played.runs) == 4  # type: ignore[attr-defined]
    assert any("no torque" in line for line in lines)


def test_with_all_every_course_is_played() -> None:
    played, _ = play([], list_paths(6), everything=True)
    assert len(played.runs) == 6  # type: ignore[attr-defined]


@pytest.mark.parametrize("error", [InputError("a fault"), InterruptionError("stopped"), KeyboardInterrupt()])
def test_what_is_whole_is_told_whatever_ends_it(error: BaseException) -> None:
    kind = InterruptionError if isinstance(error, KeyboardInterrupt) else type(error)
    with pytest.raises(kind, match=r"these runs are complete, for clutch-hil identify: run0.parquet, run1.parquet$"):
        play([make_identification(half=WIDE)], list_paths(2, error))
    with pytest.raises(kind, match="no run is complete"):
        play([], list_paths(0, error))


def run_experiment(*words: object) -> subprocess.CompletedProcess:
    return subprocess.run(
        list_command("experiment", *map(str, words)), capture_output=True, text=True, timeout=PATIENCE, check=False
    )


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["identify", "--nosuch"], "nosuch"),
        (["identify", "--holdout", "crawl"], "experiment identify holds nothing out; leave --holdout out"),
        (["crawl", "--all"], "--all is only for the experiment identify"),
        (["crawl", "--design"], "--design is only for the experiment identify"),
        (
            ["identify", "--all", "--design"],
            "--all plays the fixed set, --design a shorter one; only one of them is allowed",
        ),
        (["identify", "--running", "--lockstep"], "--running and --lockstep cannot be combined"),
        (["identify", "--running", "--bus", "local:nobody"], "no bench on local:nobody"),
        (["identify", "--scenario", "shift", "--design"], "--design is only for a rig with one clutch"),
    ],
)
def test_wrong_words_are_one_sentence_and_write_nothing(tmp_path: Path, words: list[str], sentence: str) -> None:
    done = play_here("experiment", *words, "--out", tmp_path / "runs")
    assert done.returncode == 2
    assert sentence in done.stderr
    assert not list(tmp_path.glob("runs/*"))


def test_a_course_of_another_set_is_not_lost(tmp_path: Path) -> None:
    (tmp_path / "identify_fills.csv").write_text("mine", encoding="utf-8")
    done = play_here("experiment", "identify", "--lockstep", "--out", tmp_path)
    assert done.returncode == 2
    assert (
        "has profiles of an earlier set: identify_fills.csv exists already; give another folder by --out" in done.stderr
    )
    assert [path.name for path in tmp_path.iterdir()] == ["identify_fills.csv"]


def test_a_fault_in_the_middle_keeps_the_run_before(tmp_path: Path, local_bus: str) -> None:
    scenario = tmp_path / "frozen.toml"
    scenario.write_text(FROZEN, encoding="utf-8")
    done = run_experiment(
        "identify", "--lockstep", "--bus", local_bus, "--scenario", scenario, "--out", tmp_path / "runs"
    )
    assert done.returncode == 2, done.stderr
    scale, stribeck = sorted((tmp_path / "runs").glob("*.parquet"))
    last = list_errors(done.stderr)[-1]
    assert "experiment identify_stribeck ended in a fault at " in last
    assert ": sensor frozen: the pressure signal did not change" in last
    assert f"these runs are complete, for clutch-hil identify: {scale}" in last
    assert len(read_run(scale).columns["time_s"]) == pytest.approx(10_700, abs=50)
    assert stribeck.exists()


def test_ctrl_c_half_way_keeps_the_run_before(tmp_path: Path, local_bus: str) -> None:
    words = ("experiment", "identify", "--bus", local_bus, "--lockstep", "--out", str(tmp_path))
    with subprocess.Popen(list_command(*words), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while not list(tmp_path.glob("*identify_stribeck*.journal")):  # its run is being recorded
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE)
        assert process.returncode == 130, errors
    (scale,) = tmp_path.glob("*identify_scale.parquet")
    assert f"these runs are complete, for clutch-hil identify: {scale}" in list_errors(errors)[-1]
    assert not [*tmp_path.glob("*.part"), *tmp_path.glob("*.journal")]
    assert len(read_run(scale).columns["time_s"]) == pytest.approx(10_700, abs=50)


def controller(bus: str) -> dict[str, float]:
    with open_consumer_session() as session:
        return {
            one["name"]: one["value"] for one in request_parameters(session, find_bench(session, bus), "controller")
        }


def test_a_running_bench_is_told_what_the_staircase_shows_and_gets_its_parameters_back(tmp_path: Path) -> None:
    with running_bench(telemetry=True) as bench:
        before = controller(bench.bus)
        with running_courses(bench.bus, False, tmp_path, False, False, True) as courses:
            assert controller(bench.bus)[MISMATCH] == UNCALIBRATED
            run = read_run(next(courses))
            sentence = controller(bench.bus)
        after = controller(bench.bus)
    assert run["time_s"][-1] > 10.0
    assert run["clutch_torque_nm"].max() > 10.0
    assert sentence["model.contact_pressure"] != before["model.contact_pressure"]
    assert sentence["model.contact_pressure"] == pytest.approx(CONTACT, abs=0.03)
    assert sentence["pressure.valve_gain"] == pytest.approx(wet_clutch.load_nominal()["valve.gain"].value, rel=0.01)
    assert after == before


def test_of_a_clutch_that_is_far_from_the_shipped_one_the_controller_is_told_where_it_touches(
    tmp_path: Path, local_bus: str
) -> None:
    """Its fill ended in a fault, and nothing said what to do."""
    clutch, controller = tmp_path / "clutch.toml", tmp_path / "controller.toml"
    clutch.write_text(OTHER, encoding="utf-8")
    controller.write_text(EXPECTED, encoding="utf-8")

    def play(name: str, sentence: Path | None) -> Path:
        with plant_under_test(None, clutch, None, 1, tmp_path, sentence) as plant:
            return next(play_own_courses(plant, local_bus, True, False, tmp_path / name, False, None, False, True))

    named = r"model\.contact_pressure = 2\.35 bar, but the rig has 3\.1; pressure\.valve_gain = 2\.5 bar/V, but the rig has 2;"
    with pytest.raises(InputError, match=rf"fill timeout.*{named} give them by"):
        play("shipped", None)
    assert read_run(play("told", controller)).metadata["controller_parameters"]["model.contact_pressure"] == 3.1
