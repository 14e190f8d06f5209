"""Rigs that lack a sensor: the discrepancy workflow compares what is left, and says what it does not compare."""

from typing import Any

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.discrepancy.atlas import find_claims
from clutch_hil.discrepancy.experiment_design import propose
from clutch_hil.discrepancy.held_out import measure_gaps
from clutch_hil.discrepancy.models.missing_sensors import choose_model, find_missing
from clutch_hil.discrepancy.models.named import find_models
from clutch_hil.discrepancy.models.shaft_clutch import ShaftClutch
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.result import Trace
from clutch_hil.discrepancy.sources import FRICTION, HYDRAULICS, SENSORS
from clutch_hil.fitting.model import Completing, Model
from clutch_hil.fitting.noise import estimate_floors
from protocols.errors import InputError
from protocols.files.run import Run
from tests.clutch_hil.discrepancy.clutch_runs import list_baseline, record_runs

CLUTCH, MOTOR, DEMAND = "clutch_torque_nm", "motor_torque_nm", "motor_speed_demand_rad_s"
OIL, PRESSURE, SLIP = "oil_temperature_degc", "cylinder_pressure_bar", "slip_speed_rad_s"
WEAR = {"clearance_change.change": 0.3}  # changes the rig's own parameters


def choose(run: Run) -> tuple[Model, list[str]]:
    return choose_model(find_models("wet_clutch"), {"a.csv": run})


def drop(columns: Any, *names: str, **not_measured: float | str) -> Run:
    return Run({n: v for n, v in columns.items() if n not in names}, {"import": {"not_measured": not_measured}})


@pytest.mark.parametrize(
    ("run", "model", "outputs", "words"),
    [
        (drop(COLUMNS := {n: np.zeros(2) for n in (*WetClutch.run_columns,)}), WetClutch, 5, ""),
        (drop(COLUMNS, CLUTCH), WetClutch, 4, f"{CLUTCH} is missing in run a.csv; nothing is compared with it"),
        (drop(COLUMNS, MOTOR), WetClutch, 4, f"{MOTOR} is missing in run a.csv"),
        (drop(COLUMNS, clutch_torque_nm=f"{MOTOR} - 0.1"), WetClutch, 4, f"{CLUTCH} of run a.csv is computed from {MOTOR}"),
        (drop(COLUMNS, oil_temperature_degc=60.0), WetClutch, 4, f"{OIL} of run a.csv is a constant of its import map"),
        (drop(COLUMNS, CLUTCH, oil_temperature_degc=60), WetClutch, 3, f"{CLUTCH} is missing"),
        (drop(COLUMNS, DEMAND), ShaftClutch, 3, f"{DEMAND} is missing in run a.csv; the rig is simulated from {SLIP}"),
        (drop(COLUMNS, DEMAND, MOTOR), ShaftClutch, 3, f"{DEMAND} is missing"),
        (drop(COLUMNS, motor_speed_demand_rad_s=f"low_pass({SLIP}, 5)"), ShaftClutch, 3, f"is computed from {SLIP}"),
        (drop(COLUMNS, DEMAND, oil_temperature_degc=60.0), ShaftClutch, 2, f"{DEMAND} is missing"),
    ],
)  # fmt: skip
def test_a_run_is_compared_with_the_model_that_has_its_inputs(
    run: Run, model: type[Model], outputs: int, words: str
) -> None:
    chosen, notes = choose(run)
    assert type(chosen) is model
    assert len(chosen.outputs) == outputs
    assert words in " ".join(notes)
    assert bool(notes) == bool(words)


def test_one_run_without_a_sensor_is_enough() -> None:
    runs = {"a": drop(COLUMNS), "b": drop(COLUMNS, CLUTCH)}
    assert find_missing(WetClutch(), runs) == {CLUTCH: f"{CLUTCH} is missing in run b"}


def test_the_model_that_was_reduced_is_unchanged() -> None:
    whole = WetClutch()
    assert len(whole.without([CLUTCH]).outputs) == 4
    assert len(whole.outputs) == 5


@pytest.mark.parametrize(
    "lacking", [(CLUTCH, MOTOR), (CLUTCH, DEMAND), (PRESSURE,), ("valve_voltage_v",), (SLIP, "shaft_angle_rad")]
)
def test_what_nothing_replaces_is_refused_by_its_name(lacking: tuple[str, ...]) -> None:
    columns = {name: np.linspace(0.0, 1.0, 2000) for name in WetClutch.run_columns}
    with pytest.raises(InputError, match=f"lacks the column ({'|'.join(lacking)})"):
        ch.find_discrepancy([drop(columns, *lacking)])


@pytest.mark.parametrize(
    ("hidden", "lacking"),
    [
        (WEAR, (CLUTCH,)),
        (WEAR, (DEMAND, MOTOR)),
        ({"position_ripple.amplitude": 0.4, "position_ripple.order": 3.0}, (CLUTCH,)),
        ({"centrifugal_pressure.coefficient": 6e-5}, (DEMAND,)),
        ({}, (DEMAND, MOTOR)),
    ],
)
def test_a_hidden_effect_is_named(hidden: dict[str, float], lacking: tuple[str, ...]) -> None:
    runs = [drop(run, *lacking) for run in record_runs(hidden, seed=3)]
    outcome = ch.find_discrepancy(runs)
    assert outcome.result.notes[0].startswith(f"{lacking[0]} is missing in run number 1; ")
    assert outcome.result.effects == [*dict.fromkeys(name.partition(".")[0] for name in hidden)], str(outcome)
    assert set(outcome.result.units).isdisjoint(lacking)


def test_no_effect_of_the_drive_is_a_candidate_behind_the_slip() -> None:
    drive = {c.name for c in WetClutch().candidates} - {c.name for c in ShaftClutch().candidates}
    assert drive == {"backlash", "motor_torque_ripple", "shaft_compliance"}
    with pytest.raises(InputError, match="effect 'backlash' is not a candidate"):
        ch.find_discrepancy([drop(run, DEMAND) for run in record_runs({})], effects=["backlash"])


@pytest.mark.parametrize("name", [c.name for c in ShaftClutch().candidates])
def test_an_effect_acts_behind_the_slip_as_it_does_in_the_rig(name: str) -> None:
    """Plates that slide all the time, whose slip the whole rig gives: both models show the same outputs, with each effect."""
    rig, clutch = WetClutch(), ShaftClutch()
    candidate = next(c for c in rig.candidates if c.name == name)
    values, run = candidate.list_typical_values(), record_runs({})[1]
    baseline = list_baseline()

    def compare(effects: dict[str, float]) -> tuple[dict[str, np.ndarray], dict[str, float]]:
        """Return the outputs of the whole rig, and the standard deviation of the difference to the clutch alone."""
        whole = rig.simulate(run, baseline, effects)
        driven = clutch.complete_run({**run, **whole, "shaft_angle_rad": 1e-3 * np.cumsum(whole[SLIP])})
        alone = clutch.simulate(driven, baseline, effects)
        return whole, {o.column: float(np.std(alone[o.column] - whole[o.column])) for o in clutch.outputs}

    (without, usual), (changed, differ) = compare({}), compare(values)
    for column, difference in differ.items():
        change = float(np.std(changed[column] - without[column]))
        assert difference <= 0.1 * change + 2.0 * usual[column], (column, difference, change, usual[column])


@pytest.mark.parametrize("lacking", [(CLUTCH,), (DEMAND, MOTOR)])
@pytest.mark.parametrize(
    ("hidden", "block", "place"),
    [
        ({"position_ripple.amplitude": 0.4, "position_ripple.order": 3.0}, FRICTION, (CLUTCH, MOTOR)),
        ({"valve_gain.ratio": 1.06}, HYDRAULICS, (CLUTCH, MOTOR, PRESSURE)),
        ({"pressure_sensor_gain.gain": 1.06}, SENSORS, (PRESSURE,)),
    ],
)
def test_the_block_is_found_with_one_torque_sensor(
    lacking: tuple[str, ...], hidden: dict[str, float], block: str, place: tuple[str, ...]
) -> None:
    runs = record_runs(hidden, seed=5)
    model, _ = choose(drop(runs[0], *lacking))
    assert isinstance(model, Completing)
    runs = [dict(model.complete_run(drop(run, *lacking).columns)) for run in runs]
    claims = find_claims(model, runs, estimate_floors(runs, model.outputs), list_baseline(), {})
    assert claims[0].block == block, claims
    assert claims[0].output in place


def test_rows_that_the_model_does_not_predict_are_no_gap() -> None:
    """Plates that stick: behind the slip, the model does not predict their torque."""
    run = dict(record_runs({})[1])
    run[SLIP] = np.where(run["time_s"] < 4.0, run[SLIP], 0.0)
    shown = {output.column: run[output.column].copy() for output in ShaftClutch().outputs}
    shown[CLUTCH] = shown[CLUTCH] + np.where(run["time_s"] < 3.995, 0.5, 9.0)
    trace = Trace("a", False, run, run, shown, shown)
    gap, _ = measure_gaps(ShaftClutch(), [trace], dict.fromkeys(shown, 0.1))
    assert gap[CLUTCH].before == pytest.approx(0.5, rel=1e-6)


def test_an_experiment_is_proposed_for_a_rig_behind_its_slip() -> None:
    model = ShaftClutch()
    floors = {output.column: 3.0 * output.resolution + 0.01 for output in model.outputs}
    options = [{"friction_level.level": 0.85, "friction_level.drift": 0.0}, {"pressure_sensor_gain.gain": 1.1}]
    proposal = propose(model, list_baseline(), options, floors)
    assert proposal["profile"]
    assert set(proposal["predicted_difference"]) == set(floors)
