"""Units as other laboratories spell them; and a unit that nobody can read, but that says more than the map does, is refused."""

from math import pi
from pathlib import Path

import pytest

from clutch_hil.recordings.channel import simplify_unit
from clutch_hil.recordings.unknown_unit import names_unit
from protocols.files.units import to_si
from tests.clutch_hil.recordings.maps import find_refusal, import_by

POUND, G = 4.4482216152605, 9.80665  # N, by definition
SPELLINGS = {
    "lb·in": POUND * 0.0254, "in-lbs": POUND * 0.0254, "Inch Pounds": POUND * 0.0254, "ft·lb": POUND * 0.3048,
    "FT-LB": POUND * 0.3048, "lbs-ft": POUND * 0.3048, "ftlb": POUND * 0.3048, "oz-in": POUND * 0.0254 / 16.0,
    "kgf-cm": 0.01 * G, "kg·cm": 0.01 * G, "kgm": G, "N-cm": 0.01, "mN-m": 1e-3, "newton-metre": 1.0,
    "bar gauge": 1e5, "bar ü": 1e5, "bar-g": 1e5, "kPa(g)": 1e3, "MPaG": 1e6, "PSIG": 6894.757293168362, "kgf/cm²(G)": 1e4 * G,
    "bar a": 1e5, "kg/cm2a": 1e4 * G, "ata": 1e4 * G, "r.p.m.": pi / 30.0, "об/мин": pi / 30.0, "dps": pi / 180.0,
    "µNm": 1e-6, "μNm": 1e-6, "deg.s-1": pi / 180.0, "rad s-1": 1.0, "m·s⁻¹": 1.0, "kmph": 1.0 / 3.6, "PS": 735.49875,
}  # fmt: skip


@pytest.mark.parametrize("unit", SPELLINGS)
def test_a_unit_is_known_as_laboratories_spell_it(unit: str) -> None:
    assert to_si(1.0, simplify_unit(unit)) == pytest.approx(SPELLINGS[unit], rel=1e-9)


def import_in(tmp_path: Path, unit: str, column: str, entry: str) -> list[float]:
    path = tmp_path / "log.csv"
    path.write_text(f"time [s];q [{unit}]\n" + "".join(f"{0.01 * n:.2f};{5 + n % 3}.5\n" for n in range(50)))
    columns = f'[columns]\ntime_s = {{ from = "time" }}\n{column} = {{ from = "q", {entry} }}\n'
    return list(import_by(tmp_path, path, columns)[column])


@pytest.mark.parametrize(
    ("unit", "column", "own"),
    [
        ("10 rpm", "speed_rad_s", "rpm"), ("rpm x 1000", "speed_rad_s", "rpm"), ("0.25 rpm/bit", "speed_rad_s", "rpm"),
        ("4-20 mA", "pressure_bar", "bar"), ("mA (4-20)", "pressure_bar", "bar"), ("%FS", "pressure_bar", "bar"),
        ("Counts", "torque_nm", "Nm"), ("ADC", "torque_nm", "Nm"), ("bar vac.", "pressure_bar", "bar"),
        ("E-3 Nm", "torque_nm", "Nm"), ("?Nm", "torque_nm", "Nm"), ("1000/min", "speed_rad_s", "rpm"),
        ("kNm (rms)", "torque_nm", "Nm"), ("10⁵ Pa", "pressure_bar", "Pa"),
        ("my", "position_m", "mm"), ("æm", "position_m", "mm"),
    ],
)  # fmt: skip
def test_an_unknown_unit_that_says_more_than_the_map_is_refused(
    tmp_path: Path, unit: str, column: str, own: str
) -> None:
    import_in(tmp_path, unit, column, f'unit = "{own}", unit_from = "map", offset = 0.0')
    sentence = find_refusal(
        tmp_path,
        tmp_path / "log.csv",
        f'[columns]\ntime_s = {{ from = "time" }}\n{column} = {{ from = "q", unit = "{own}" }}\n',
    )
    assert "unit_from = 'map'" in sentence or "set offset" in sentence


@pytest.mark.parametrize("unit", ["Nmtr", "lbm/ft3", "drehm."])
def test_a_spelling_that_says_nothing_else_leaves_the_unit_to_the_map(tmp_path: Path, unit: str) -> None:
    assert import_in(tmp_path, unit, "torque_nm", 'unit = "Nm"')[0] == 5.5


@pytest.mark.parametrize("number", ["1e+308", "9.91e+37", "-9.9e+37", "3.4028234e+38", "1e+20"])
def test_a_huge_number_is_told_as_one_writes_it(tmp_path: Path, number: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time [s],q [Nm]\n" + "".join(f"{0.01 * n:.2f},{number if n == 7 else 5.5}\n" for n in range(50)))
    sentence = find_refusal(tmp_path, path, '[columns]\ntime_s = { from = "time" }\nq_nm = { from = "q" }\n')
    assert f"set missing = {number} for q_nm" in sentence


@pytest.mark.parametrize(
    "unit",
    [
        "0.001 Nm",
        "Nm x1000",
        "Nm*0.001",
        "10^-3 Nm",
        "E-3 Nm",
        "1/1000 Nm",
        "0.1Nm",
        "digit",
        "LSB",
        "%FS",
        "?Nm",
        "\ufffdNm",
    ],
)
def test_a_line_of_units_with_a_factor_has_no_names(tmp_path: Path, unit: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"time;torque\ns;{unit}\n" + "".join(f"{0.01 * n:.2f};{5 + n % 3}\n" for n in range(50)))
    columns = '[columns]\ntime_s = { from = "time" }\ntorque_nm = { number = 2, unit = "Nm" }\n'
    sentence = find_refusal(tmp_path, path, columns)
    assert f"'torque' for torque_nm is in {unit!r}" in sentence
    assert "unit_from = 'map'" in sentence


def test_names_with_numbers_are_no_units() -> None:
    assert not any(map(names_unit, ("5V", "3D", "T1", "x1", "CH1", "Speed 1", "2", "?", "")))


@pytest.mark.parametrize("below", ["100 Hz;50 Hz", "10 s;5 kNm"])
def test_a_line_of_rates_or_ranges_below_the_units_has_no_units(tmp_path: Path, below: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"time;torque\ns;kNm\n{below}\n" + "".join(f"{0.01 * n:.2f};{5 + n % 3}.5\n" for n in range(50)))
    columns = '[columns]\ntime_s = { from = "time" }\ntorque_nm = { from = "torque" }\n'
    assert import_by(tmp_path, path, columns)["torque_nm"][0] == pytest.approx(5500.0)
