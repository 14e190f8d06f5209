"""Two clutches on one motor: torque balance of both, and torque of a locked clutch while the other is open."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from clutch_hil.bench.scenario import load_scenario
from clutch_hil.bench.simulate import Simulation
from plant_sim.node.injection import Injection
from plant_sim.node.power_shift_node import COLUMNS as PLANT
from protocols.can.frames import load_frames
from protocols.can.words import make_frame_definition
from protocols.errors import InputError
from rt_controller.law.other_clutch import (
    PAIR_SETTINGS,
    find_applied_torque,
    make_other,
    pair_mismatch,
    take_other_encoder,
    take_other_status,
    use_newest_status,
)
from rt_controller.law.phases import Fault
from rt_controller.law.record import make_record
from rt_controller.law.sample import SAMPLE
from rt_controller.loop.node import COLUMNS, ControllerNode

STEP, PERIOD = 2.0**-14, 2.0**-9  # rad, s: exact
ENCODER = load_frames()["ENCODER"]
DEFINITION = make_frame_definition(ENCODER)
DEFINITION["shaft_angle"]["scale"] = STEP
WEIGHT = 0.05  # kg m^2
PAIR = make_record(PAIR_SETTINGS, ratio=3.0, other_ratio=2.0, patience=0.25)
IN_TIME = 0.12  # s: the dwell of 0.1 s and ten cycles of 500 Hz


def make_encoder_payload(counts: int, tick: int) -> int:
    """Return the payload of ENCODER for a count and a tick, which wrap."""
    data = ENCODER.pack_raw(0, shaft_angle=(counts + 2**17) % 2**18 - 2**17, sample_tick=tick % 2**10)
    return int.from_bytes(data, "little", signed=True)


@cache
def make_settings() -> Any:
    """Return TORQUE_SETTINGS of the controller of clutch a."""
    return ControllerNode(500, clutch="a").settings.view(np.recarray)[0].law.torque


def make_other_clutch(estimate: float = 0.0, sticks: bool = False, acceleration: float = 0.0) -> Any:
    """Return OTHER with a status that has just arrived."""
    state = make_other()
    take_other_encoder(state, make_encoder_payload(0, 0), DEFINITION, PERIOD, 100.0)
    take_other_status(state, estimate, sticks)
    use_newest_status(state)
    state.acceleration = acceleration
    return state


def compute_mismatch(
    motor: float, own: float, its: Any, own_sticks: bool = False, capacity: float = 0.0, slip_rate: float = 0.0
) -> float:
    """Return the mismatch [Nm] for motor torque, own estimate [Nm] and the other clutch."""
    sample = make_record(SAMPLE, motor_torque=motor, acceleration=slip_rate)
    return float(pair_mismatch(its, PAIR, make_settings(), own, capacity, own_sticks, sample))


def test_both_torques_are_the_motors() -> None:
    assert compute_mismatch(15.0, 10.0, make_other_clutch(5.0)) == 0.0
    assert compute_mismatch(40.0, 10.0, make_other_clutch(5.0)) == pytest.approx(25.0)
    assert compute_mismatch(-40.0, -10.0, make_other_clutch(-5.0)) == pytest.approx(-25.0)


def test_friction_levels_within_the_bounds_of_the_adaptation_explain_a_torque() -> None:
    """0.6 to 1.5, and 0.3 Nm that the motor feels."""
    for motor, explained in ((22.79, True), (22.81, False), (8.71, True), (8.69, False)):
        assert (compute_mismatch(motor, 10.0, make_other_clutch(5.0)) == 0.0) is explained, motor


def test_plates_that_stick_carry_anything_up_to_their_capacity_either_way() -> None:
    for motor in (-15.0, 0.0, 25.0):  # -1.5 12 + 0.6 5 to 1.5 (12 + 5), and 0.3
        assert compute_mismatch(motor, 0.0, make_other_clutch(5.0), own_sticks=True, capacity=12.0) == 0.0
        assert compute_mismatch(motor, 5.0, make_other_clutch(12.0, sticks=True)) == 0.0
        assert compute_mismatch(motor, 5.0, make_other_clutch(-12.0, sticks=True)) == 0.0
    assert compute_mismatch(40.0, 0.0, make_other_clutch(5.0), own_sticks=True, capacity=12.0) == pytest.approx(
        40.0 - 17.0
    )
    assert compute_mismatch(-40.0, 0.0, make_other_clutch(5.0), own_sticks=True, capacity=12.0) == pytest.approx(
        -40.0 + 12.0 - 5.0
    )


def test_the_inertia_of_the_input_is_told_from_both_slips() -> None:
    """s_a' = 1 and s_b' = 2 rad/s^2 are w_in' = 3*2 - 2*1 = 4 and w_out' = 1."""
    unknown = 100.0 + WEIGHT * 4.0
    assert compute_mismatch(unknown, 10.0, make_other_clutch(5.0, acceleration=2.0), slip_rate=1.0) == pytest.approx(
        85.0
    )
    applied, known = find_applied_torque(make_other_clutch(0.0, acceleration=2.0), PAIR, make_settings(), 10.0)
    assert known
    assert applied == pytest.approx(10.0 - WEIGHT * 3.0 * 2.0), "own slip constant: w_in' = 3 s_b'"


def test_a_silent_other_is_not_compared_with() -> None:
    for silent in (make_other(), make_other_clutch(5.0)):
        silent.age = 0.26
        assert compute_mismatch(40.0, 10.0, silent) == 0.0
        assert not find_applied_torque(silent, PAIR, make_settings(), 10.0)[1]
    assert not find_applied_torque(make_other_clutch(0.1), PAIR, make_settings(), 10.0)[1], "it transmits"


def test_a_status_counts_from_when_it_is_heeded() -> None:
    state = make_other_clutch(5.0)
    state.age = 0.2
    take_other_status(state, 7.0, True)
    assert (state.estimate, state.sticks, state.age) == (5.0, False, 0.2)
    use_newest_status(state)
    assert (state.estimate, state.sticks, state.age) == (7.0, True, 0.0)
    state.age = 0.2
    use_newest_status(state)
    assert state.age == 0.2, "nothing new"


def test_the_encoder_of_the_other_wraps_and_skips() -> None:
    state = make_other()
    for k in range(400):
        take_other_encoder(state, make_encoder_payload(2**32 - 300 + 3 * k, 65500 + 2 * k), DEFINITION, PERIOD, 100.0)
    assert state.slip == pytest.approx(1.5 * STEP / PERIOD)
    assert state.acceleration == pytest.approx(0.0, abs=1e-9)


def test_gears_must_differ() -> None:
    node = ControllerNode(500, clutch="a")
    with pytest.raises(
        InputError, match=r"driveline\.ratio_a and driveline\.ratio_b are both 2; two gears must differ"
    ):
        node.tune({"driveline.ratio_a": 2.0})


@cache
def play_shift(scenario: str, changed: str = "", value: float = 0.0, at: float = 0.0) -> dict[str, np.ndarray]:
    """Simulate a shift; return its columns. Columns of a controller end with the name of its clutch."""
    case = load_scenario(scenario)
    if changed:
        case = replace(case, injections=(Injection({changed: value}, at=at),))
    run, _ = Simulation(case).play_with_metadata()
    columns = {column.name: run.plant[:, k] for k, column in enumerate(PLANT)}
    for name, rows in zip("ab", run.controllers, strict=True):
        columns |= {f"{column.name}_{name}": rows[:, k] for k, column in enumerate(COLUMNS)}
    return columns


def find_fault_time(run: dict[str, np.ndarray], clutch: str) -> float:
    """Return when the controller of a clutch detects an implausible torque [s]; not a number if it does not."""
    result = run["time_s"][run[f"fault_{clutch}"] == Fault.TORQUE_IMPLAUSIBLE]
    return float(result[0]) if len(result) else np.nan


@pytest.mark.parametrize("scenario", ["shift", "lock_up_shift"])
def test_a_healthy_shift_is_plausible(scenario: str) -> None:
    run = play_shift(scenario)
    assert run["fault_a"].max() == run["fault_b"].max() == 0


@pytest.mark.parametrize(
    ("changed", "value"),
    [
        ("a.motor_torque_sensor_offset.offset", 20.0),
        ("a.motor_torque_sensor_offset.offset", -20.0),
        ("a.friction_level.level", 2.0),
    ],
)
def test_a_wrong_torque_of_the_clutch_that_carries_is_found(changed: str, value: float) -> None:
    assert 2.0 < find_fault_time(play_shift("shift", changed, value, 2.0), "a") < 2.0 + IN_TIME


@pytest.mark.parametrize("level", [0.3, 2.0])
def test_wrong_friction_of_the_clutch_that_comes_is_found_in_the_hand_over(level: float) -> None:
    run = play_shift("shift", "b.friction_level.level", level, 0.8)
    columns = run["truth_clutch_torque_b_nm"] / level  # what it should be
    begins = run["time_s"][np.abs(run["truth_clutch_torque_b_nm"] - columns) > 8.0]
    result = min(t for t in (find_fault_time(run, "a"), find_fault_time(run, "b")) if t == t)
    assert result < begins[0] + IN_TIME + 0.1  # s: the status of the other is as old


def test_a_locked_clutch_carries_what_the_open_one_leaves_to_it() -> None:
    run = play_shift("lock_up_shift")
    held = (run["clutch_state_b"] == 3) & (run["time_s"] > 5.8)
    error = run["torque_estimate_nm_b"] - run["truth_clutch_torque_b_nm"]
    assert held.sum() > 500
    assert np.abs(error[held]).max() < 0.5
    assert (run["capacity_nm_b"][held] > run["truth_clutch_torque_b_nm"][held]).all()
