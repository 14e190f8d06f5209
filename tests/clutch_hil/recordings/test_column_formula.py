"""Columns that a file does not have, computed by a formula of the map."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.import_map import load_map
from clutch_hil.recordings.rasters import filter_low_pass
from protocols.errors import InputError
from protocols.files.run import Run

TIME = np.arange(400) / 1000.0
INPUT, OUTPUT = 900.0 + 300.0 * np.sin(40.0 * TIME), 300.0 + 1000.0 * TIME  # rpm
TORQUE = 12.0 + np.cos(30.0 * TIME)
RPM = np.pi / 30.0
COLUMNS = """[columns]
time_s = { from = "t", unit = "s" }
input_speed_rad_s = { from = "n_in", unit = "rpm" }
output_speed_rad_s = { from = "n_out", unit = "rpm" }
motor_torque_nm = { from = "M", unit = "Nm" }
oil_temperature_degc = { constant = 60.0 }
"""
SLIP = 'slip_speed_rad_s = { formula = "input_speed_rad_s - 2.5 * output_speed_rad_s" }\n'


def read(folder: Path, columns: str, file: str = "", rows: slice = slice(None)) -> list[Run]:
    """The runs of `rows` of a recording by a map with these columns, and entries of [file]."""
    lines = [
        f"{t:.3f},{a!r},{b!r},{m!r}"
        for t, a, b, m in zip(TIME, INPUT.tolist(), OUTPUT.tolist(), TORQUE.tolist(), strict=True)
    ]
    (folder / "rows.csv").write_text("\n".join(["t,n_in,n_out,M", *lines[rows]]))
    (folder / "map.toml").write_text(f"[file]\n{file}\n{COLUMNS}{columns}")
    return load_map(str(folder / "map.toml")).read_runs(folder / "rows.csv")


def test_the_slip_of_a_rig_that_measures_both_shafts(tmp_path: Path) -> None:
    (run,) = read(tmp_path, SLIP)
    assert run["slip_speed_rad_s"] == pytest.approx(RPM * (INPUT - 2.5 * OUTPUT), rel=1e-12)
    assert run.units["slip_speed_rad_s"] == "rad/s"
    origin = run.metadata["import"]
    text = "input_speed_rad_s - 2.5 * output_speed_rad_s"
    assert f"slip_speed_rad_s = {text} by the map: the file does not have it" in origin["done"]
    assert origin["not_measured"] == {"oil_temperature_degc": 60.0, "slip_speed_rad_s": text}


def test_the_torque_of_a_clutch_by_the_balance_of_the_motor(tmp_path: Path) -> None:
    """A formula uses the one above it, functions of all rows, and a constant."""
    torque = 'clutch_torque_nm = { formula = "motor_torque_nm - 0.4*derivative(low_pass(slip_speed_rad_s, 50))" }'
    (run,) = read(
        tmp_path, SLIP + torque + '\nhot_degc = { formula = "oil_temperature_degc + integral(motor_torque_nm)" }'
    )
    slip = filter_low_pass("", "", RPM * (INPUT - 2.5 * OUTPUT), 50.0, 1000.0)
    inside = slice(80, -80)  # the low pass has its transients at the ends
    assert run["clutch_torque_nm"][inside] == pytest.approx((TORQUE - 0.4 * np.gradient(slip, 1e-3))[inside], abs=1e-6)
    slope = RPM * (12000.0 * np.cos(40.0 * TIME) - 2500.0)  # by hand
    assert run["clutch_torque_nm"][inside] == pytest.approx((TORQUE - 0.4 * slope)[inside], abs=1.0)
    assert run["hot_degc"][-1] == pytest.approx(60.0 + 12.0 * 0.399 + np.sin(30.0 * 0.399) / 30.0, abs=1e-4)


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("running_sum(motor_torque_nm)", 1e-3 * np.cumsum(TORQUE)),
        ("shift(motor_torque_nm, 0.004)", np.append(np.full(4, TORQUE[0]), TORQUE[:-4])),
        ("shift(motor_torque_nm, -0.004)", np.append(TORQUE[4:], np.full(4, TORQUE[-1]))),
        ("motor_torque_nm^2", TORQUE**2), ("-motor_torque_nm**0.5", -np.sqrt(TORQUE)),
        ("max(motor_torque_nm, 12) - min(motor_torque_nm, 12)", np.abs(TORQUE - 12.0)), ("2e0*time_s", 2.0 * TIME),
        ("exp(log(abs(motor_torque_nm))) * sign(motor_torque_nm)", TORQUE), ("0*motor_torque_nm + 3", np.full(400, 3.0)),
    ],
)  # fmt: skip
def test_what_a_formula_computes(tmp_path: Path, formula: str, expected: np.ndarray) -> None:
    (run,) = read(tmp_path, f'x_1 = {{ formula = "{formula}" }}')
    assert run["x_1"] == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_it_is_computed_before_the_run_is_cut_and_in_each_piece(tmp_path: Path) -> None:
    line = 'x_1 = { formula = "integral(motor_torque_nm)" }'
    (whole,) = read(tmp_path, line)
    (cut,) = read(tmp_path, line, "from_s = 0.1\nto_s = 0.2")
    np.testing.assert_array_equal(cut["x_1"], whole["x_1"][100:201])
    (slow,) = read(tmp_path, line, "resample_hz = 250.0")
    assert len(slow["x_1"]) == len(slow["time_s"]) < 110


def test_rows_outside_of_the_part_to_keep_may_have_no_value(tmp_path: Path) -> None:
    line = 'x_1 = { formula = "1 / time_s" }'
    with pytest.raises(InputError, match=r"x_1 = 1 / time_s is inf in row 0, one of 1 such rows; allowed are numbers"):
        read(tmp_path, line)
    (run,) = read(tmp_path, line, "from_s = 0.1")
    assert run["x_1"][0] == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ('x_1 = { formula = "motor_torqe_nm" }', "'motor_torqe_nm', which is not a column of the map; did you mean motor_"),
        ('x_1 = { formula = "x_1 + time_s" }', "x_1: its formula needs x_1, which is also computed"),
        ('x_1 = { formula = "y_1" }\ny_1 = { formula = "time_s" }', "which is also computed; put the line of y_1 above it"),
        ('x_1 = { formula = "2 + 3" }', "the formula '2 + 3' of x_1 uses no column; use `constant` for one value"),
        ('x_1 = { formula = "time_s +" }', "x_1: 'time_s +' is not a formula; allowed are numbers, names"),
        ('x_1 = { formula = "" }', "'' is not a formula"),
        ('x_1 = { formula = "sine(time_s)" }', "function 'sine' is unknown; did you mean sin"),
        ('x_1 = { formula = "low_pass(time_s)" }', "low_pass has 1 arguments; allowed is 2"),
        ('x_1 = { formula = "low_pass(motor_torque_nm, 500)" }', "low_pass of x_1 is 500 Hz; allowed is below 500 Hz"),
        ('x_1 = { formula = "low_pass(motor_torque_nm, -1)" }', "limit of low_pass is -1; allowed is a number of Hz above 0"),
        ('x_1 = { formula = "low_pass(motor_torque_nm, time_s)" }', "the limit of low_pass is a column"),
        ('x_1 = { formula = "shift(motor_torque_nm, 0.5)" }', "shift is by 0.5 s; allowed is less than the run's 0.399 s"),
        ('x_1 = { formula = "shift(motor_torque_nm, time_s)" }', "shift is by a column; allowed is less than the run's"),
        ('x_1 = { formula = "running_sum(3) * time_s" }', "running_sum has as its argument the number 3; a column is needed"),
        ('x_1 = { formula = "derivative(3) + time_s" }', "derivative has as its argument the number 3; a column is needed"),
        ('x_1 = { formula = "derivative(1 / time_s)" }', "is applied to a value that is not a number in row"),
        ('x_1 = { formula = "time_s.real" }', "'time_s.real' is not allowed in it"),
        ('x_1 = { formula = "time_s if True else 1" }', "is not allowed in it"),
        ('x_1 = { formula = "__import__(time_s)" }', "function '__import__' is unknown"),
        ('x_1 = { formula = "open(time_s)" }', "function 'open' is unknown"),
        ('x_1 = { formula = "time_s * 1e999" }', "a number in it is not below 1e+300"),
        (f'x_1 = {{ formula = "time_s + {"9" * 500}" }}', "a number in it is not below 1e+300"),
        (f'x_1 = {{ formula = "{"+".join(["time_s"] * 200)}" }}', "it has 1399 characters; allowed are 1000"),
        ('x_1 = { formula = "time_s", unit = "s" }', "x_1 has formula; it is allowed only as the single entry"),
        ("x_1 = { formula = 3 }", "x_1.formula is 3"),
    ],
)  # fmt: skip
def test_a_formula_that_cannot_be_is_refused(tmp_path: Path, line: str, sentence: str) -> None:
    with pytest.raises(InputError) as refused:
        read(tmp_path, line)
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)


def test_time_is_not_computed(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text('[columns]\ntime_s = { formula = "x_1" }\nx_1 = { from = "x" }')
    with pytest.raises(
        InputError, match="time_s has formula; it is allowed only as the single entry of a column other than time_s"
    ):
        load_map(str(tmp_path / "map.toml"))
