"""Rigs whose motor, speed demand or oil temperature was not recorded: what is identified of them all the same."""

from dataclasses import replace

import numpy as np
import pytest

from clutch_hil.bench.in_memory import simulate
from clutch_hil.discrepancy.models.shaft_clutch import ShaftClutch
from clutch_hil.fitting.model import Columns
from clutch_hil.identify.behind_slip import balance_motor, describe_missing_motor, drive_by_slip
from clutch_hil.identify.clutch_effects import SPEED
from clutch_hil.identify.identification import Identification, identify_clutch
from clutch_hil.identify.recorded_runs.run_evidence import Evidenced
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.run import Run

NOMINAL = wet_clutch.load_nominal()
DEMAND, OIL, SLIP = "motor_speed_demand_rad_s", "oil_temperature_degc", "slip_speed_rad_s"
FORMULA = f"low_pass({SLIP}, 50)"
CELSIUS = 72.0
TIME = np.arange(5000) / 1000.0


def make_balanced(inertia: float, zero: float, noise: float = 0.05, slip: np.ndarray | None = None) -> Columns:
    """5 s of a motor that turns `inertia` [kg m^2] against a clutch, whose sensors' zeros differ by `zero` [Nm]."""
    random = np.random.default_rng(1)
    slip = 12.0 + 4.0 * np.sin(8.0 * TIME) if slip is None else slip
    clutch = 10.0 + 0.3 * slip
    motor = clutch + inertia * np.gradient(slip, TIME) + zero
    return {
        "time_s": TIME, SLIP: slip + 1e-3 * random.standard_normal(len(TIME)),
        "clutch_torque_nm": clutch + noise * random.standard_normal(len(TIME)),
        "motor_torque_nm": motor + noise * random.standard_normal(len(TIME)),
    }  # fmt: skip


@pytest.mark.parametrize(("inertia", "zero"), [(0.05, 0.0), (0.05, 0.4), (2.0, -1.0)])
def test_motor_and_clutch_torque_tell_the_inertia_and_their_zeros(inertia: float, zero: float) -> None:
    result = balance_motor([make_balanced(inertia, zero), make_balanced(inertia, zero)])
    assert result is not None
    assert result.inertia == pytest.approx(inertia, rel=5e-3)
    assert abs(result.inertia - inertia) < 2.0 * result.inertia_half
    assert abs(result.zero - zero) < 2.0 * result.zero_half < 0.02


@pytest.mark.parametrize(
    "run",
    [
        make_balanced(0.05, 0.0, slip=np.full(len(TIME), 12.0)), make_balanced(0.0, 0.0), make_balanced(-0.05, 0.0),
        {name: values[:100] for name, values in make_balanced(0.05, 0.0).items()},
        {name: values[:3] for name, values in make_balanced(0.05, 0.0).items()},
        {**make_balanced(0.05, 0.0), SLIP: np.zeros(len(TIME))},
    ],
    ids=["steady", "no inertia", "turned sign", "short", "three rows", "locked"],
)  # fmt: skip
def test_runs_that_do_not_tell_the_inertia_give_none(run: Columns) -> None:
    assert balance_motor([run]) is None


def make_evidence(**given: dict[str, float | str]) -> Evidenced:
    """Runs with all columns of a motor, of which an import map gave these."""
    run = {name: np.zeros(3) for name in (DEMAND, "motor_torque_nm", OIL)}
    return Evidenced(dict.fromkeys(given, run), {}, (), given)


def test_a_motor_that_was_recorded_is_none_that_is_missing() -> None:
    assert describe_missing_motor(make_evidence(a={}, b={DEMAND: "2 * lever_1", OIL: 60.0})) == ""


def test_what_is_missing_of_a_motor_is_told() -> None:
    sentence = describe_missing_motor(make_evidence(a={}, b={DEMAND: FORMULA}))
    assert sentence.startswith(
        f"{DEMAND} of run b is computed from the slip: the clutch is identified from its measured slip"
    )
    evidence = make_evidence(a={}, b={})
    lacking = replace(evidence, measured={**evidence.measured, "b": {DEMAND: np.zeros(3)}})
    assert describe_missing_motor(lacking).startswith("run b lacks motor_torque_nm: the clutch")


@pytest.mark.parametrize(
    ("given", "constant"),
    [
        ({"a": {OIL: 60.0}, "b": {}}, None), ({"a": {OIL: "x_1 + 2"}}, None), ({"a": {}}, None),
        ({"a": {OIL: 60.0}, "b": {OIL: 70}}, 65.0),
    ],
)  # fmt: skip
def test_a_temperature_is_constant_where_it_is_so_in_each_run(
    given: dict[str, dict[str, float | str]], constant: float | None
) -> None:
    assert make_evidence(**given).find_constant(OIL) == constant


def test_the_zero_of_a_tachometer_is_no_slip_of_the_plates() -> None:
    run = drive_by_slip(simulate(profile="slip_sine", seconds=4.0, seed=2).columns)
    shifted = {**run, SLIP: run[SLIP] + 0.3, DEMAND: run[DEMAND] + 0.3}
    model, values = ShaftClutch(NOMINAL), {name: p.value for name, p in NOMINAL.items()}
    torque = model.simulate(run, values, {})["clutch_torque_nm"]
    for parameters, effects in ((values, {SPEED: 0.3}), ({**values, SPEED: 0.3}, {})):
        shown = model.simulate(shifted, parameters, effects)["clutch_torque_nm"]
        np.testing.assert_allclose(shown, torque, rtol=0, atol=1e-9)
    assert np.max(np.abs(model.simulate(shifted, values, {})["clutch_torque_nm"] - torque)) > 0.01


def test_a_motor_torque_in_another_unit_is_refused() -> None:
    """Pound-feet beside Nm would be taken for an inertia."""
    run = simulate(profile="stribeck_staircase", seed=5).columns
    foreign = {name: values for name, values in run.items() if name != DEMAND}
    foreign["motor_torque_nm"] = 8.85 * run["motor_torque_nm"]
    with pytest.raises(
        InputError, match=r"clutch_torque_nm, .* both are the same torque: one of them is another channel"
    ):
        identify_clutch([Run(foreign, {})])


@pytest.fixture(scope="module")
def result() -> Identification:
    """The bench's own clutch by recordings without a speed demand and without a temperature, from an import map."""
    oil = {"oil.heat_capacity": 1e5, "oil.sump_temperature": CELSIUS}
    runs = [
        simulate(profile=profile, seed=seed, temperature=CELSIUS, plant=oil)
        for seed, profile in enumerate(("engagement", "multisine", "stribeck_staircase"), 3)
    ]
    recorded = ("time_s", "valve_voltage_v", "cylinder_pressure_bar", "clutch_torque_nm", SLIP, "motor_torque_nm")
    origin = {"not_measured": {DEMAND: FORMULA, OIL: CELSIUS}}
    return identify_clutch(
        [
            Run(
                {**{n: r[n] for n in recorded}, DEMAND: r[SLIP], OIL: np.full(len(r[SLIP]), CELSIUS)},
                {"import": origin},
            )
            for r in runs
        ]
    )


def test_a_clutch_is_identified_without_speed_demand_and_temperature(result: Identification) -> None:
    names = (
        "valve.gain", "piston.contact_pressure", "piston.preload_pressure", "hydraulics.conductance", "clutch.coulomb_slope",
        "clutch.beta_inf", "clutch.stribeck_speed", "clutch.attraction", "motor.inertia",
    )  # fmt: skip
    for one in (result.calibration[name] for name in names):
        low, high = one.interval
        assert low - 0.25 * (high - low) <= NOMINAL[one.name].value <= high + 0.25 * (high - low), one
        assert high - low < 0.15 * one.value, one
    assert max(result.misfit.values()) < 1.2


def test_what_was_not_recorded_is_told_and_not_identified(result: Identification) -> None:
    calibration = result.calibration
    names = {one.name for one in calibration.parameters}
    assert not names & {"motor.proportional_gain", "motor.integral_gain"}
    assert calibration.warnings[1].startswith(f"{OIL} is a constant of the import map")
    assert calibration.warnings[0].startswith(f"{DEMAND} of run 1 is computed from the slip")
    gain, why = calibration.fixed["motor.proportional_gain"]
    inertia = calibration["motor.inertia"].value
    assert gain / inertia == pytest.approx(NOMINAL["motor.proportional_gain"].value / NOMINAL["motor.inertia"].value)
    assert "no speed demand was recorded" in why
    assert calibration.controller["model.motor_inertia"][0] == inertia
    assert len(calibration.correlation) == len(calibration.parameters)
