"""Profiles: what is asked for between rows, one sentence for each bad file, and the experiments that come with the rig."""

from pathlib import Path

import pytest

from clutch_hil.bench import experiments
from plant_sim.profiles.profile import FOLDER, Profile, Setpoint, load_profile
from plant_sim.profiles.shift_profile import load_shift_profile
from protocols.can.request import Request
from protocols.errors import InputError

LENGTHS = 8.0, 24.0  # s: long enough to identify by, short enough to be tested
HEADER = "time_s,torque_demand_nm,motor_speed_demand_rad_s,pressure_demand_bar\n"
LOCK_HEADER = HEADER.replace("pressure_demand_bar", "lock")
BOTH = Profile("both", (0.0, 1.0, 2.0, 3.0), (0.0, 8.0, 8.0, 0.0), (10.0,) * 4, (0.0, 0.0, 3.0, 0.0))


@pytest.mark.parametrize(
    ("time", "asked"),
    [
        (-1.0, (Request.IDLE, 0.0, 10.0, 0.0)),
        (0.5, (Request.ENGAGE, 4.0, 10.0, 0.0)),
        (1.0, (Request.ENGAGE, 8.0, 10.0, 0.0)),  # pressure is asked for where it is above zero
        (1.5, (Request.PRESSURE, 8.0, 10.0, 1.5)),
        (2.0, (Request.PRESSURE, 8.0, 10.0, 3.0)),
        (3.0, (Request.IDLE, 0.0, 10.0, 0.0)),
    ],
)
def test_straight_lines_lie_between_rows(time: float, asked: tuple) -> None:
    assert BOTH.interpolate(time) == Setpoint(*asked)


LOCKED = Profile(
    "locked", (0.0, 1.0, 2.0, 3.0), (8.0,) * 4, (0.0, 10.0, -10.0, 5.0), (0.0, 3.0, 3.0, 0.0), lock=(0.0, 1.0, 0.0, 1.0)
)


@pytest.mark.parametrize(
    ("time", "asked"),
    [
        (0.0, (Request.IDLE, 8.0, 0.0, 0.0)),  # whatever is asked for
        (0.05, (Request.PRESSURE, 8.0, 0.5, 0.15)),
        (0.9, (Request.PRESSURE, 8.0, 9.0, 2.7)),
        (1.0, (Request.LOCK, 0.0, 10.0, 0.0)),  # nothing else is asked for then, but the motor's speed
        (1.75, (Request.LOCK, 0.0, -5.0, 0.0)),
        (2.0, (Request.PRESSURE, 8.0, -10.0, 3.0)),
        (3.0, (Request.IDLE, 0.0, 5.0, 0.0)),  # the profile is over, whatever its last row says
    ],
)
def test_the_clutch_is_to_be_locked_from_a_row_with_1_to_a_row_with_0(time: float, asked: tuple) -> None:
    assert LOCKED.interpolate(time) == pytest.approx(Setpoint(*asked))


def test_a_repeated_profile_repeats_its_lock() -> None:
    long = LOCKED.repeat_to(4.5)
    for time in (0.5, 0.999, 1.0, 1.49):
        assert long.interpolate(3.001 + time).request is LOCKED.interpolate(time).request
    assert long.interpolate(3.0005).request is Request.LOCK  # from its last row to the first of the repetition
    assert LOCKED.repeat_to(1.5).interpolate(1.499).request is Request.LOCK
    assert LOCKED.repeat_to(1.5).speed[-1] == pytest.approx(0.0)


@pytest.mark.parametrize("order", [(0, 1, 2, 4, 3), (4, 3, 2, 1, 0), (3, 0, 4, 1, 2)], ids=str)
def test_columns_of_a_file_come_in_any_order(tmp_path: Path, order: tuple[int, ...]) -> None:
    columns = {
        "time_s": ("0", "1"), "torque_demand_nm": ("0", "5"), "motor_speed_demand_rad_s": ("-10", "10"),
        "pressure_demand_bar": ("0", "3"), "lock": ("0", "1"),
    }  # fmt: skip
    names = [list(columns)[i] for i in order]
    path = tmp_path / "mixed.csv"
    path.write_text("\n".join(",".join(row) for row in (names, *zip(*(columns[n] for n in names), strict=True))))
    profile = load_profile(str(path))
    assert profile == Profile("mixed", (0.0, 1.0), (0.0, 5.0), (-10.0, 10.0), (0.0, 3.0), (0.0, 1.0))


def test_a_lock_needs_no_column_of_pressure(tmp_path: Path) -> None:
    path = tmp_path / "lock.csv"
    path.write_text("time_s,torque_demand_nm,motor_speed_demand_rad_s,lock\n0,0,10,0\n1,0,10,1\n2,0,10,0\n")
    assert load_profile(str(path)).interpolate(1.5) == (Request.LOCK, 0.0, 10.0, 0.0)


def test_a_shift_profile_locks_each_clutch_by_itself(tmp_path: Path) -> None:
    path = tmp_path / "lock.csv"
    head = "time_s,torque_demand_a_nm,torque_demand_b_nm,input_speed_demand_rad_s"
    path.write_text(f"{head},lock_b\n0,0,0,20,0\n1,5,0,20,1\n2,5,3,20,0\n3,5,3,20,0\n")
    profile = load_shift_profile(str(path))
    assert profile.table.shape == (2, 5, 4)
    assert [s.request for s in profile.interpolate(1.5)] == [Request.ENGAGE, Request.LOCK]
    assert [s.request for s in profile.interpolate(2.5)] == [Request.ENGAGE, Request.ENGAGE]
    path.write_text(f"{head},lock_b\n0,0,0,20,0\n1,5,0,20,2\n")
    with pytest.raises(InputError, match="profile lock of clutch b, row 2: lock is 2; allowed are 0 and 1"):
        load_shift_profile(str(path))
    path.write_text(f"{head},lock\n0,0,0,20,0\n1,5,0,20,1\n")
    with pytest.raises(
        InputError, match=" are needed, pressure_demand_a_bar, pressure_demand_b_bar, lock_a, lock_b are optional"
    ):
        load_shift_profile(str(path))


def test_a_profile_without_pressure_asks_for_none(tmp_path: Path) -> None:
    path = tmp_path / "torque.csv"
    path.write_text("time_s,torque_demand_nm,motor_speed_demand_rad_s\n0,0,10\n1,5,10\n")
    profile = load_profile(str(path))
    assert list(profile.pressure) == [0.0, 0.0]
    assert profile.interpolate(0.5).request is Request.ENGAGE


def test_a_repeated_profile_repeats_its_pressure() -> None:
    long = BOTH.repeat_to(5.6)  # a repetition begins 1 ms after the last row
    for time in (1.5, 2.0, 2.5):
        assert long.interpolate(time) == pytest.approx(BOTH.interpolate(time))
        assert long.interpolate(time + 3.001) == pytest.approx(BOTH.interpolate(time))
    assert long.pressure[-1] == pytest.approx(BOTH.interpolate(5.6 - 3.001).pressure)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADER + "0,0,10,0\n1,0,10,4.6\n", "row 2: set-point 4.6 bar is outside 0..4.5 bar"),
        (HEADER + "0,0,10,-0.1\n1,0,10,3\n", "row 1: set-point -0.1 bar is outside 0..4.5 bar"),
        (HEADER + "0,0,10,nan\n1,0,10,3\n", "row 1: set-point nan bar is outside 0..4.5 bar"),
        (LOCK_HEADER + "0,0,10,0\n1,0,10,0.5\n", "row 2: lock is 0.5; allowed are 0 and 1"),
        (LOCK_HEADER + "0,0,10,-1\n1,0,10,0\n", "row 1: lock is -1; allowed are 0 and 1"),
        (LOCK_HEADER + "0,0,10,nan\n1,0,10,0\n", "row 1: lock is nan; allowed are 0 and 1"),
        (LOCK_HEADER + "0,0,10\n1,0,10,0\n", "row 1 has 3 cells; 4 are needed"),
        (
            "time_s,torque_demand_nm,motor_speed_demand_rad_s,lock,lock\n0,0,10,0,1\n1,0,10,0,0\n",
            "has the columns time_s, torque_demand_nm, motor_speed_demand_rad_s, lock, lock; time_s,"
            " torque_demand_nm, motor_speed_demand_rad_s are needed, pressure_demand_bar, lock are optional",
        ),
        (HEADER + "0,0,10\n1,0,10,3\n", "row 1 has 3 cells; 4 are needed"),
        (HEADER + "0,0,10,high\n1,0,10,3\n", "row 1: pressure_demand_bar is 'high'; a number is needed"),
        (LOCK_HEADER + "0,0,10,0\n1,0,10,yes\n", "row 2: lock is 'yes'; a number is needed"),
        (LOCK_HEADER + "0,0,10,\n1,0,10,0\n", "row 1: lock is ''; a number is needed"),
        (HEADER + "0,0,10,0\n1,0,10,0\n0.5,0,10,0\n", "row 3: time_s = 0.5; it must increase, from 0 to 1e+09 at most"),
        (HEADER + "0,0,10,0\n0,0,10,0\n", "row 2: time_s = 0; it must increase, from 0 to 1e+09 at most"),
        (HEADER + "0,0,10,0\n1e300,0,10,0\n", "row 2: time_s = 1e+300; it must increase, from 0 to 1e+09 at most"),
        (HEADER + "0,0,10,0\n1e-9,0,10,0\n", "ends at 1e-09 s; it must last 0.1 s or more"),
        (HEADER, "has 0 rows; at least 2 are needed"),
        (HEADER.replace(",", ";"), "has ';' between its columns; allowed is a comma, and a point in the numbers"),
        (
            "time_s,pressure_demand_bar\n0,0\n1,3\n",
            "has the columns time_s, pressure_demand_bar; time_s, torque_demand_nm, motor_speed_demand_rad_s are needed"
            ", pressure_demand_bar, lock are optional",
        ),
    ],
)
def test_a_bad_profile_is_told_in_one_sentence(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        load_profile(str(path))
    assert str(refused.value).startswith("profile ")
    assert str(refused.value).endswith(message)


def test_columns_of_different_lengths_are_told() -> None:
    with pytest.raises(
        InputError, match=r"profile one has columns of \[2, 1, 2, 2, 2\] values; all columns need the same number"
    ):
        Profile("one", (0.0, 1.0), (1.0,), (10.0, 10.0))


def test_what_memory_cannot_hold_is_refused_before_it_is_made(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match="a run of 1e\\+06 s repeats profile short until it has 19801982 rows; allowed are"
    ):
        Profile("short", (0.0, 0.1), (0.0, 0.0), (10.0, 10.0)).repeat_to(1e6)
    path = tmp_path / "large.csv"
    with path.open("w") as file:
        file.write(HEADER)
        file.truncate(20_000_000_000)  # a hole: a billion rows take no place
    with pytest.raises(InputError, match=r"large\.csv has 20000 MB; allowed are 100"):
        load_profile(str(path))


@pytest.mark.parametrize("name", experiments.EXPERIMENTS)
def test_the_file_of_an_experiment_is_what_its_function_makes(name: str) -> None:
    assert (FOLDER / f"{name}.csv").read_text(encoding="utf-8") == experiments.write_text(name)
    assert LENGTHS[0] <= load_profile(name).duration <= LENGTHS[1]


STANDING = ("lock", "release_from_lock", "slow_reversal", "fast_reversal", "creep", "free_inertia", "hill_hold")


@pytest.mark.parametrize("name", [*experiments.EXPERIMENTS, "engagement", "table-6.6", *STANDING])
def test_every_profile_says_what_it_is_and_ends_open(name: str) -> None:
    assert (FOLDER / f"{name}.csv").read_text(encoding="utf-8").startswith("# ")
    profile = load_profile(name)
    assert profile.interpolate(0.0).request is profile.interpolate(profile.duration).request is Request.IDLE
    assert (profile.torque[-1], profile.pressure[-1], profile.lock[-1]) == (0.0, 0.0, 0.0)
