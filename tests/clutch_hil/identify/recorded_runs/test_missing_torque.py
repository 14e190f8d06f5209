"""Rigs without a torque sensor at the clutch: they are identified by the torque of their motor."""

import numpy as np
import pytest

from clutch_hil.bench.in_memory import simulate
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.identify.clutch_effects import MOTOR, TORQUE, find_vented
from clutch_hil.identify.fit_plan import Subject
from clutch_hil.identify.identification import Identification, identify_clutch
from clutch_hil.identify.recorded_runs.missing_torque import (
    CLUTCH_TORQUE,
    complete_torque,
    describe_missing_torque,
)
from clutch_hil.identify.recorded_runs.run_evidence import Evidenced
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.run import Run

NOMINAL = wet_clutch.load_nominal()
OFFSET = 0.6  # Nm, of the motor's torque
PROFILES = ("engagement", "multisine", "stribeck_staircase")


def play(profile: str, seed: int, *lacking: str) -> Run:
    """A run of the bench's own clutch as it is measured, without the columns `lacking`; its motor's torque has an offset."""
    run = simulate(profile=profile, seed=seed, effects={"motor_torque_sensor_offset": {"offset": OFFSET}})
    names = [n for n in run.columns if not n.startswith(("truth_", "controller_")) and n not in lacking]
    return Run({name: run[name] for name in names}, {"rig": "wet_clutch"})


def test_the_torque_that_takes_its_place_is_that_of_the_clutch_without_the_zero_of_the_motor() -> None:
    whole = play("engagement", 3)
    lacking = {name: values for name, values in whole.columns.items() if name != CLUTCH_TORQUE}
    completed = complete_torque(Evidenced({"a": lacking}, {}), NOMINAL["motor.inertia"].value).measured["a"]
    vented = find_vented(completed)
    assert np.count_nonzero(vented) > 100
    assert np.mean(completed[CLUTCH_TORQUE][vented]) == pytest.approx(0.0, abs=1e-9)
    calm = slice(3000, 4000)
    assert np.mean(completed[CLUTCH_TORQUE][calm]) == pytest.approx(np.mean(whole[CLUTCH_TORQUE][calm]), abs=0.03)


def test_a_run_that_is_never_vented_keeps_the_zero() -> None:
    run = {name: values[3000:4000] for name, values in play("engagement", 3, CLUTCH_TORQUE).columns.items()}
    assert not np.any(find_vented(run))
    completed = complete_torque(Evidenced({"a": run}, {}), 0.05).measured["a"]
    assert np.mean(completed[CLUTCH_TORQUE]) == pytest.approx(np.mean(run["motor_torque_nm"]), abs=0.05)


def test_what_is_missing_is_told() -> None:
    run = {CLUTCH_TORQUE: np.zeros(3)}
    assert describe_missing_torque(Evidenced({"a": run}, {})) == ""
    assert describe_missing_torque(Evidenced({"a": run, "b": {}}, {})).startswith(
        "run b lacks clutch_torque_nm: the clutch"
    )
    given = {"a": {CLUTCH_TORQUE: "motor_torque_nm - 0.05 * derivative(slip_speed_rad_s)"}}
    sentence = describe_missing_torque(Evidenced({"a": run}, {}, (), given))
    assert sentence.startswith("clutch_torque_nm of run a is computed from the motor's torque")


def test_a_subject_without_an_output_compares_the_rest() -> None:
    model, whole = Subject("", NOMINAL, WetClutch).without_output(CLUTCH_TORQUE).make(NOMINAL), WetClutch(NOMINAL)
    assert {o.column for o in whole.outputs} - {o.column for o in model.outputs} == {CLUTCH_TORQUE}


@pytest.mark.parametrize("lacking", ["motor_torque_nm", "motor_speed_demand_rad_s"])
def test_without_both_torques_or_a_demand_it_is_refused(lacking: str) -> None:
    with pytest.raises(
        InputError, match="run 1 lacks the column clutch_torque_nm; it may be missing if torque and speed"
    ):
        identify_clutch([play("engagement", 3, CLUTCH_TORQUE, lacking)])


@pytest.fixture(scope="module")
def result() -> Identification:
    return identify_clutch([play(profile, seed, CLUTCH_TORQUE) for seed, profile in enumerate(PROFILES, 3)])


def test_a_clutch_is_identified_by_the_torque_of_its_motor(result: Identification) -> None:
    names = (
        "valve.gain", "piston.contact_pressure", "piston.preload_pressure", "hydraulics.conductance", "clutch.coulomb_slope",
        "clutch.beta_inf", "clutch.stribeck_speed", "clutch.attraction", "motor.inertia", "motor.proportional_gain",
    )  # fmt: skip
    for one in (result.calibration[name] for name in names):
        low, high = one.interval
        assert low - 0.25 * (high - low) <= NOMINAL[one.name].value <= high + 0.25 * (high - low), one
        assert high - low < 0.15 * one.value, one
    assert result.calibration[MOTOR].value == pytest.approx(OFFSET, abs=0.02)
    assert max(result.misfit.values()) < 1.2
    assert CLUTCH_TORQUE not in result.misfit


def test_the_missing_sensor_is_told_and_has_no_zero(result: Identification) -> None:
    assert result.calibration.warnings[0].startswith("run 1 lacks clutch_torque_nm")
    assert TORQUE not in {one.name for one in [*result.calibration.parameters, *result.calibration.absent]}
