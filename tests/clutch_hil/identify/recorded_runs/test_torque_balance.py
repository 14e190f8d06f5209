"""Torque balance: clutch torque and motor torque are one torque where the speed is steady."""

import numpy as np
import pytest

from clutch_hil.identify.recorded_runs.torque_balance import find_other_torque

TIME = np.arange(0.0, 10.0, 1e-3)  # s
TORQUE = 5.0 + np.floor(TIME)  # Nm, a staircase


def make_run(motor: np.ndarray) -> dict[str, np.ndarray]:
    return {
        "time_s": TIME, "slip_speed_rad_s": np.full(TIME.size, 20.0), "clutch_torque_nm": TORQUE, "motor_torque_nm": motor,
    }  # fmt: skip


def test_one_torque_is_no_finding() -> None:
    assert find_other_torque({"run": make_run(TORQUE + 0.3)}) == []


@pytest.mark.parametrize("dead", [0.0, 3.0])
def test_a_dead_motor_torque_is_told(dead: float) -> None:
    (finding,) = find_other_torque({"run": make_run(np.full(TIME.size, dead))})
    assert finding.hard
    assert "moves by 9 Nm at steady speeds, but motor_torque_nm, the same torque, does not" in finding.text


def test_a_torque_in_another_unit_is_told() -> None:
    (finding,) = find_other_torque({"run": make_run(TORQUE / 1.356)})
    assert finding.hard
    assert "moves 1.36 times as much as motor_torque_nm" in finding.text
