"""Marks between thousands in text files: what may also be a fraction is asked about."""

from pathlib import Path

import numpy as np
import pytest

from tests.clutch_hil.recordings.text_files import (
    MAP,
    TWO,
    assert_right,
    find_refusal,
    make_rows,
    make_table,
    read,
)


def test_no_break_spaces_between_thousands_part_no_cells(tmp_path: Path) -> None:
    table = make_table("\t", write=lambda value: f"{1e3 * value:,.4f}".replace(",", "\u00a0").replace(".", ","))
    assert_right(read(tmp_path, table.encode("utf-16"), columns=MAP.replace("unit =", "scale = 1e-3, unit =")))


@pytest.mark.parametrize(
    "cells",
    [
        ("0.0;0,000", "0.1;12,125", "0.2;12,250"),
        ("0,0;1.500", "0,1;1.625", "0,2;2.250"),
        ("0.5;1,234", "0.6;0", "0.7;1,236"),
    ],
)
def test_three_digits_after_another_mark_than_the_decimal_one_are_asked_for(
    tmp_path: Path, cells: tuple[str, ...]
) -> None:
    sentence = find_refusal(tmp_path, make_rows("time;torque", *cells), columns=TWO)
    assert "can be a fraction or have a mark between thousands" in sentence


@pytest.mark.parametrize(
    "cells", [("0.5;998", "0.6;1,234"), ("0.5;1,234.5", "0.6;1,235.5"), ("0.5;1,234,567", "0.6;1,234,568")]
)
def test_thousands_that_are_certain_are_read(tmp_path: Path, cells: tuple[str, ...]) -> None:
    run = read(tmp_path, make_rows("time;torque", *cells), columns=TWO)
    assert run["torque_nm"].tolist() == [float(cell.split(";")[1].replace(",", "")) for cell in cells]


COUNTS = TWO.replace('"torque"', '"count"').replace("torque_nm", "speed_rad_s").replace('"Nm"', '"rpm"')


@pytest.mark.parametrize("first", [950, 60])
def test_a_count_that_passes_a_thousand_with_a_point_is_asked_about(tmp_path: Path, first: int) -> None:
    """Also where the cells with a mark are in the middle of a long file only."""
    counts = [*range(first, first + 2500), *range(first + 2500, first, -1)]
    rows = [f"{n};{count:,}".replace(",", ".") for n, count in enumerate(counts)]
    text = make_rows("time;count", *rows)
    assert "'1.000' can be a fraction or have a mark between thousands" in find_refusal(tmp_path, text, columns=COUNTS)
    run = read(tmp_path, text, "thousands = '.'", COUNTS)
    assert run["speed_rad_s"][1000 - first] == pytest.approx(1000 * 2.0 * np.pi / 60.0)


@pytest.mark.parametrize(
    "cells",
    [
        ["0.998", "0.999", "1.000"],
        ["1.125", "1.250", "1.375"],
        ["998", "999", "1.25"],
        ["998", "1000", "1.125"],
        ["7", "8", "9"],
    ],
    ids=["below one", "three decimals", "another count", "four digits without", "whole"],
)
def test_a_point_that_is_a_decimal_mark_is_not_asked_about(tmp_path: Path, cells: list[str]) -> None:
    rows = [f"{n};{cells[n % len(cells)]}" for n in range(600)]
    run = read(tmp_path, make_rows("time;torque", *rows), columns=TWO)
    assert run["torque_nm"][:3].tolist() == [float(cell) for cell in cells]
