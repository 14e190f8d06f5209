"""Numbers and times of text files as other countries write them: digits, marks, groups of thousands, halves of the day."""

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.text.characters import simplify_characters
from tests.clutch_hil.recordings.text_files import SPEED, TIME, TORQUE, assert_right, make_table, read

LARGE = 1e4  # Nm in the file: its groups of thousands are those of the torque


def write_in(zero: str, decimal: str = ".") -> Callable[[float], str]:
    table = str.maketrans("0123456789.", "".join(chr(ord(zero) + digit) for digit in range(10)) + decimal)
    return lambda value: f"{value:.4f}".translate(table)


def write_indian(value: float) -> str:
    whole, fraction = f"{abs(value):.4f}".split(".")
    groups = [whole[-3:]]
    while whole := whole[: -3 if len(groups) == 1 else -2]:
        groups.insert(0, whole[-2:])
    return f"{'-' if value < 0 else ''}{','.join(groups)}.{fraction}"


def write_with_minus(minus: str) -> Callable[[float], str]:
    return lambda value: f"{value:.4f}".replace("-", minus)


NUMBERS = {
    "arabic": write_in("٠", "٫"), "persian": write_in("۰", "٫"), "devanagari": write_in("०"), "thai": write_in("๐"),
    "full width": write_in("０", "．"), "marks of direction": write_with_minus("\u200e-"), "dash": write_with_minus("–"),
    "hyphen": write_with_minus("‐"), "full-width minus": write_with_minus("－"),
}  # fmt: skip


@pytest.mark.parametrize("kind", NUMBERS)
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_numbers_of_other_scripts_are_read(tmp_path: Path, kind: str, delimiter: str) -> None:
    assert_right(read(tmp_path, make_table(delimiter, write=NUMBERS[kind])))


def test_many_digits_are_looked_at_once() -> None:
    text = "1.5" * 200_000 + ",٣"
    assert simplify_characters(text) == text[:-1] + "3"


def test_names_keep_their_characters() -> None:
    for name in ("トルク１２,回転数２", "Torque – left", "１２号機", "a\u2009b", "p–5", "é１٢"):
        assert simplify_characters(name) == name
    assert simplify_characters("2025年３月,１２：３０：００．５,−２\n–3") == "2025年３月,12:30:00.5,−2\n-3"


@pytest.mark.parametrize(
    "write",
    [write_indian, *(lambda v, mark=mark: f"{v:,.4f}".replace(",", mark) for mark in ("\u2009", "\u2007", "\u202f"))],
)
def test_groups_of_thousands_of_other_countries_are_read(tmp_path: Path, write: Callable[[float], str]) -> None:
    rows = [f"{t:.4f};{write(LARGE * m)};{w:.4f}" for t, m, w in zip(TIME, TORQUE, SPEED, strict=True)]
    run = read(tmp_path, "\n".join(["time;torque;speed", *rows, ""]))
    np.testing.assert_allclose(run["torque_nm"], LARGE * TORQUE, atol=1e-3)


def test_indian_groups_need_a_last_group_of_three(tmp_path: Path) -> None:
    rows = [f"{t:.4f};1,23,45;{w:.4f}" for t, w in zip(TIME, SPEED, strict=True)]
    with pytest.raises(Exception, match="holds"):
        read(tmp_path, "\n".join(["time;torque;speed", *rows, ""]))


START = datetime(2025, 3, 25, 11, 59, 59, 800_000)  # the half of the day changes


def write_hour(at: datetime, halves: tuple[str, str]) -> str:
    return f"{halves[at.hour // 12]} {(at.hour - 1) % 12 + 1}:{at:%M:%S.%f}"


TIMES: dict[str, Callable[[datetime], str]] = {
    "korean": lambda at: f"{at:%Y-%m-%d} {write_hour(at, ('오전', '오후'))}",
    "korean, characters": lambda at: f"{at.year}년 {at.month}월 {at.day}일 {write_hour(at, ('오전', '오후'))}",
    "korean, points": lambda at: f"{at.year}. {at.month}. {at.day}. {write_hour(at, ('오전', '오후'))}",
    "chinese": lambda at: f"{at.year}/{at.month}/{at.day} {write_hour(at, ('上午', '下午'))}",
    "chinese, without a blank": lambda at: f"{at.year}/{at.month}/{at.day} {write_hour(at, ('上午', '下午')).replace(' ', '')}",
    "japanese, time of day": lambda at: write_hour(at, ("午前", "午後")),
    "spanish": lambda at: f"{at:%Y-%m-%d %I:%M:%S.%f} {'ap'[at.hour // 12]}. m.",
    "hungarian": lambda at: f"{at:%Y.%m.%d. %H:%M:%S.%f}",
    "finnish": lambda at: f"{at:%d.%m.%Y %H.%M.%S.%f}",
    "swedish": lambda at: f"25 maj 2025 {at:%H:%M:%S.%f}",
    "day of the year": lambda at: f"{at:%Y-%j %H:%M:%S.%f}",
    "day of the year, colons": lambda at: f"{at:%Y:%j:%H:%M:%S.%f}",
    "semicolon before the milliseconds": lambda at: f"{at:%H:%M:%S;%f}",
    "zone of Java": lambda at: f"{at:%Y-%m-%dT%H:%M:%S.%f}+01:00[Europe/Berlin]",
    "zone with its name": lambda at: f"{at:%Y-%m-%d %H:%M:%S.%f} UTC+05:30",
    "zone of one digit": lambda at: f"{at:%Y-%m-%d %H:%M:%S.%f} GMT+1",
    "many minutes": lambda at: f"161:{(at - START).total_seconds():09.6f}",
    "before a trigger": lambda at: f"{'-' if at.hour < 12 else '+'}00:00:{abs((at - START).total_seconds() - 0.2):09.6f}",
    "days of Python before a trigger": lambda at: str(at - START - timedelta(seconds=0.2)),
    "days of pandas before a trigger": lambda at: f"{-(at.hour < 12)} days +{at + timedelta(hours=12):%H:%M:%S.%f}",
}  # fmt: skip


@pytest.mark.parametrize("kind", TIMES)
def test_times_of_other_countries_are_read(tmp_path: Path, kind: str) -> None:
    times = [TIMES[kind](START + timedelta(seconds=float(t))) for t in TIME]
    assert_right(read(tmp_path, make_table("\t", times=times)))
