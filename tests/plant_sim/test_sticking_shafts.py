"""Clutches that stick between the shafts of the power-shift rig: they tie shafts, hold motor and grade, and keep energy."""

import numpy as np
import pytest

from plant_sim.rigs import power_shift
from tests.plant_sim.test_sticking import OIL, PERIOD, STEPS, SWINGS


def drive_shafts(
    whole: power_shift.Rig,
    state: power_shift.PowerShift,
    volts: tuple[float, float],
    speed: float,
    seconds: float,
    limit: float,
    substeps: int = 10,
) -> tuple[power_shift.PowerShift, list[power_shift.PowerShift]]:
    seen = []
    for _ in range(round(seconds / PERIOD)):
        state = whole.advance(state, volts, speed, limit, PERIOD, substeps)
        seen.append(state)
    return state, seen


def compute_lost_energy(whole: power_shift.Rig, begin: power_shift.PowerShift, end: power_shift.PowerShift) -> float:
    """Share of the motor's work that is neither kinetic energy nor heat nor of the road."""
    one, two = begin.read(), end.read()
    inertia, vehicle = whole.a.record["motor_inertia"][0], whole.record["inertia"][0]
    kinetic = 0.5 * inertia * (two.input_speed**2 - one.input_speed**2)
    kinetic += 0.5 * vehicle * (two.output_speed**2 - one.output_speed**2)
    work = two.input_work - one.input_work
    spent = kinetic + two.road_work - one.road_work + two.heat_a - one.heat_a + two.heat_b - one.heat_b
    return abs(work - spent) / max(abs(work), 1.0)


@pytest.mark.parametrize("substeps", STEPS)
def test_a_clutch_locks_up_during_a_shift_and_ties_the_shafts(substeps: int) -> None:
    whole = power_shift.Rig(power_shift.load_nominal())
    begin = whole.make_rest_state(15.0, 4.0, OIL)
    state, seen = drive_shafts(whole, begin, (0.0, 1.5), 15.0, 3.0, 8.0, substeps)
    tail = [one.b.read() for one in seen[-500:]]
    assert all(one.slip_speed == 0.0 for one in tail)
    line, clutch = state.read(), state.b.read()
    assert line.input_speed == 2.0 * line.output_speed
    # the motor less what its own inertia takes goes through the clutch, and moves the vehicle
    inertia, vehicle = whole.a.record["motor_inertia"][0], whole.record["inertia"][0]
    assert clutch.clutch_torque == pytest.approx(line.motor_torque - inertia * line.input_acceleration, rel=1e-9)
    assert 2.0 * clutch.clutch_torque == pytest.approx(line.road_torque + vehicle * line.output_acceleration, rel=1e-9)
    assert clutch.acceleration == pytest.approx(0.0, abs=1e-9)
    assert compute_lost_energy(whole, begin, state) < 1e-9


@pytest.mark.parametrize("case", range(12))
def test_energy_is_kept_whatever_sticks(case: int) -> None:
    random = np.random.default_rng(case)
    whole = power_shift.Rig(power_shift.load_nominal())
    begin = state = whole.make_rest_state(random.uniform(-5, 20), random.choice([0.0, 3.0]), OIL)
    for _ in range(8):
        volts = tuple(random.choice([0.0, 1.2, 1.6, 2.5], 2).tolist())
        state, seen = drive_shafts(whole, state, volts, random.uniform(-10, 20), 0.4, random.uniform(2, 40))
        torques = np.array([[one.a.read().clutch_torque, one.b.read().clutch_torque] for one in seen])
        assert np.isfinite(torques).all()
        for clutch in ("a", "b"):
            states = [getattr(one, clutch).read() for one in seen]
            way = np.sign([one.slip_speed for one in states])
            # a clutch may land, and break away, twice when the other one does
            assert (np.diff(way[way != 0.0]) != 0.0).sum() <= 3 * SWINGS, "chatter"
    assert compute_lost_energy(whole, begin, state) < 1e-9


def test_both_clutches_stick_at_a_standstill_and_hold_the_motor_and_the_grade() -> None:
    whole = power_shift.Rig(power_shift.load_nominal().with_values({"driveline.grade": 0.03}))
    state, _ = drive_shafts(whole, whole.make_rest_state(0.0, 0.0, OIL), (2.0, 2.0), 0.0, 0.5, 40.0)
    begin = state.read()
    for motor in (5.0, -5.0, 0.0):
        state, seen = drive_shafts(whole, state, (2.0, 2.0), np.copysign(100.0, motor), 0.3, abs(motor))
        for one in seen:
            line, a, b = one.read(), one.a.read(), one.b.read()
            assert line.input_speed == line.output_speed == 0.0
            assert a.clutch_torque + b.clutch_torque == pytest.approx(line.motor_torque, abs=1e-9)
            assert 3.0 * a.clutch_torque + 2.0 * b.clutch_torque == pytest.approx(line.road_torque, abs=1e-9)
    assert state.read().output_speed == begin.output_speed
