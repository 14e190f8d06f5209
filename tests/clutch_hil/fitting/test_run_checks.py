"""Checks of runs by their model: altered channels of a clutch and of an axis, and sound runs with faults of real sensors."""

import numpy as np
import pytest

import clutch_hil as ch
from benchmarks.battery.short_case import make_short_case
from benchmarks.dirty_channels import (
    DirtyCase,
    list_alterations,
    make_pneumatic_cylinder,
    make_position_axis,
    make_sliding_cases,
    make_tribometer,
    make_wet_clutch,
    name_wrong,
)
from benchmarks.identification import draw, play
from clutch_hil.discrepancy.memory import check_memory, estimate_memory
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.search import investigate
from clutch_hil.fitting.model import Columns
from clutch_hil.fitting.run_checks import check_evidence, check_without_baseline
from tests.clutch_hil.fitting.test_fit import record_run

MODEL = "tests/clutch_hil/fitting/test_fit.py:Amplifier"
# Strengths of the largest size that the battery has: gap of 4 floors behind 5 % noise
FAULTS = {
    "nothing": {},
    "pressure_sensor_gain": {"pressure_sensor_gain": 0.25},
    "pressure_sensor_offset": {"pressure_sensor_offset": 0.7},
    "torque_sensor_gain": {"torque_sensor_gain": -0.25},
    "torque_sensor_offset": {"torque_sensor_offset": -3.5},
    "torque_sensor_leakage": {"torque_sensor_leakage": 0.05},
    "torque_time_offset": {"torque_time_offset": 50.0},
    "pressure_time_offset": {"pressure_time_offset": 50.0},
    "temperature_sensor_lag": {"temperature_sensor_lag": 8.0},
    "sensor_saturation": {"sensor_saturation": 0.3},
    "saturation of twice that": {"sensor_saturation": 0.6},
    "coarse_quantisation": {"coarse_quantisation": 1.25},
}


@pytest.mark.parametrize(
    "make",
    [make_wet_clutch, make_position_axis, make_tribometer, make_pneumatic_cylinder],
    ids=lambda make: make.__name__,
)
def test_every_altered_channel_is_told(make) -> None:
    """What is only told: saturation, and offsets beside an area that may be another, which are for discovery to name, a
    demand that is cut off from below, a load that is set or has another zero, and sizes that another rig of the kind may have.
    """
    case: DirtyCase = make()
    assert check_evidence(case.model, case.runs) == []
    sentence = set()
    for column, name, runs in case.alter_each_channel():
        findings = check_evidence(case.model, runs)
        assert findings, f"{column} {name}"
        if not findings[0].hard:
            sentence.add((column, name))
    assert sentence <= {
        ("cylinder_pressure_bar", "saturated above"), ("cylinder_pressure_bar", "saturated below"),
        ("clutch_torque_nm", "saturated above"), ("clutch_torque_nm", "saturated below"),
        ("valve_voltage_v", "saturated below"), ("normal_load_n", "off"), ("normal_load_n", "dead at its mean"),
        ("pressure_bar", "off"), ("rod_force_n", "off"), ("position_m", "in cm"),
        *((column, f"in {unit}") for column in ("position_m", "displacement_m") for unit in ("inch", "dm", "sixteenths")),
    }  # fmt: skip


@pytest.mark.parametrize(("check", "factor", "offset"), [("offset", 1.0, 12.0), ("scale", 0.1, 0.0)])
def test_another_size_or_zero_of_a_rig_that_can_be_identified_names_the_command(
    check: str, factor: float, offset: float
) -> None:
    case = make_wet_clutch()
    runs = {
        name: run | {"clutch_torque_nm": factor * run["clutch_torque_nm"] + offset} for name, run in case.runs.items()
    }
    sentence = [str(one) for one in check_evidence(case.model, runs) if one.check == check]
    assert sentence
    assert all("of a rig that nobody has calibrated: clutch-hil identify RUN..." in one for one in sentence)


def test_a_rig_with_a_calibration_is_not_said_to_have_none() -> None:
    case = make_wet_clutch()
    model = WetClutch(WetClutch.list_nominal_parameters().with_values({"motor.inertia": 0.051}))
    runs = {name: run | {"clutch_torque_nm": 0.1 * run["clutch_torque_nm"]} for name, run in case.runs.items()}
    sentence = [str(one) for one in check_evidence(model, runs) if one.check == "scale"]
    assert sentence
    assert not [one for one in sentence if "nobody has calibrated" in one]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_real_fault_of_a_sensor_is_not_refused(fault: str) -> None:
    fitted, held_out = make_short_case(FAULTS[fault])
    assert not [str(finding) for finding in check_evidence(WetClutch(), fitted | held_out) if finding.hard]


@pytest.mark.slow
def test_no_effect_of_a_sliding_contact_is_refused() -> None:
    for name, case in make_sliding_cases(1):
        assert not [f"{name}: {finding}" for finding in check_evidence(case.model, case.runs) if finding.hard]


@pytest.fixture(scope="module")
def foreign() -> dict[str, Columns]:
    """Five runs of a clutch that nobody has calibrated. In the last one its plates slip, where those of the baseline stick."""
    return {f"run {n}": dict(run.columns) for n, run in enumerate(play(draw(2, 0.4), 2))}


def test_no_sign_of_another_clutch_is_called_turned(foreign: dict[str, Columns]) -> None:
    assert check_without_baseline(WetClutch(), foreign) == []
    against = [finding for finding in check_evidence(WetClutch(), foreign) if finding.check == "sign"]
    assert against
    assert not any(finding.hard for finding in against)
    assert "unless the rig is another one" in str(against[0])


@pytest.mark.parametrize(
    "column",
    ["motor_speed_demand_rad_s", "slip_speed_rad_s", "clutch_torque_nm", "motor_torque_nm", "cylinder_pressure_bar"],
)
def test_a_turned_sign_of_another_clutch_is_refused_before_it_is_identified(
    foreign: dict[str, Columns], column: str
) -> None:
    turned = {name: run | {column: -run[column]} for name, run in foreign.items()}
    assert [finding for finding in check_without_baseline(WetClutch(), turned) if finding.check == "sign"]


def test_one_bad_run_among_good_ones_is_named() -> None:
    case = make_wet_clutch()
    name = next(iter(case.runs))
    runs = {**case.runs, name: {**case.runs[name], "clutch_torque_nm": -case.runs[name]["clutch_torque_nm"]}}
    assert {finding.run for finding in check_evidence(case.model, runs)} == {name}


@pytest.mark.parametrize("factor", [0.1, 2.0, 3.28, 10.0, 39.37])
def test_a_path_of_another_size_or_unit_is_not_named_wrong(factor: float) -> None:
    """Dry friction is the same along any path. With a play for its flicker a tribometer's path had pre-sliding in it."""
    case = make_tribometer()
    runs = case.alter("displacement_m", lambda x, _: factor * x)
    assert not [str(finding) for finding in check_evidence(case.model, runs) if finding.hard]
    assert name_wrong(case, "displacement_m", "", runs)[1] == []


@pytest.mark.parametrize("factor", [0.225, 0.5, 2.0])
def test_a_friction_level_within_its_uncertainty_is_not_named(factor: float) -> None:
    case = make_tribometer()
    assert name_wrong(case, "", "", case.alter("friction_force_n", lambda x, _: factor * x)) == ("nothing_missing", [])


@pytest.mark.parametrize(
    ("make", "column"),
    [(make_tribometer, "friction_force_n"), (make_tribometer, "normal_load_n"), (make_position_axis, "motor_force_n"),
     (make_pneumatic_cylinder, "rod_force_n")],
)  # fmt: skip
def test_a_force_in_kgf_is_refused_by_its_unit(make, column: str) -> None:
    case: DirtyCase = make()
    findings = check_evidence(case.model, case.alter(column, list_alterations(column)["in kgf"]))
    assert findings[0].hard
    assert "kgf" in findings[0].text


@pytest.mark.parametrize("name", ["dead at 0", "in kN"])
def test_a_fit_at_its_bound_is_not_named_whatever_the_checks_say(name: str) -> None:
    """Past the checks, a force that is 0, or a thousandth, was a leaking sensor with its leak at the bound."""
    case = make_position_axis()
    runs = case.alter("motor_force_n", list_alterations("motor_force_n")[name])
    rows = 2000  # of 4 ms: two strokes to and fro are enough, and half of each run
    runs = {run: {column: values[:rows] for column, values in columns.items()} for run, columns in runs.items()}
    result = investigate(case.model, runs)
    assert (result.effects, result.alternatives) == ([], [])


def make_amplifier_runs(n: int = 4000) -> list[Columns]:
    return [record_run(seed, {"cubic.share": 0.3}, n) for seed in range(1, 4)]


def make_runs(columns: list[Columns]) -> list[ch.Run]:
    return [ch.Run(one, {}) for one in columns]


@pytest.mark.parametrize("n", [3, 300])
def test_a_short_run_ends_in_a_sentence(n: int) -> None:
    with pytest.raises(ch.InputError, match=f"run number 1: time_s, rows 0 to {n - 1}, is .* with {n} rows"):
        ch.find_discrepancy(make_runs(make_amplifier_runs(n)), rig=MODEL)


def test_three_rows_are_refused_by_force_too() -> None:
    with pytest.raises(ch.InputError, match=r"a run has 3 rows, 0.003 s; at least 8 means over 4 ms are needed"):
        ch.find_discrepancy(make_runs(make_amplifier_runs(3)), rig=MODEL, force=True)


def test_hard_checks_are_overruled_with_a_note() -> None:
    columns = [{**one, "output_v": -one["output_v"]} for one in make_amplifier_runs()]
    with pytest.raises(ch.InputError, match=r"output_v, rows 0 to 3999, goes against the baseline"):
        ch.find_discrepancy(make_runs(columns), rig=MODEL)
    forced = ch.find_discrepancy(make_runs(columns), rig=MODEL, force=True)
    assert "3 hard checks were overruled by --force" in str(forced)
    document = forced.result.as_json()
    assert document["forced"]
    assert [one["check"] for one in document["checks"]] == ["sign"] * 3
    assert document["notes"][0].startswith("hard checks were overruled")


def test_a_held_out_run_is_checked_as_well() -> None:
    bad = {**record_run(9, {}), "output_v": np.zeros(4000)}
    with pytest.raises(ch.InputError, match="run number 4: output_v"):
        ch.find_discrepancy(make_runs(make_amplifier_runs()), make_runs([bad]), rig=MODEL)


@pytest.mark.parametrize(("first", "rows"), [(1500, 1500), (2000, 1100)])
def test_a_short_piece_of_a_run_in_operation_is_not_refused_for_the_jump_at_its_beginning(
    first: int, rows: int
) -> None:
    """The model begins as measured, and then goes to its own, higher, torque: that is no movement that the run lacks."""
    hidden = {"friction_level.level": 0.9}
    whole, other = (ch.simulate(s, seed=1, plant=hidden, seconds=6.0) for s in ("engagement", "multisine"))
    piece = {name: values[first : first + rows] for name, values in whole.columns.items()}
    findings = check_evidence(WetClutch(), {"piece": piece, "whole": other.columns})
    assert not [str(finding) for finding in findings if finding.hard]


def test_a_noisier_run_is_noted_and_its_samples_are_no_outliers() -> None:
    """Noise 10 times as large as in the other runs: most of its samples are far from their neighbours."""
    random = np.random.default_rng(1)
    runs = {s: ch.simulate(profile=s, seed=1, seconds=6.0).columns for s in ("engagement", "multisine", "slip_sine")}
    column = "oil_temperature_degc"
    noisy = runs["slip_sine"][column] + random.normal(0.0, 1.0, len(runs["slip_sine"][column]))
    findings = check_evidence(WetClutch(), {**runs, "slip_sine": {**runs["slip_sine"], column: noisy}})
    (finding,) = findings
    assert (finding.check, finding.column, finding.run, finding.hard) == ("noisy", column, "slip_sine", False)
    assert finding.text == "has 9.9 times the noise of most runs, and counts for less"


def test_rows_behind_a_fault_do_not_count() -> None:
    columns = [{**one, "controller_fault": np.where(one["time_s"] < 3.0, 0.0, 4.0)} for one in make_amplifier_runs()]
    for one in columns:
        one["output_v"] = np.where(one["time_s"] < 3.0, one["output_v"], 1e3)
    outcome = ch.find_discrepancy(make_runs(columns), rig=MODEL)
    assert outcome.result.effects == ["cubic"]
    assert {len(trace.columns["time_s"]) for trace in outcome.result.traces} == {3000}
    assert any("shows a fault from 3 s on" in note for note in outcome.result.notes)


def test_a_search_too_large_for_memory_is_refused_before() -> None:
    time = 1e-3 * np.arange(2)
    short = dict.fromkeys(WetClutch.run_columns, time)
    long = {name: np.broadcast_to(values[0], 2_000_000) for name, values in short.items()}  # one number in memory
    long["time_s"] = 1e-3 * np.arange(2_000_000)
    assert estimate_memory(WetClutch(), [short]) < 1e6
    with pytest.raises(
        ch.InputError,
        match=rf"runs, 2000 s with {len(WetClutch().candidates)} candidates, needs .* GiB of memory",
    ):
        check_memory(WetClutch(), [long])
