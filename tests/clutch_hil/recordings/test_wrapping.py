"""Whole numbers that begin anew after their range: counters, and numbers below 0 that were stored without their sign."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.wrapping import find_range
from tests.clutch_hil.recordings.text_files import MAP, ROWS, TIME, convert_run, find_refusal, make_table, read

ROW = np.arange(400)
WAVE = np.rint(300.0 * np.sin(ROW / 20.0))


@pytest.mark.parametrize(
    ("values", "period", "row"),
    [
        (np.mod(WAVE, 65536.0), 65536, 63),
        (np.mod(60000.0 + 50.0 * ROW, 65536.0), 65536, 111),
        (np.mod(60000.0 + 50.0 * ROW, 65536.0) - 32768.0, 65536, 111),
        (np.mod(WAVE / 10.0 // 1.0, 256.0), 256, 63),
        (np.mod(4294960000.0 + 100.0 * ROW, 2.0**32), 1 << 32, 73),
        (np.where(ROW == 5, np.nan, np.mod(WAVE, 65536.0)), 65536, 63),
    ],
    ids=["below zero", "counter", "signed counter", "byte", "milliseconds", "a missing number"],
)
def test_the_range_is_found(values: np.ndarray, period: int, row: int) -> None:
    assert find_range(values) == (period, row)


@pytest.mark.parametrize(
    "values",
    [
        WAVE,
        np.where(ROW % 100 < 50, 0.0, 65535.0),
        np.where(ROW == 200, 65535.0, 3000.0 + WAVE),
        np.mod(WAVE, 65536.0) + 0.5,
        np.where(ROW < 200, 100.0, 65000.0) + WAVE % 7.0,
        np.array([0.0, 65535.0, 0.0]),
    ],
    ids=["wave", "switch", "placeholder", "fractions", "large step", "few"],
)
def test_other_numbers_have_no_range(values: np.ndarray) -> None:
    assert find_range(values) == (0, 0)


def test_an_import_tells_the_range_and_undoes_it(tmp_path: Path) -> None:
    torque = np.rint(300.0 * np.sin(np.arange(ROWS) / 5.0))
    rows = [f"{0.01 * k:.2f},{int(value) & 0xFFFF},{1.5 * k}" for k, value in enumerate(torque)]
    text = "\n".join(["time,torque,speed", *rows, ""])
    told = "torque: jumps by about 65536 in row 16, as a counter that begins anew, or a number below 0 that was stored"
    assert told in convert_run(read(tmp_path, text))
    run = read(tmp_path, text, columns=MAP.replace('"Nm" }', '"Nm", wraps_at = 65536 }'))
    np.testing.assert_array_equal(run["torque_nm"], torque)
    assert "jumps by about" not in convert_run(run)


@pytest.mark.parametrize(
    ("first", "step", "unit"), [(2**32 - 300, 10, "ms"), (2**32 - 300_000, 10_000, "us"), (2**16 - 300, 10, "ms")]
)
def test_a_clock_that_begins_anew_is_refused_with_its_range(tmp_path: Path, first: int, step: int, unit: str) -> None:
    period = 2**32 if first > 2**16 else 2**16
    table = make_table(times=[str((first + step * row) % period) for row in range(ROWS)])
    columns = MAP.replace('unit = "s"', f'unit = "{unit}"')
    told = f"'time' begins anew in row 30, as a counter does after {period}"
    assert told in find_refusal(tmp_path, table, columns=columns)
    run = read(tmp_path, table, columns=columns.replace(f'"{unit}"', f'"{unit}", wraps_at = {period}'))
    np.testing.assert_allclose(run["time_s"] - run["time_s"][0], TIME, atol=1e-9)
