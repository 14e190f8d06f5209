"""Profiles: what is asked for between rows, bad files told in one sentence, and the experiments that come with the rig."""

from pathlib import Path

import pytest

from plant_sim import experiments
from plant_sim.profile import FOLDER, Profile, Setpoint, load_profile
from protocols.errors import InputError
from protocols.request import Request

LENGTHS = 8.0, 24.0  # s: long enough to identify by, short enough to be tested
HEADER = "time_s,torque_demand_nm,motor_speed_demand_rad_s,pressure_demand_bar\n"
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
    assert BOTH.at(time) == Setpoint(*asked)


def test_a_profile_without_pressure_asks_for_none(tmp_path: Path) -> None:
    path = tmp_path / "torque.csv"
    path.write_text("time_s,torque_demand_nm,motor_speed_demand_rad_s\n0,0,10\n1,5,10\n")
    profile = load_profile(str(path))
    assert list(profile.pressure) == [0.0, 0.0]
    assert profile.at(0.5).request is Request.ENGAGE


def test_a_repeated_profile_repeats_its_pressure() -> None:
    long = BOTH.lasting(5.6)  # a repetition begins 1 ms after the last row
    for time in (1.5, 2.0, 2.5):
        assert long.at(time) == pytest.approx(BOTH.at(time))
        assert long.at(time + 3.001) == pytest.approx(BOTH.at(time))
    assert long.pressure[-1] == pytest.approx(BOTH.at(5.6 - 3.001).pressure)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (HEADER + "0,0,10,0\n1,0,10,4.6\n", "row 2: set-point 4.6 bar is outside 0..4.5 bar"),
        (HEADER + "0,0,10,-0.1\n1,0,10,3\n", "row 1: set-point -0.1 bar is outside 0..4.5 bar"),
        (HEADER + "0,0,10,nan\n1,0,10,3\n", "row 1: set-point nan bar is outside 0..4.5 bar"),
        (HEADER + "0,0,10\n1,0,10,3\n", "row 1 has 3 cells; needed are 4"),
        (HEADER + "0,0,10,high\n1,0,10,3\n", "could not convert string to float: 'high'"),
        (HEADER, "has 0 rows; at least 2 are needed"),
        (
            "time_s,pressure_demand_bar\n0,0\n1,3\n",
            "has the columns time_s, pressure_demand_bar; needed are time_s, torque_demand_nm, motor_speed_demand_rad_s,"
            " then pressure_demand_bar if wanted",
        ),
    ],
)
def test_a_bad_profile_is_told_in_one_sentence(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        load_profile(str(path))
    assert str(refused.value).startswith("profile ")
    assert str(refused.value).endswith(told)


@pytest.mark.parametrize("name", experiments.EXPERIMENTS)
def test_the_file_of_an_experiment_is_what_its_function_makes(name: str) -> None:
    assert (FOLDER / f"{name}.csv").read_text(encoding="utf-8") == experiments.text(name)
    assert LENGTHS[0] <= load_profile(name).duration <= LENGTHS[1]


@pytest.mark.parametrize("name", [*experiments.EXPERIMENTS, "engagement", "table-6.6"])
def test_every_profile_says_what_it_is_and_ends_open(name: str) -> None:
    assert (FOLDER / f"{name}.csv").read_text(encoding="utf-8").startswith("# ")
    profile = load_profile(name)
    assert profile.at(0.0).request is profile.at(profile.duration).request is Request.IDLE
    assert (profile.torque[-1], profile.pressure[-1]) == (0.0, 0.0)
