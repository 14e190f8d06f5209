"""Recordings with very little noise: what then remains is the accuracy of the simulation and the rounding of the converters."""

from dataclasses import replace

from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.result import NAMED, NOTHING
from clutch_hil.discrepancy.search import investigate
from clutch_hil.fitting.model import Columns
from tests.clutch_hil.discrepancy.clutch_runs import NOISE, record_runs

STEPS = {  # of the converters (docs/rig.md, 9), in units of the columns
    "cylinder_pressure_bar": 20.0 / 4096, "oil_temperature_degc": 20.0 / 4096 / 0.05, "motor_torque_nm": 20.0 / 4096 / 0.2,
    "clutch_torque_nm": 20.0 / 65536 / 0.2,
}  # fmt: skip
CANDIDATES = ("friction_level", "pressure_sensor_offset", "torque_time_offset", "valve_delay")


def record_quietly(hidden: dict[str, float]) -> dict[str, Columns]:
    """Runs of a rig simulated with steps of 20 us, with a twentieth of the usual noise, rounded by converters."""
    noise = {column: 0.05 * sigma for column, sigma in NOISE.items()} | {"slip_speed_rad_s": 0.016}
    runs = record_runs(hidden, seed=4, noise=noise, model=WetClutch(step=2e-5))
    return {
        str(k): {**run, **{column: step * (run[column] / step).round() for column, step in STEPS.items()}}
        for k, run in enumerate(runs)
    }


def test_a_sound_rig_lacks_nothing() -> None:
    assert investigate(WetClutch(), record_quietly({}), names=CANDIDATES).verdict == NOTHING


def test_without_these_accuracies_it_would() -> None:
    model = WetClutch()
    model.outputs = tuple(replace(output, accuracy=0.0) for output in model.outputs)
    assert investigate(model, record_quietly({}), names=CANDIDATES).verdict != NOTHING


def test_an_effect_is_named() -> None:
    found = investigate(WetClutch(), record_quietly({"valve_delay.delay": 3.0}), names=CANDIDATES)
    assert (found.verdict, found.effects) == (NAMED, ["valve_delay"])
    (delay,) = found.parameters
    assert delay.ci95[0] < 3.0 < delay.ci95[1] < 4.0
