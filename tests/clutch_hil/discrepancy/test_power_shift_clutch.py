"""One clutch of a power shift: the discrepancy workflow in runs of two clutches."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.discrepancy.experiment_design import propose
from clutch_hil.discrepancy.joint_fits import JointFits
from clutch_hil.discrepancy.models.named import find_model, select_evidence
from clutch_hil.discrepancy.models.power_shift_clutch import ClutchA, ClutchB, PowerShiftClutch
from clutch_hil.discrepancy.models.shaft_clutch import CYLINDER_SPEED
from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.fit import linearise
from clutch_hil.fitting.noise import estimate_floors
from clutch_hil.recordings.not_measured import read_not_measured
from plant_sim.rigs import power_shift
from protocols.errors import InputError
from protocols.files.run import Run

WEAR = {"b.clearance_change.change": 0.3}
SCENARIOS = ("shift", "lock_up_shift")


@pytest.fixture(scope="module")
def worn() -> list[Run]:
    """Two scenarios with worn plates in clutch b."""
    return [ch.simulate(name, plant=WEAR, seed=seed) for seed, name in enumerate(SCENARIOS, 1)]


@pytest.fixture(scope="module")
def search(worn: list[Run]) -> ch.Discrepancy:
    return ch.find_discrepancy(worn, rig="power_shift.b")


@pytest.fixture(scope="module")
def model_file(search: ch.Discrepancy, tmp_path_factory: pytest.TempPathFactory) -> Path:
    search.write(folder := tmp_path_factory.mktemp("found"))
    return folder / "model.toml"


def test_an_effect_is_named_in_the_clutch_that_has_it(search: ch.Discrepancy) -> None:
    assert search.result.effects == ["clearance_change"], str(search)
    (estimate,) = search.result.parameters
    assert estimate.ci95[0] < 0.3 < estimate.ci95[1]
    assert search.result.notes[0] == (
        "power_shift.b is a part of the rig power_shift; columns and parameters have the names of a rig with one clutch."
        " model.toml has the rig's names, such as b.valve.gain for valve.gain"
    )


def test_nothing_is_missing_in_the_other_clutch(worn: list[Run]) -> None:
    assert str(ch.find_discrepancy(worn, rig="power_shift.a")).startswith("nothing missing")


def test_the_model_file_changes_that_clutch_of_the_rig(model_file: Path, worn: list[Run]) -> None:
    changed, shipped = power_shift.load_nominal(model_file), power_shift.load_nominal()
    assert changed["b.clearance_change.change"].value == pytest.approx(0.3, abs=0.05)
    assert all(changed[name] == shipped[name] for name in shipped if not name.startswith("b."))
    closed, open_ = (ch.simulate("shift", plant_parameters=file) for file in (model_file, None))
    column = "cylinder_pressure_b_bar"
    after, before = (np.std(run[column] - worn[0][column]) for run in (closed, open_))
    assert after < 0.1 * before  # all have the same noise; 0.4 mbar were left of 25


def test_a_search_begins_from_the_model_file(model_file: Path, worn: list[Run]) -> None:
    again = ch.find_discrepancy(worn, rig="power_shift.b", model=model_file)
    assert str(again).startswith("nothing missing")


def test_it_ends_in_one_sentence_for_a_run_of_another_rig() -> None:
    wet = ch.simulate("engagement", seconds=0.5)
    with pytest.raises(InputError) as refusal:
        ch.find_discrepancy([wet], rig="power_shift.a")
    assert str(refusal.value) == (
        "run number 1 lacks the column valve_voltage_a_v, which the model power_shift.a needs"
    )


def test_the_motors_torque_is_not_taken_for_that_of_a_clutch(worn: list[Run]) -> None:
    lacking = {name: values for name, values in worn[0].columns.items() if name != "clutch_torque_a_nm"}
    with pytest.raises(InputError, match="lacks the column clutch_torque_a_nm"):
        ch.find_discrepancy([replace(worn[0], columns=lacking)], rig="power_shift.a")


def test_the_whole_rig_names_the_models_of_its_clutches() -> None:
    with pytest.raises(InputError) as refusal:
        find_model("power_shift")
    assert str(refusal.value) == (
        "rig power_shift, whose run is a run of two clutches, has no discrepancy model; one of its clutches is compared by"
        " --rig power_shift.a or --rig power_shift.b"
    )


@pytest.mark.parametrize("model", [ClutchA, ClutchB])
def test_the_cylinders_turn_with_the_input(worn: list[Run], model: type[PowerShiftClutch]) -> None:
    speed = model().take_run(worn[0])[CYLINDER_SPEED]
    # 0.10 measured: three and two times the rounding of an encoder, 0.008 rad/s at 500 Hz, and half a sample of 34 rad/s^2
    np.testing.assert_allclose(speed, worn[0]["truth_input_speed_rad_s"], atol=0.15)


def test_two_equal_gears_are_refused(tmp_path: Path) -> None:
    (changed := tmp_path / "rig.toml").write_text("[driveline]\nratio_b = 3.0\n")
    with pytest.raises(InputError, match=r"ratio_a and driveline\.ratio_b are both 3; two gears must differ"):
        find_model("power_shift.a", changed)


def test_what_an_import_map_computes_has_the_names_of_the_model() -> None:
    columns = {f"{name}_a_{unit}": np.zeros(3) for name, unit in (
        ("valve_voltage", "v"), ("cylinder_pressure", "bar"), ("slip_speed", "rad_s"), ("clutch_torque", "nm"),
        ("oil_temperature", "degc"),
    )}  # fmt: skip
    given = {
        "clutch_torque_a_nm": "0.5 * cylinder_pressure_a_bar",
        "oil_temperature_a_degc": 60.0,
        "valve_voltage_b_v": 0.0,
    }
    taken = ClutchA().take_run(Run(columns, {"import": {"not_measured": given}}))
    assert read_not_measured(taken) == {"oil_temperature_degc": 60.0, "clutch_torque_nm": "0.5 * cylinder_pressure_bar"}
    assert "slip_speed_rad_s" in taken
    assert CYLINDER_SPEED not in taken  # the other slip is not known


def test_a_fault_of_a_controller_ends_the_part_that_is_used(worn: list[Run]) -> None:
    fault = np.where(np.arange(len(worn[0]["time_s"])) < 3000, 0.0, 8.0)
    broken = replace(worn[0], columns={**worn[0].columns, "controller_b_fault": fault})
    outcome = ch.find_discrepancy([broken], rig="power_shift.b", effects=["drag_torque"])
    assert len(outcome.result.traces[0].columns["time_s"]) == 3000
    assert any("only the 3000 rows before it are used" in note for note in outcome.result.notes)


def test_no_experiment_is_proposed_that_no_bench_plays() -> None:
    model = ClutchB()
    options = [c.list_typical_values() for c in model.candidates[:2]]
    proposal = propose(model, {n: p.value for n, p in model.parameters.items()}, options, {})
    assert proposal["profile"] is None
    assert proposal["why"] == "the rig power_shift.b has no bench that can play an experiment"


def test_rows_that_the_model_does_not_predict_stay_out_of_every_fit(worn: list[Run]) -> None:
    model = ClutchA()
    run = select_evidence(Path("a"), model.take_run(worn[0]), model)
    unseen = model.find_unseen(run)["clutch_torque_nm"]
    assert 0.0 < unseen.mean() < 0.5  # the plates are nearly at rest for a part of the run
    evidence = Evidence(model, [run], estimate_floors([run], model.outputs))
    assert evidence.size - evidence.count == pytest.approx(
        unseen.sum() / evidence.blocks[0], abs=20
    )  # a mean that has one such row is left out, at both ends of some ten stretches
    base = linearise(evidence, ({n: p.value for n, p in model.parameters.items()}, {}), [])
    assert abs(evidence.compute_excess(base.residual)) < 0.01  # a tenth of a disagreement
    weakened = JointFits(evidence, base, base).weaken_outliers()
    assert np.isfinite(weakened.weights).all()
