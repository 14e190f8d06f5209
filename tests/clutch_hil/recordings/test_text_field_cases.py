"""Text files of the field cases and their clocks, where these are beside the checkout."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.import_map import load_map
from protocols.errors import InputError
from tests import needs

pytestmark = pytest.mark.needs("field cases")


def find_case(name: str) -> Path:
    return needs.FIELD_CASES / name


@pytest.mark.parametrize(
    ("name", "map_name"),
    [
        *((f"csv/{name}.csv", "csv/m.toml") for name in (
            "ok", "cp1252", "semi_comma", "excel_sep", "preamble", "units_line", "epoch", "iso", "trailing_sep",
        )),
        ("csv/semi_comma.csv", "csv/m_semi.toml"),
        ("csv/units_line.csv", "csv/m_units.toml"),
    ],
)  # fmt: skip
def test_field_cases_are_the_same_recording(name: str, map_name: str) -> None:
    run = load_map(str(find_case(map_name))).read(find_case(name))
    time_s = 0.01 * np.arange(200)
    np.testing.assert_allclose(run["time_s"], time_s, rtol=0.0, atol=np.spacing(1.8e9))
    np.testing.assert_allclose(run["torque_nm"], np.sin(10.0 * time_s), atol=6e-5)
    np.testing.assert_allclose(run["speed_rad_s"], np.pi / 30.0 * 300.0 * time_s, atol=1e-9)


def test_field_cases_with_thousands_and_flags() -> None:
    run = load_map(str(find_case("csv/m.toml"))).read(find_case("csv/thousands.csv"))
    np.testing.assert_allclose(run["speed_rad_s"], np.pi / 30.0 * 3001.5 * np.arange(200))
    gears = load_map(str(find_case("csv/flags.toml"))).read(find_case("csv/flags.csv"))
    assert set(gears["gear_1"]) == {1.0, 3.0}
    number = load_map(str(find_case("csv/m_num4.toml"))).read(find_case("csv/dup_header.csv"))
    np.testing.assert_allclose(number["speed_rad_s"], np.pi / 30.0 * 3.0 * np.arange(200))


@pytest.mark.parametrize(
    ("name", "map_name", "sentence"),
    [
        ("csv/dup_header.csv", "csv/m.toml", "has 2 columns 'torque'"),
        ("clock/day.csv", "clock/m.toml", "jumps by 86400 s after row 99, from 0.99 to 86401 s"),
        ("clock/ten.csv", "clock/big.toml", "at 1e+09 Hz makes 9e+07 rows; allowed are 5e+07"),
        (
            "clock/ten.csv",
            "clock/lp.toml",
            "torque_nm has 10 rows in a stretch without gaps; a low pass needs more than 15",
        ),
        ("clock/ten.csv", "clock/rs_tiny.toml", "has no two samples at 0.001 Hz"),
    ],
)
def test_field_cases_are_refused_by_row_and_span(name: str, map_name: str, sentence: str) -> None:
    with pytest.raises(InputError) as refused:
        load_map(str(find_case(map_name))).read(find_case(name))
    assert sentence in str(refused.value)
