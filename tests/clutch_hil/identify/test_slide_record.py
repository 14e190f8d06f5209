"""Records of any run: units, names, and what is refused."""

import numpy as np
import pytest

from clutch_hil.identify.friction.slide_record import Columns, read_records
from clutch_hil.recordings.rasters import Sampling
from protocols.errors import InputError
from protocols.files.run import Run

N, PERIOD = 400, 1e-3
TIME = PERIOD * np.arange(N)
WAY = 1e-3 * np.sin(2.0 * np.pi * 5.0 * TIME)  # m
FORCE = 3.0 * np.sign(np.gradient(WAY))  # N


def run(**columns: np.ndarray) -> Run:
    return Run({"time_s": TIME, **columns}, {})


@pytest.mark.parametrize(
    ("columns", "chosen"),
    [
        ({"position_m": WAY, "force_n": FORCE}, Columns()),
        ({"displacement_mm": 1e3 * WAY, "friction_force_un": 1e6 * FORCE}, Columns()),
        ({"Position [mm]": 1e3 * WAY, "Force (kN)": 1e-3 * FORCE}, Columns()),
        ({"qm": 1e3 * WAY, "F": -FORCE}, Columns(position="qm:mm", force="F:-N")),
        ({"position_m": WAY, "force_n": 0.0 * FORCE, "load cell [N]": FORCE}, Columns(force="load cell [N]")),
    ],
    ids=["ours", "ends", "brackets", "named", "another"],
)
def test_any_units_become_si(columns: dict[str, np.ndarray], chosen: Columns) -> None:
    (record,) = read_records([run(**columns)], chosen)
    assert record.position == pytest.approx(WAY)
    assert record.force == pytest.approx(FORCE)
    assert record.units == ("m", "N", "")
    assert not record.loaded


def test_units_of_the_run_count_before_its_names() -> None:
    own = Run({"time_s": TIME, "position_m": 1e3 * WAY, "force_n": FORCE}, {}, {"position_m": "mm"})
    assert read_records([own])[0].position == pytest.approx(WAY)


def test_a_rotating_contact_is_in_rad_and_nm() -> None:
    (record,) = read_records([run(shaft_angle_deg=np.rad2deg(WAY), torque_nm=FORCE, pressure_bar=2.0 + WAY)])
    assert record.units == ("rad", "Nm", "Pa")
    assert record.position == pytest.approx(WAY)
    assert record.load == pytest.approx(1e5 * (2.0 + WAY))


def test_a_speed_does_where_there_is_no_position() -> None:
    speed = np.gradient(WAY, PERIOD)
    (record,) = read_records([run(speed_mm_s=1e3 * speed, force_n=FORCE)])
    assert np.abs(record.position - WAY).max() < 1e-6  # 1e-3 of the way: the trapezoids of a sine of 200 samples


def test_a_gap_makes_two_records_and_a_rate_another_grid() -> None:
    time = np.concatenate([TIME, TIME + 5.0])
    columns = {"time_s": time, "position_m": np.tile(WAY, 2), "force_n": np.tile(FORCE, 2)}
    with pytest.raises(InputError, match="5"):
        read_records([Run(columns, {})])
    first, second = read_records([Run(columns, {})], sampling=Sampling(longest_gap_s=1.0))
    assert (first.size, second.size) == (N, N)
    (thinned,) = read_records([run(position_m=WAY, force_n=FORCE)], sampling=Sampling(resample_hz=500.0))
    assert thinned.period == pytest.approx(2e-3)
    assert thinned.low_pass == pytest.approx(200.0)


def test_flicker_of_the_last_digit_is_held() -> None:
    """A position at rest that flickers has no reversals in its path."""
    still = 1e-7 * np.random.default_rng(1).standard_normal(N)
    position = np.where(TIME < 0.2, WAY, WAY[200]) + still
    (record,) = read_records([run(position_m=position, force_n=FORCE)])
    turns = np.sum(np.diff(np.sign(np.diff(record.position[210:]))) != 0.0)
    held = np.diff(record.path[210:])
    assert turns > 100
    assert np.sum(held != 0.0) < 20


@pytest.mark.parametrize(
    ("columns", "chosen", "message"),
    [
        ({"force_n": FORCE}, Columns(), "no column with a known name for position or speed"),
        ({"position_m": WAY}, Columns(), "has no column with a known name for the force"),
        ({"position_m": WAY, "force_n": FORCE}, Columns(force="forse_n"), "no column 'forse_n' for the force; did you"),
        ({"position_m": WAY, "F": FORCE}, Columns(force="F"), "states no unit of 'F'"),
        ({"position_m": WAY, "F": FORCE}, Columns(force="F:bar"), "is in 'bar'; allowed is what can be converted into N or Nm"),
        ({"position_m": WAY, "force_n": np.where(np.arange(N) == 7, np.nan, FORCE)}, Columns(), "force is not a number in row"),
        ({"position_m": WAY, "force_n": 1e200 * FORCE}, Columns(), "force is -?3e[+]200 in row 0; allowed is up to 1e[+]15"),
        ({"position_m": 0.0 * WAY + 0.2, "force_n": FORCE}, Columns(), "position stays at 0.2 m"),
        ({"position_m": WAY, "force_n": 0.0 * FORCE + 4.0}, Columns(), "force stays at 4 N"),
        ({"angle_rad": WAY, "force_n": FORCE}, Columns(), "position in rad and a force in N"),
        ({"position_m": WAY, "force_n": FORCE, "normal_load_n": -5.0 - WAY}, Columns(), "load falls to -5"),
    ],
)  # fmt: skip
def test_wrong_columns_are_told_in_a_sentence(columns: dict[str, np.ndarray], chosen: Columns, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_records([run(**columns)], chosen)


def test_empty_and_short_runs_are_refused() -> None:
    for rows in (0, 1, 50):
        with pytest.raises(InputError, match=f"has {rows} rows; 100 or more are needed"):
            read_records([Run({"time_s": TIME[:rows], "position_m": WAY[:rows], "force_n": FORCE[:rows]}, {})])
    with pytest.raises(InputError, match="no run was given"):
        read_records([])
    bad = TIME.copy()
    bad[5] = bad[4]
    with pytest.raises(InputError, match="time does not increase in row 5"):
        read_records([Run({"time_s": bad, "position_m": WAY, "force_n": FORCE}, {})])


def test_an_angle_that_begins_anew_is_refused_before_a_low_pass_hides_it() -> None:
    turning = run(shaft_angle_deg=np.mod(5000.0 * TIME, 360.0), torque_nm=FORCE)
    with pytest.raises(InputError, match=r"^run 1: position, rows 71 to 360, jumps by 6\.283 rad 5 times.*360 where"):
        read_records([turning], sampling=Sampling(low_pass_hz=50.0))


def test_runs_of_two_rigs_are_refused() -> None:
    with pytest.raises(InputError, match="different quantities"):
        read_records([run(position_m=WAY, force_n=FORCE), run(angle_rad=WAY, torque_nm=FORCE)])
