"""A clutch of another size: torques that the declared rig cannot have are no error, up to what a clutch may have."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from clutch_hil.bench.in_memory import simulate
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.fitting.run_checks import check_evidence
from clutch_hil.identify.calibration import Identified
from clutch_hil.identify.identification import Identification, identify_clutch
from clutch_hil.identify.recorded_runs.converters import find_converter_bits
from clutch_hil.identify.recorded_runs.motor_limit import find_motor_limit
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.run import Run

SCALE = 6.0  # of all torques: such a clutch gives 100 Nm where the bench's own gives 17
TORQUES = ("clutch_torque_nm", "motor_torque_nm", "motor_torque_limit_nm")
SCALED = (
    "clutch.coulomb_slope", "clutch.coulomb_intercept", "clutch.viscous_slope", "clutch.viscous_intercept", "motor.inertia",
    "motor.proportional_gain", "motor.integral_gain", "oil.heat_capacity",
)  # fmt: skip
KEPT = ("valve.gain", "piston.contact_pressure", "clutch.beta_inf", "clutch.stribeck_speed")


def play_larger(profile: str, seed: int, scale: float = SCALE) -> Run:
    """A run of a rig whose torques, inertia, gains and heats are `scale` times those of the bench's own, which moves alike."""
    run = simulate(profile=profile, seed=seed)
    measured = {n: v * (scale if n in TORQUES else 1.0) for n, v in run.columns.items() if "_" in n and not is_inner(n)}
    return replace(run, columns=measured, metadata={"rig": "wet_clutch"})


def is_inner(name: str) -> bool:
    return name.startswith(("truth_", "controller_"))


@pytest.fixture(scope="module")
def larger() -> Identification:
    return identify_clutch(
        [play_larger("engagement", 3), play_larger("multisine", 4), play_larger("stribeck_staircase", 5)]
    )


def test_a_larger_clutch_is_identified(larger: Identification) -> None:
    nominal = wet_clutch.load_nominal()
    result: dict[str, Identified] = {one.name: one for one in larger.calibration.parameters}
    for name in (*SCALED, *KEPT):
        one, true = result[name], nominal[name].value * (SCALE if name in SCALED else 1.0)
        low, high = one.interval
        assert low - 0.25 * (high - low) <= true <= high + 0.25 * (high - low), (name, one, true)
        assert high - low < 0.1 * abs(true), (name, one, true)
    assert max(larger.misfit.values()) < 1.2


def test_its_motor_is_as_large_as_the_runs_show_and_that_is_told(larger: Identification) -> None:
    limit, why = larger.calibration.fixed["motor.torque_limit"]
    shown = max(float(np.abs(run["motor_torque_nm"]).max()) for run in larger.measured.values())
    assert shown < limit <= 1.25 * shown
    assert "largest torque of the runs" in why
    (sentence,) = [str(finding) for finding in larger.findings if finding.check == "larger"]
    assert "but the declared motor gives 40 Nm: the rig is taken as a larger one" in sentence
    assert sentence.count(" row ") == 1
    assert "Check the unit; --hold motor.torque_limit=" in sentence


def test_its_converters_are_no_effect(larger: Identification) -> None:
    assert (
        larger.calibration.fixed["sensors.clutch_torque_bits"][0] == 13.0
    )  # 16 over 600 Nm, of which 100 are declared
    given = {name: value for name, (value, _) in larger.calibration.fixed.items()}
    model = WetClutch(wet_clutch.load_nominal().with_values(given))
    assert not model.find_evident_effects([dict(run) for run in larger.measured.values()])


def test_a_motor_that_no_clutch_has_is_refused() -> None:
    sentence = "motor_torque_nm is up to .* Nm; allowed are motors of 3500 Nm: check the unit"
    with pytest.raises(InputError, match=sentence):
        identify_clutch([play_larger("stribeck_staircase", 5, 1e3)])


def test_a_torque_that_no_clutch_has_is_refused() -> None:
    """Such as N cm."""
    sentence = r"the torque at sliding plates rises by .* allowed is 0\.1 to 1000: check the units"
    with pytest.raises(InputError, match=sentence):
        identify_clutch([play_larger("stribeck_staircase", 5, 100.0)])


def test_without_its_calibration_a_larger_clutch_is_to_be_identified() -> None:
    run = play_larger("pressure_steps", 5)
    sentence = [str(one) for one in check_evidence(WetClutch(), {"run": run.columns}) if one.check == "range"]
    assert len(sentence) == 2
    assert all("of a rig that nobody has calibrated: clutch-hil identify RUN..." in one for one in sentence)


def make_motor_run(torques: Sequence[float]) -> dict[str, np.ndarray]:
    return {"motor_torque_nm": np.array(torques)}


def test_a_motor_within_its_declared_limit_is_the_declared_one() -> None:
    assert find_motor_limit({"run": make_motor_run([0.0, -49.9, 30.0])}, 40.0, 2000.0) == (40.0, [])


def test_a_motor_that_rests_at_its_largest_torque_gives_no_more() -> None:
    ramp = np.concatenate([np.zeros(100), np.linspace(0.0, 200.0, 100)])
    assert find_motor_limit({"run": make_motor_run(ramp)}, 40.0, 2000.0)[0] == 250.0
    at_limit = np.concatenate([ramp, np.full(9, 200.0)])
    limit, (finding,) = find_motor_limit(
        {"small": make_motor_run([1.0]), "run": make_motor_run(-at_limit)}, 40.0, 2000.0
    )
    assert limit == 200.0
    assert find_motor_limit({"run": make_motor_run(ramp)}, 40.0, 210.0)[0] == 210.0
    assert (finding.run, finding.hard) == ("run", False)


def test_runs_that_contradict_each_other_tell_no_converter() -> None:
    time = np.arange(2000) * 1e-3
    wave = 5.0 * np.sin(7.0 * time)
    model, nominal = WetClutch(), wet_clutch.load_nominal()

    def record(step: float) -> dict[str, np.ndarray]:
        quiet = np.zeros(len(time))
        return {"cylinder_pressure_bar": quiet, "clutch_torque_nm": step * np.round(wave / step)}

    assert find_converter_bits(model, [record(0.1), record(0.1)], nominal)["sensors.clutch_torque_bits"][0] == 10.0
    assert find_converter_bits(model, [record(0.1), record(0.03)], nominal) == {}
