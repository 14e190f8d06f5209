"""Offsets, drag and delay of a clutch's runs: first estimates, what is absent, what is not excited, and the whole fit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.identification import (
    Hidden,
    compute_maps_error,
    draw,
    list_true_values,
    list_values,
    play,
    split_effects,
)
from clutch_hil.bench.in_memory import simulate
from clutch_hil.fitting.model import Columns
from clutch_hil.identify.clutch_effects import (
    DELAY,
    DRAG,
    DRIVE,
    EFFECTS,
    MOTOR,
    PRESSURE,
    SPEED,
    TORQUE,
    choose_absent,
    correct_offsets,
    estimate_effects,
    find_vented,
)
from clutch_hil.identify.controller_values import derive_controller_values
from clutch_hil.identify.identification import Identification, identify_clutch
from clutch_hil.identify.thesis_quantities import compute_torque
from plant_sim.rigs import wet_clutch
from protocols.files.run import Run
from rt_controller.loop.parameter_sets import load_controller_parameters

SEED = 3
HIDDEN = Hidden.draw(SEED)
DECLARED = {name: p.value for name, p in wet_clutch.load_nominal().items()}
FIRST = {PRESSURE: 2e-3, TORQUE: 0.02, MOTOR: 0.03, DRAG: 2e-3}  # what a first estimate may be off by
MAPS, SHAPES, CONTACT, INERTIA = 0.02, 0.10, 0.010, 0.02  # of the issue: relative, relative, bar, relative
LEAST_EFFECTS, LEAST_INSIDE = 5, 0.75  # of 7 and of 33 intervals of 95 %: fewer are less probable than 1e-3


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    return play(draw(SEED), SEED, HIDDEN)


@pytest.fixture(scope="module")
def columns(runs: list[Run]) -> list[Columns]:
    return [run.columns for run in runs]


def test_first_estimates_come_from_the_vented_rows(columns: list[Columns]) -> None:
    values, unmet = estimate_effects(columns)
    assert unmet == {}
    for name, within in FIRST.items():
        assert values[name] == pytest.approx(HIDDEN.list_strengths()[name], abs=within), name
    assert values[DRIVE] - values[SPEED] == pytest.approx(HIDDEN.drive - HIDDEN.speed, abs=0.02)


def test_corrected_runs_have_no_offset(columns: list[Columns]) -> None:
    values, _ = estimate_effects(columns)
    for run in correct_offsets(columns, values):
        vented = find_vented(run)
        assert abs(np.mean(run["cylinder_pressure_bar"][vented])) < 1e-3


def test_a_cylinder_counts_as_vented_once_its_oil_is_out() -> None:
    voltage = np.zeros(3000)
    voltage[1000:1500] = 1.0
    run = {"time_s": 1e-3 * np.arange(3000), "valve_voltage_v": voltage, "cylinder_pressure_bar": 2.4 * voltage}
    vented = find_vented(run)
    assert vented[:1000].all()
    assert not vented[1000:1890].any()
    assert vented[1905:].all()


def test_a_run_that_is_cut_out_under_pressure_begins_with_a_cylinder_full_of_oil() -> None:
    """Its valve was open before the first row, so the pressure there is no zero of the sensor."""
    zero = 0.05  # bar
    whole = simulate(
        profile="pressure_steps", seconds=8.0, effects={"pressure_sensor_offset": {"offset": zero}}
    ).columns
    closes = np.flatnonzero((whole["valve_voltage_v"] <= 0.01) & (whole["cylinder_pressure_bar"] > 1.0))[0]
    run = cut(whole, np.arange(len(whole["time_s"])) >= closes)
    assert not find_vented(run)[:390].any()
    assert estimate_effects([run])[0][PRESSURE] == pytest.approx(zero, abs=FIRST[PRESSURE])


def cut(run: Columns, rows: np.ndarray) -> Columns:
    at = np.flatnonzero(rows)
    part = {name: values[at[0] : at[-1] + 1] for name, values in run.items()}
    return {**part, "time_s": part["time_s"] - part["time_s"][0]}


def test_what_the_runs_do_not_excite_is_told(columns: list[Columns]) -> None:
    staircase = columns[1]
    pressed = cut(staircase, staircase["cylinder_pressure_bar"] > 2.0)
    values, unmet = estimate_effects([{**pressed, "valve_voltage_v": np.maximum(pressed["valve_voltage_v"], 0.2)}])
    assert set(unmet) == {PRESSURE, TORQUE, MOTOR, DRAG, SPEED}
    assert "needs rows without valve voltage; these runs have 0 s" in unmet[TORQUE]
    assert all(values[name] == 0.0 for name in unmet)
    _, unmet = estimate_effects([{**staircase, "slip_speed_rad_s": np.full(len(staircase["time_s"]), 20.0)}])
    assert "needs slips that differ" in unmet[DRAG]


def test_effects_that_hide_each_other_are_kept_where_one_of_them_is_there() -> None:
    """Two offsets whose difference is known well, and neither of them by itself."""
    names = ["valve.gain", SPEED, DRIVE]
    spread = np.array([1.0, 0.05, 0.05])
    correlation = np.eye(3)
    correlation[1, 2] = correlation[2, 1] = 0.9999
    assert choose_absent(names, np.array([1.0, 0.04, -0.04]), spread, correlation) in ([SPEED], [DRIVE])
    assert set(choose_absent(names, np.array([1.0, 0.025, 0.025]), spread, correlation)) == {SPEED, DRIVE}
    assert choose_absent(names, np.array([1.0, 0.225, -0.225]), spread, correlation) == []


def test_an_interval_that_is_too_wide_does_not_tell_that_an_effect_is_absent() -> None:
    for half, absent in ((0.06, [SPEED]), (0.061, [])):
        assert choose_absent([SPEED], np.array([0.01]), np.array([half]), np.eye(1)) == absent


def test_a_controller_gets_pressures_as_their_sensor_shows_them() -> None:
    shipped = load_controller_parameters()
    plain = derive_controller_values(DECLARED, DECLARED, shipped)
    moved = derive_controller_values({**DECLARED, PRESSURE: 0.04}, DECLARED, shipped)
    assert moved["model.contact_pressure"][0] == pytest.approx(plain["model.contact_pressure"][0] + 0.04)
    shown = {3.4: plain, 3.44: moved}  # bar, 3.4 bar in truth
    one, two = (
        result["model.coulomb_slope"][0] * p + result["model.coulomb_intercept"][0] for p, result in shown.items()
    )
    assert two == pytest.approx(one)


def test_a_controller_gets_the_zero_of_the_motor_s_torque() -> None:
    values = derive_controller_values({**DECLARED, MOTOR: 0.4}, DECLARED, load_controller_parameters())
    assert values["model.motor_torque_zero"] == (0.4, "as the plant: motor_torque_sensor_offset.offset")


@pytest.mark.parametrize("size", [0.2, 0.7, 1.4, 6.0])
def test_thresholds_and_gains_of_a_clutch_of_another_size_are_as_nominally_to_its_slope(size: float) -> None:
    shipped = load_controller_parameters()
    lines = {
        n: size * DECLARED[n]
        for n in DECLARED
        if n.startswith(("clutch.coulomb_", "clutch.viscous_s", "clutch.viscous_i"))
    }
    values = derive_controller_values({**DECLARED, **lines}, DECLARED, shipped)
    if 0.5 < size < 2.0:
        assert "phases.torque_mismatch" not in values
        return
    own = values["model.coulomb_slope"][0] / DECLARED["clutch.coulomb_slope"]
    for name, factor in (("phases.torque_mismatch", own), ("lock.rate", own), ("torque.proportional_gain", 1.0 / own)):
        assert values[name][0] == pytest.approx(factor * shipped[name].value), name
        assert "scaled with the slope of the torque" in values[name][1]


def test_a_controller_gets_maps_over_the_pressure_in_the_cylinder() -> None:
    """Of which the springs take a share: docs/rig.md, 3."""
    plant = {**DECLARED, "piston.stack_stiffness": 0.2 * DECLARED["piston.stack_stiffness"]}
    model = {
        n.partition(".")[2]: v
        for n, (v, _) in derive_controller_values(plant, DECLARED, load_controller_parameters()).items()
    }
    pressures, slip, celsius = np.linspace(2.7, 4.2, 4), 10.0, 70.0
    depth = np.exp(-(pressures - model["beta_onset"]) / model["beta_scale"])
    beta = np.minimum(1.0, model["beta_inf"] + (1.0 - model["beta_inf"]) * depth)
    coulomb, viscous = (model[f"{n}_slope"] * pressures + model[f"{n}_intercept"] for n in ("coulomb", "viscous"))
    torque = (
        coulomb * (1.0 + (beta - 1.0) * np.exp(-model["stribeck_speed"] / slip))
        + viscous * slip ** model["viscous_exponent"]
    )
    assert torque == pytest.approx(compute_torque(plant, pressures, slip, celsius))


@pytest.fixture(scope="module")
def result(runs: list[Run]) -> Identification:
    return identify_clutch(runs)


def test_hidden_offsets_drag_and_delay_are_within_their_intervals(result: Identification) -> None:
    _, effects = split_effects(result)
    true = HIDDEN.list_strengths()
    assert {p.name for p in effects} == set(EFFECTS)
    inside = [p.interval[0] <= true[p.name] <= p.interval[1] for p in effects]
    assert sum(inside) >= LEAST_EFFECTS
    assert result.calibration[DELAY].value == pytest.approx(HIDDEN.delay, abs=0.2)  # a fifth of a sample
    assert result.calibration[SPEED].value == pytest.approx(HIDDEN.speed, abs=0.05)


def test_the_other_parameters_keep_their_limits(result: Identification) -> None:
    true, values = list_true_values(draw(SEED)), list_values(result, DECLARED)
    assert max(compute_maps_error(values, true).values()) < MAPS
    for name in ("clutch.stribeck_speed", "clutch.viscous_exponent", "clutch.attraction"):
        assert values[name] == pytest.approx(true[name], rel=SHAPES)
    assert values["piston.contact_pressure"] == pytest.approx(true["piston.contact_pressure"], abs=CONTACT)
    assert values["motor.inertia"] == pytest.approx(true["motor.inertia"], rel=INERTIA)
    own, _ = split_effects(result)
    assert np.mean([p.interval[0] <= true[p.name] <= p.interval[1] for p in own]) >= LEAST_INSIDE


def test_the_residual_is_noise(result: Identification) -> None:
    assert max(result.misfit.values()) < 1.1
    assert not any("lacks something" in text for text in result.calibration.warnings)


def test_a_zero_that_the_runs_do_not_show_moves_no_other_interval(runs: list[Run]) -> None:
    """One run without low slips: held at 0 the zero of the speed sensor moved that of the drive by 99 half widths."""
    one = identify_clutch([runs[3]])
    assert one.calibration.held[SPEED] == "the runs do not excite it"
    true = {**list_true_values(draw(SEED)), **HIDDEN.list_strengths()}
    inside = [p.interval[0] <= true[p.name] <= p.interval[1] for p in one.calibration.parameters]
    assert np.mean(inside) >= LEAST_INSIDE
    drive = one.calibration[DRIVE]
    assert drive.interval[0] <= HIDDEN.drive <= drive.interval[1]


def test_the_plant_simulates_them_with_the_calibration(result: Identification, tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    result.calibration.write(path)
    plant = wet_clutch.load_nominal(path)
    assert plant[TORQUE].value == result.calibration[TORQUE].value
    assert plant[DELAY].value == result.calibration[DELAY].value
    rig = wet_clutch.Rig(plant)
    assert {"torque_sensor_offset", "valve_delay"} <= set(rig.table.names)
    state = rig.make_rest_state(0.0, 343.15)
    assert state.y["sensed_clutch_torque"][0] == pytest.approx(HIDDEN.torque, abs=0.05)


def test_held_offsets_are_not_fitted_and_stand_in_the_file(runs: list[Run], tmp_path: Path) -> None:
    held = {name: HIDDEN.list_strengths()[name] for name in EFFECTS}
    short = replace(runs[3], columns={name: values[:8000] for name, values in runs[3].columns.items()})
    one = identify_clutch([short], hold=held)
    assert split_effects(one) == ([p for p in one.calibration.parameters if p.name not in EFFECTS], [])
    # Also of those that the run does not excite
    assert {one.calibration.held[name] for name in held} == {"held by the user"}
    # Limits of the rig are never fitted
    for limit, declared in (("motor.torque_limit", "40 Nm"), ("valve.supply_pressure", "25 bar")):
        assert f"kept at {declared}, as declared" in one.calibration.held[limit]
    path = tmp_path / "calibration.toml"
    one.calibration.write(path)
    assert wet_clutch.load_nominal(path)[DELAY].value == held[DELAY]
