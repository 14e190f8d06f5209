"""Identification of a power shift: a rig drawn at random, its truth by an integration of its own (benchmarks/shift_truth.py).

Many rigs are `python -m benchmarks.power_shift`; here one rig shows each statement.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import clutch_hil as ch
from benchmarks.power_shift import TrueShift, compute_errors, list_outside, play, play_scale
from benchmarks.shift_loop import NO_FAULT, ShiftLoop, make_true_calibration, play_hand_over
from clutch_hil.bench.run_file import read_run
from clutch_hil.bench.scenario import load_scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.up import Bench
from clutch_hil.command import make_application
from clutch_hil.commands.identify import FILES, MAPS_OF_TWO
from clutch_hil.discrepancy.experiment_design import Experiment
from clutch_hil.discrepancy.experiments.shift_set import NAMES, play_shift_courses
from clutch_hil.fitting.model import Columns
from clutch_hil.identify import identification
from clutch_hil.identify.courses.clutch_courses import Span
from clutch_hil.identify.courses.shift_courses import COURSES, SCALE, Spans, format_course
from clutch_hil.identify.fit_plan import FitPlan, Subject
from clutch_hil.identify.recorded_runs.motor_limit import LIMIT
from clutch_hil.identify.thesis_quantities import Propagation
from clutch_hil.identify.two_clutches.driveline import identify_driveline
from clutch_hil.identify.two_clutches.hand_over import HandOver, compute_pressures, find_hand_overs
from clutch_hil.identify.two_clutches.power_shift import ShiftIdentification, identify_power_shift
from plant_sim.profiles.shift_profile import load_shift_profile
from plant_sim.rigs import power_shift, wet_clutch
from protocols.errors import InputError
from protocols.files.run import Run
from protocols.files.runs import write_run
from rt_controller.loop.parameter_sets import load_controller_parameters

SEED = 3
PLAYED = ("stribeck_a", "stribeck_b", "dynamics", "hand_over")
# of the issue for one clutch: relative, relative, mbar, relative
MAPS, SHAPES, CONTACT, INERTIA = 0.02, 0.10, 10.0, 0.02
ROAD = 0.02  # of vehicle and rolling resistance: as of the motor's inertia
LEAST_INSIDE = 0.85  # of 61 intervals of 95 % of one rig: fewer than 52 have a probability below 1e-3
GUARD, HIGHEST = 31.4, 4.5  # rad/s and bar that no course may ask for
LARGER = 6.0  # times the torques of the shipped rig
DRIVEN = 5.0  # rad/s, of the output shaft: no course drove the vehicle faster


@pytest.fixture(scope="module")
def rig() -> TrueShift:
    return TrueShift.draw(SEED)


@pytest.fixture(scope="module")
def runs(rig: TrueShift) -> list[Run]:
    return play(rig, SEED, PLAYED)


@pytest.fixture(scope="module")
def outcome(runs: list[Run]) -> ShiftIdentification:
    return identify_power_shift(runs)


@pytest.fixture(scope="module")
def calibration(outcome: ShiftIdentification, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calibration") / "calibration.toml"
    outcome.calibration.write(path)
    return path


@pytest.fixture(scope="module")
def loop(rig: TrueShift, calibration: Path) -> ShiftLoop:
    return play_hand_over(rig.values, calibration)


def test_both_clutches_and_the_driveline_are_those_of_the_rig(rig: TrueShift, outcome: ShiftIdentification) -> None:
    errors = compute_errors(outcome, rig.values)
    assert max(errors[name] for name in ("M_C", "C_v", "beta")) < MAPS
    assert max(e for name, e in errors.items() if name.startswith("clutch.")) < SHAPES
    assert errors["contact [mbar]"] < CONTACT
    assert errors["motor.inertia"] < INERTIA
    assert max(errors["driveline.vehicle_inertia"], errors["driveline.rolling_resistance"]) < ROAD


def test_intervals_hold_the_truth(rig: TrueShift, outcome: ShiftIdentification) -> None:
    count, outside = list_outside(outcome, rig.values)
    assert count == 61
    assert len(outside) <= (1.0 - LEAST_INSIDE) * count, outside


def test_the_residual_is_noise(outcome: ShiftIdentification) -> None:
    assert max(outcome.misfit.values()) < 1.1


def test_the_hand_overs_are_there_with_the_pressures_of_the_rig(rig: TrueShift, outcome: ShiftIdentification) -> None:
    forward, backward = outcome.hand_overs
    assert forward.begin < forward.time < forward.end < backward.begin
    assert 0.0 < forward.half < 0.005
    true = {
        c: Propagation({**part.propagation.values, **power_shift.select_clutch(rig.values, c)}, [], np.zeros((0, 0)))
        for c, part in outcome.parts.items()
    }
    theirs = [q for one in outcome.hand_overs for q in compute_pressures(one, true, rig.ratios)]
    ours = [q for q in outcome.quantities if q.where == "hand-over"]
    assert len(ours) == 4
    for mine, other in zip(ours, theirs, strict=True):
        assert mine.value == pytest.approx(other.value, abs=1e-3 * CONTACT)
        assert 0.0 < mine.half < 1e-3 * CONTACT


@pytest.mark.parametrize(
    ("torque", "slip", "count"), [(30.0, 5.0, 2), (30.0, 0.1, 0), (1000.0, 5.0, 0), (180.0, 5.0, 1)]
)
def test_a_clutch_that_cannot_carry_half_of_it_has_no_pressure_there(torque: float, slip: float, count: int) -> None:
    nominal = power_shift.load_nominal()
    known = {
        c: Propagation(
            {n: p.value for n, p in power_shift.select_clutch_parameters(nominal, c).items()}, [], np.zeros((0, 0))
        )
        for c in "ab"
    }
    one = HandOver("run", 1.0, 0.001, 0.9, 1.1, torque, (3.0, 3.0), (slip, -slip), (70.0, 70.0))
    assert len(compute_pressures(one, known, (3.0, 2.0))) == count


def test_plant_and_both_controllers_read_the_file(outcome: ShiftIdentification, calibration: Path) -> None:
    plant = power_shift.load_nominal(calibration)
    for p in outcome.calibration.parameters:
        assert plant[p.name].value == p.value
    for clutch in "ab":
        own = load_controller_parameters(calibration, clutch)
        assert own["model.stribeck_speed"].value == outcome.calibration[f"{clutch}.clutch.stribeck_speed"].value
        assert own["model.motor_inertia"].value == outcome.calibration["motor.inertia"].value
        settings = RunSettings(rate=500, controller_parameters=calibration, controller={"phases.torque_mismatch": 60.0})
        changed = settings.make_controller(clutch).parameters
        assert changed["model.contact_pressure"].value == own["model.contact_pressure"].value
        assert changed["phases.torque_mismatch"].value == 60.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('rig = "power_shift"', 'rig = "wet_clutch"', "is of the rig 'wet_clutch'"),
        ("controller_b", "controller_c", r"has no table \[controller_b\]"),
        ("valve_gain = { value = ", "valve_gain = { value = -1", "is outside"),
    ],
)
def test_what_is_of_another_rig_or_out_of_bounds_is_refused(
    tmp_path: Path, calibration: Path, old: str, new: str, words: str
) -> None:
    file = tmp_path / "changed.toml"
    file.write_text(calibration.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=words):
        load_controller_parameters(file, "b")


def test_a_rig_of_one_clutch_refuses_it(calibration: Path) -> None:
    for read in (wet_clutch.load_nominal, load_controller_parameters):
        with pytest.raises(InputError, match="is of the rig 'power_shift'"):
            read(calibration)


def test_the_hand_over_is_as_good_as_with_the_true_calibration(loop: ShiftLoop) -> None:
    assert loop.known.fault == NO_FAULT
    assert loop.is_as_good, str(loop)
    assert not loop.known.warning
    assert not loop.identified.warning


def test_the_wrong_calibration_is_told(loop: ShiftLoop) -> None:
    assert not loop.shipped.is_as_good_as(loop.known)
    assert loop.is_told, str(loop)


def test_a_hand_over_alone_becomes_files_and_warnings(tmp_path: Path, runs: list[Run]) -> None:
    path, out = tmp_path / "hand_over.parquet", tmp_path / "mine"
    write_run(runs[-1], path)
    result = CliRunner().invoke(make_application(), ["identify", str(path), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert sorted(file.name for file in out.iterdir()) == sorted((*FILES[:4], *MAPS_OF_TWO))
    document = json.loads((out / FILES[1]).read_text(encoding="utf-8"))
    assert len(document["hand_overs"]) == 2
    for clutch in "ab":
        assert any(text.startswith(f"clutch {clutch}: the temperature law needs") for text in document["warnings"])
        assert document["held"][f"{clutch}.oil.viscous_gain"] == "the runs do not excite it"
    assert "Hand-over" in (out / FILES[2]).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"hold": {"a.nosuch": None}}, "a.nosuch"),
        ({"bounds": {"clutch.attraction": (1.0, 2.0)}}, "clutch.attraction"),
        ({"ties": {"a.valve.gain": "b.valve.gain"}}, "same clutch"),
        (
            {"ties": {"a.valve.gain": "a.valve.damping", "a.valve.damping": "a.valve.gain"}},
            "which is tied to a.valve.gain",
        ),
        ({"hold": {"driveline.wheel_radius": -1.0}}, "driveline.wheel_radius"),
        (
            {"hold": {"driveline.ratio_a": 2.0}},
            "driveline.ratio_a and driveline.ratio_b are both 2; two gears must differ",
        ),
        ({"bounds": {"driveline.wheel_radius": (0.2, 0.4)}}, "bounds of driveline.wheel_radius have no effect"),
        (
            {"bounds": {"motor.inertia": (0.01, 0.1)}, "hold": {"motor.inertia": None}},
            "bounds of motor.inertia have no effect",
        ),
    ],
)
def test_wrong_options_are_one_sentence_before_any_run_is_read(options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        ch.identify_clutch(["nosuch.parquet"], rig="power_shift", **options)


class FitBegunError(Exception):
    """A fit begins."""


def scale_torques(run: Run) -> Run:
    """A run of a rig whose torques are `LARGER` times as large, and which moves alike."""
    columns = {name: values * (LARGER if name.endswith("_nm") else 1.0) for name, values in run.columns.items()}
    return replace(run, columns=columns)


def test_a_larger_power_shift_is_taken_as_one(runs: list[Run], monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[float] = []

    def begin(subject: Subject, plan: FitPlan, runs: list[Columns], *_: object) -> None:
        given.append(subject.nominal[LIMIT].value)
        raise FitBegunError

    monkeypatch.setattr(identification, "fit_clutch", begin)
    with pytest.raises(FitBegunError):  # the checks of its runs are passed
        identify_power_shift([scale_torques(run) for run in runs])
    largest = max(np.abs(run.columns["clutch_torque_a_nm"]).max() for run in runs) * LARGER
    assert largest <= given[0] <= 1.25 * largest


def test_the_driveline_of_a_larger_one_is_as_many_times_larger(rig: TrueShift, runs: list[Run]) -> None:
    limit = LARGER * 40.0
    whole = power_shift.load_nominal().with_values({LIMIT: limit})
    of_interest = [run for name, run in zip(PLAYED, runs, strict=True) if name == "dynamics"]
    outcome = identify_driveline({"dynamics": scale_torques(of_interest[0]).columns}, whole, {}, {}, lambda _: None)
    for name, half in zip(outcome.fitted, outcome.half, strict=True):
        true = rig.values[name] * (1.0 if name in ("driveline.rolling_resistance", "driveline.grade") else LARGER)
        assert abs(outcome.values[name] - true) < 2.5 * half, name
    assert {"motor.inertia", "motor.proportional_gain", "driveline.vehicle_inertia"} <= set(outcome.fitted)


def test_a_hand_over_of_a_larger_one_is_found(runs: list[Run], outcome: ShiftIdentification) -> None:
    larger = scale_torques(runs[PLAYED.index("hand_over")]).columns
    ratios = outcome.propagation.values["driveline.ratio_a"], outcome.propagation.values["driveline.ratio_b"]
    own = find_hand_overs("", larger, ratios, LARGER * 40.0)
    assert [one.time for one in own] == pytest.approx([one.time for one in outcome.hand_overs], abs=0.02)
    assert not find_hand_overs("", larger, ratios, 1e5)  # of a rig so large that they are noise


def test_runs_of_one_clutch_alone_are_refused(runs: list[Run]) -> None:
    with pytest.raises(InputError, match="do not open the valve of clutch b"):
        ch.identify_clutch(runs[:1])


@pytest.mark.parametrize("span", [Span(2.35, slope=14.0), Span.of_line(14.0, 3.0, 30.0), Span.of_line(25.0, 1.7, 30.0)])
def test_courses_stay_within_the_limits_of_the_guard(tmp_path: Path, span: Span) -> None:
    spans = Spans({"a": span, "b": Span(2.6, slope=12.0)}, (3.0, 2.0))
    for make, _ in (SCALE, *COURSES.values()):
        course, path = make(spans), tmp_path / "course.csv"
        path.write_text(format_course(course.title, course.rows), encoding="utf-8")
        profile = load_shift_profile(str(path))
        assert max(max(profile.a.pressure), max(profile.b.pressure)) <= HIGHEST
        assert profile.a.pressure[-1] == profile.b.pressure[-1] == 0.0
        assert max(np.abs(profile.a.speed)) < GUARD - 2.0 * DRIVEN


def test_the_set_is_laid_out_from_the_contact_pressures_that_its_first_run_shows(
    tmp_path: Path, rig: TrueShift
) -> None:
    played: list[Experiment] = []

    def pretend(experiment: Experiment, number: int) -> Path:
        played.append(experiment)
        path = tmp_path / f"{experiment.name}.parquet"
        if number == 0:
            write_run(play_scale(rig, SEED), path)
        return path

    assert len(list(play_shift_courses(tmp_path, 1000, pretend, power_shift.load_nominal()))) == len(NAMES)
    fill = load_shift_profile(played[1].profile).a.pressure
    contact = rig.values["a.piston.contact_pressure"]
    assert min(p for p in fill if p > 0.0) == pytest.approx(contact + 0.15, abs=0.1)


def test_the_set_is_not_played_blind() -> None:
    words = ["experiment", "identify", "--scenario", "shift", "--blind"]
    error = CliRunner().invoke(make_application(), words).exception
    assert isinstance(error, InputError)
    assert "blind" in str(error)


def test_a_bench_gives_each_of_its_controllers_its_part(tmp_path: Path, local_bus: str) -> None:
    path = tmp_path / "calibration.toml"
    make_true_calibration({"a.valve.gain": 2.4, "b.valve.gain": 2.6}).write(path)
    given = {"plant_parameters": path, "controller_parameters": path, "seconds": 0.2, "out": tmp_path}
    bench = Bench(load_scenario("shift", given), local_bus, lockstep=True, telemetry=False)
    run = read_run(bench.run(quiet=True).document["run"])
    assert run.metadata["controller_parameters"]["pressure.valve_gain"] == 2.4
    assert run.metadata["controller_b_parameters"]["pressure.valve_gain"] == 2.6
