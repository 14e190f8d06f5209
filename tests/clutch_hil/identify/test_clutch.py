"""Identification of a wet clutch: a rig drawn at random, its truth by the battery's own integration.

Many rigs are `python -m benchmarks.identification`; here one rig shows each statement.
"""

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import clutch_hil as ch
from benchmarks.identification import compute_maps_error, draw, list_true_values, list_values, play, split_effects
from benchmarks.identified_loop import NO_FAULT, WORSE, follow_torque
from benchmarks.pressure_loop import find_bandwidth
from clutch_hil.bench.judgement.calibration_check import describe_mismatch
from clutch_hil.identify.identification import Identification, identify_clutch
from clutch_hil.identify.misfit import warn_misfit
from clutch_hil.identify.report.picture import format_table
from clutch_hil.identify.report.report_page import compose_report, make_verdict_sentence
from clutch_hil.identify.thesis_quantities import ABOVE, SPEED, compute_torque
from clutch_hil.recordings.checks.finding import Finding
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.run import Run
from rt_controller.loop.parameter_sets import load_controller_parameters

SEED = 2
MAPS, SHAPES, CONTACT, INERTIA = 0.02, 0.10, 0.010, 0.02  # of the issue: relative, relative, bar, relative
BANDWIDTH = 0.3  # Hz, of the issue
LEAST_INSIDE = 0.8  # of 26 intervals of 95 % of one rig: fewer than 21 have a probability below 1e-3
# of 7 intervals that hold the offset, drag or delay that is not there; fewer are less probable than 4e-3
LEAST_ABSENT = 5
DECLARED = {name: p.value for name, p in wet_clutch.load_nominal().items()}


@pytest.fixture(scope="module")
def rig() -> np.ndarray:
    return draw(SEED)


@pytest.fixture(scope="module")
def runs(rig: np.ndarray) -> list[Run]:
    return play(rig, SEED)


@pytest.fixture(scope="module")
def dirty(runs: list[Run]) -> list[Run]:
    """The runs, one of them with outliers and a faulted stretch: what is identified is to be the same."""
    torque = runs[1]["clutch_torque_nm"].copy()
    torque[5000:5040] = 49.0
    torque[1000::2000] = 655.35  # a logger that misses a value writes what is possible in 16 bits
    fault = np.zeros(len(torque))
    fault[15_000:] = 4.0
    columns = {**runs[1].columns, "clutch_torque_nm": torque, "controller_fault": fault}
    return [runs[0], replace(runs[1], columns=columns), *runs[2:]]


@pytest.fixture(scope="module")
def result(dirty: list[Run]) -> Identification:
    return identify_clutch(dirty, force=True)  # the checks would refuse the outliers


@pytest.fixture(scope="module")
def calibration(result: Identification, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calibration") / "calibration.toml"
    result.calibration.write(path)
    return path


def test_the_maps_are_those_of_the_rig(rig: np.ndarray, result: Identification) -> None:
    assert max(compute_maps_error(list_values(result, DECLARED), list_true_values(rig)).values()) < MAPS


@pytest.mark.parametrize("name", ["clutch.stribeck_speed", "clutch.viscous_exponent", "clutch.attraction"])
def test_the_shape_of_the_curve_is_that_of_the_rig(rig: np.ndarray, result: Identification, name: str) -> None:
    assert result.calibration[name].value == pytest.approx(list_true_values(rig)[name], rel=SHAPES)


def test_contact_pressure_and_inertia_are_those_of_the_rig(rig: np.ndarray, result: Identification) -> None:
    true = list_true_values(rig)
    assert result.calibration["piston.contact_pressure"].value == pytest.approx(
        true["piston.contact_pressure"], abs=CONTACT
    )
    assert result.calibration["motor.inertia"].value == pytest.approx(true["motor.inertia"], rel=INERTIA)


def test_intervals_hold_the_truth(rig: np.ndarray, result: Identification) -> None:
    true = list_true_values(rig)
    own, effects = split_effects(result)
    inside = [p.interval[0] <= true[p.name] <= p.interval[1] for p in own]
    assert len(inside) == 26
    assert sum(p.interval[0] <= 0.0 <= p.interval[1] for p in effects) >= LEAST_ABSENT
    assert np.mean(inside) >= LEAST_INSIDE


def test_its_loop_and_the_quantities_of_the_thesis_are_those_of_the_rig(
    rig: np.ndarray, result: Identification
) -> None:
    assert result.response is not None
    assert result.response.pressure.bandwidth == pytest.approx(find_bandwidth(rig), abs=BANDWIDTH)
    true = {**DECLARED, **list_true_values(rig)}
    named = {q.name: q for q in result.quantities if q.at.endswith("degC") or not q.at}
    line = np.polyfit(p := true["piston.contact_pressure"] + np.array(ABOVE), compute_torque(true, p, SPEED, 70.0), 1)
    assert named["a_M"].value == pytest.approx(line[0], rel=MAPS)
    assert named["p_contact of the line"].value == pytest.approx(-line[1] / line[0], abs=CONTACT)
    assert 0.0 < named["a_M"].half < MAPS * line[0]


def test_what_is_left_above_the_noise_is_told_by_output() -> None:
    (sentence,) = warn_misfit({"clutch_torque_nm": 1.3, "motor_torque_nm": 1.2, "slip_speed_rad_s": 3.27})
    above = "clutch_torque_nm (1.3 times), slip_speed_rad_s (3.27 times)"
    assert sentence.startswith(f"outputs left above their noise: {above}; usual is 1.2 at most. ")
    assert warn_misfit({"clutch_torque_nm": 1.0}) == []
    (sentence,) = warn_misfit({"clutch_torque_nm": 1.31}, logged=True)
    assert (
        "log every cycle of the loop. If these rows are every cycle, but have no angle of an encoder, give them one by a"
        " formula (docs/identify.md#a-missing-sensor). Otherwise the model or the recording" in sentence
    )
    (sentence,) = warn_misfit({"clutch_torque_nm": 2.0}, ["oil.heat_transfer", "clutch.attraction"])
    assert (
        "parameters differ more than assumed (clutch.attraction, oil.heat_transfer), or the model or recording lacks something"
        in sentence
    )


def test_plant_and_controller_read_the_file(result: Identification, calibration: Path) -> None:
    plant, controller = wet_clutch.load_nominal(calibration), load_controller_parameters(calibration)
    for p in result.calibration.parameters:
        assert plant[p.name].value == p.value
    assert controller["model.stribeck_speed"].value == result.calibration["clutch.stribeck_speed"].value
    assert 0.9 < controller["model.coulomb_slope"].value / result.calibration["clutch.coulomb_slope"].value < 1.0
    assert controller["pressure.valve_gain"].value == result.calibration["valve.gain"].value


def test_the_file_has_runs_units_and_correlation(result: Identification, calibration: Path) -> None:
    document = tomllib.loads(calibration.read_text(encoding="utf-8"))
    assert document["calibration"]["rig"] == "wet_clutch"
    assert len(document["calibration"]["runs"]) == 5
    assert np.shape(document["correlation"]["matrix"]) == (26, 26)
    assert document["plant"]["clutch"]["coulomb_slope"]["unit"] == "Nm/bar"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('rig = "wet_clutch"', 'rig = "power_shift"', "is of the rig 'power_shift'"),
        ("[controller.model]", "[other.model]", "has no table"),
        ("gain = { value = ", "gain = { value = -1", "is outside"),
    ],
)
def test_a_controller_refuses_what_is_not_its_own(
    tmp_path: Path, calibration: Path, old: str, new: str, words: str
) -> None:
    file = tmp_path / "changed.toml"
    text = calibration.read_text(encoding="utf-8")
    if "controller" in old:
        text = text[: text.index("[controller.")] + text[text.index("[correlation]") :]
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=words):
        load_controller_parameters(file)


def test_a_controller_with_it_follows_as_one_that_knows_the_rig(rig: np.ndarray, calibration: Path) -> None:
    loop = follow_torque(list_true_values(rig), calibration)
    assert loop.known.fault == NO_FAULT
    assert not loop.known.warned
    assert not loop.identified.warned
    assert loop.ratio <= WORSE
    assert loop.shipped.fault == "fill timeout"  # it is another clutch's, and that is told


def describe(run: Run) -> str | None:
    return describe_mismatch(run.columns, run.metadata["controller_parameters"])


def test_a_calibration_of_another_clutch_that_makes_no_fault_is_warned_of() -> None:
    values = {"clutch.coulomb_slope": 8.0, "clutch.coulomb_intercept": -18.6}
    options = {"scenario": "engagement", "adaptation": False}
    other = ch.simulate(**options, plant=values)  # type: ignore[arg-type]
    assert ch.measure_run(other)["fault"] == "none"
    assert "its calibration belongs to another clutch" in (describe(other) or "")
    assert describe(ch.simulate(**options)) is None  # type: ignore[arg-type]
    drifted = ch.simulate(**options, plant={"friction_level.level": 0.97})  # type: ignore[arg-type]
    assert "its calibration or the torque sensor is off" in (describe(drifted) or "")


def test_a_torque_that_turns_a_flywheel_is_no_wrong_calibration() -> None:
    assert describe(ch.simulate("free_inertia")) is None


def test_slips_that_do_not_tell_a_stribeck_speed_are_told_and_move_nothing_else(
    rig: np.ndarray, runs: list[Run], tmp_path: Path
) -> None:
    """Held at its declared value V_S took a third of the others beyond their intervals."""
    result = identify_clutch([runs[1]])
    assert any("V_S" in text for text in result.calibration.warnings)
    assert result.calibration.held["clutch.stribeck_speed"] == "the runs do not excite it"
    own, _ = split_effects(result)
    assert "clutch.stribeck_speed" not in {p.name for p in own}
    true = list_true_values(rig)
    assert np.mean([p.interval[0] <= true[p.name] <= p.interval[1] for p in own]) >= LEAST_INSIDE
    result.calibration.write(tmp_path / "calibration.toml")
    value, why = result.calibration.fixed["clutch.stribeck_speed"]
    assert wet_clutch.load_nominal(tmp_path / "calibration.toml")["clutch.stribeck_speed"].value == value
    assert "known roughly" in why


def test_an_identification_of_nothing_but_absent_effects_is_shown(result: Identification) -> None:
    """As where the user holds all but an effect, which then is absent."""
    nothing = replace(result.calibration, parameters=[], correlation=np.zeros((0, 0)))
    bare = replace(result, calibration=nothing)
    assert format_table(bare)[0].split()[:2] == ["parameter", "identified"]
    assert "0 parameters identified" in compose_report(bare, [], "")
    assert "Correlation of the parameters" not in compose_report(bare, [], "")


def test_the_page_counts_one_warning_and_shows_a_small_change_without_sign(result: Identification) -> None:
    p = result.calibration["valve.gain"]
    same = replace(p, value=p.declared * (1.0 - 1e-5))
    one = replace(result.calibration, parameters=[same], correlation=np.eye(1), warnings=["only one"])
    page = compose_report(replace(result, calibration=one), [], "")
    assert "<b>1</b>warning</li>" in page
    assert "<b>1</b>parameter identified</li>" in page
    assert ">0.0 %<" in page
    assert "−0.0 %" not in page


def test_what_rows_of_a_logger_leave_is_not_only_missing_physics(result: Identification) -> None:
    left = replace(result, misfit={**result.misfit, "cylinder_pressure_bar": 1.6}, findings=[])
    assert "log every cycle" not in make_verdict_sentence(left)
    logged = replace(left, findings=[Finding("logged", "time_s", (0, 9), "are taken as a logger's", False)])
    assert "The low rate of a logger alone can cause this: log every cycle of the loop." in make_verdict_sentence(
        logged
    )


def test_outliers_and_a_faulted_stretch_are_left_out(result: Identification) -> None:
    assert any("outliers" in note for note in result.calibration.notes)
    assert any(
        "7 samples far from the neighbours: replaced by the median of five rows" in note
        for note in result.calibration.notes
    )
    assert any("fault" in note for note in result.calibration.notes)


@pytest.mark.parametrize(
    ("column", "change", "words"),
    [
        ("clutch_torque_nm", lambda values: -values, "clutch_torque_nm, .* reverse its sign"),
        ("clutch_torque_nm", lambda values: 0.7376 * values, "moves 0.738 times as much as motor_torque_nm .* lbf ft"),
        ("motor_torque_nm", lambda values: 0.7376 * values, "moves 1.36 times as much as motor_torque_nm .* lbf ft"),
        (
            "motor_speed_demand_rad_s",
            lambda values: -values,
            "slip_speed_rad_s, .* reverse its sign, or that of an input",
        ),
        ("clutch_torque_nm", lambda values: 0.0 * values, "no torque that rises with the pressure"),
        ("motor_torque_nm", lambda values: 0.0 * values, "but motor_torque_nm, the same torque, does not"),
        ("cylinder_pressure_bar", lambda values: 0.0 * values + 3.0, "no torque that rises with the pressure"),
    ],
)
def test_a_torque_that_follows_no_pressure_or_a_turned_sign_is_refused(  # type: ignore[no-untyped-def]
    runs: list[Run], column: str, change, words: str
) -> None:
    wrong = [replace(run, columns={**run.columns, column: change(run[column])}) for run in runs]
    with pytest.raises(InputError, match=words):
        identify_clutch(wrong)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rig": "power_shift"}, "is a run of the rig wet_clutch"),
        ({"rig": "nosuch"}, "nosuch"),
        ({"hold": {"clutch.nosuch": None}}, "clutch.nosuch"),
        ({"bounds": {"valve.gain": (3.0, 2.0)}}, "valve.gain"),
        (
            {"bounds": {"sensors.pressure_sensitivity": (0.9, 1.1)}},
            "have no effect, because it is not fitted; fitted are",
        ),
        ({"bounds": {"valve.gain": (2.0, 3.0)}, "hold": {"valve.gain": None}}, "bounds of valve.gain have no effect"),
        ({"bounds": {"motor.inertia": (-1.0, 1.0)}}, "motor.inertia"),
        ({"hold": {"valve.gain": 1e9}}, "valve.gain"),
        ({"ties": {"valve.gain": "nosuch.name"}}, "nosuch.name"),
        ({"ties": {"valve.gain": "standstill.lag"}}, "standstill.lag"),
        (
            {"ties": {"valve.gain": "valve.damping", "valve.damping": "valve.frequency"}},
            "valve.gain is tied to valve.damping, which is tied to valve.frequency",
        ),
        ({"ties": {"valve.gain": "valve.gain"}}, "allowed is a parameter that is not tied"),
        ({"ties": {"valve.gain": "valve.damping"}, "hold": {"valve.gain": 2.4}}, "valve.gain is both held and tied to"),
    ],
)
def test_wrong_options_are_one_sentence(runs: list[Run], options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        identify_clutch(runs[:1], **options)


@pytest.mark.parametrize(
    ("column", "change", "words"),
    [
        ("cylinder_pressure_bar", lambda values: 100.0 * values, "where the rig has -10 to 25"),
        ("oil_temperature_degc", lambda values: 1.8 * values + 32.0, "where the rig has -40 to 130"),
        ("oil_temperature_degc", lambda values: values + 273.15, "where the rig has -40 to 130"),
        ("cylinder_pressure_bar", lambda values: np.minimum(values, 3.0), "rests at its end, 3 bar"),
        ("clutch_torque_nm", lambda values: np.minimum(values, 0.6 * values.max()), "rests at its end"),
    ],
)  # fmt: skip
def test_a_value_that_the_rig_or_its_sensor_cannot_have_is_refused_before_anything_is_fitted(
    runs: list[Run], column: str, change: Callable[[np.ndarray], np.ndarray], words: str
) -> None:
    wrong = replace(runs[0], columns={**runs[0].columns, column: change(runs[0][column])})
    sentence: list[str] = []
    with pytest.raises(InputError, match=rf"^run 1: {column}, .*{words}.*--force-checks"):
        identify_clutch([wrong], progress=lambda what, share: sentence.append(what))
    assert sentence == []


@pytest.mark.parametrize("rows", [0, 1, 7])
def test_a_run_of_next_to_nothing_is_refused(runs: list[Run], rows: int) -> None:
    short = replace(runs[0], columns={name: values[:rows] for name, values in runs[0].columns.items()})
    with pytest.raises(InputError):
        identify_clutch([short])


def test_a_value_that_is_no_number_is_refused_by_column(runs: list[Run]) -> None:
    torque = runs[0]["clutch_torque_nm"].copy()
    torque[100] = np.nan
    with pytest.raises(InputError, match="clutch_torque_nm"):
        identify_clutch([replace(runs[0], columns={**runs[0].columns, "clutch_torque_nm": torque})])


def test_without_runs_nothing_is_identified() -> None:
    with pytest.raises(InputError, match="has no runs"):
        identify_clutch([])
