"""Cells of text files that are numbers to a person: hexadecimal ones, and those with a unit behind them."""

from pathlib import Path

import numpy as np
import pytest

from tests.clutch_hil.recordings.text_files import TIME, TORQUE, find_refusal, read

STATUS = '[columns]\ntime_s = { from = "time", unit = "s" }\nstatus_1 = { from = "status", unit = "1" }\n'
UNITS = '[columns]\ntime_s = { from = "time", unit = "s" }\ntorque_nm = { from = "torque", unit = "Nm" }\n'


def make_status(cells: list[str]) -> str:
    rows = (f"{time:.2f},{torque:.4f},{cell}" for time, torque, cell in zip(TIME, TORQUE, cells, strict=True))
    return "\n".join(["time,torque,status", *rows, ""])


WORDS = [0x1E0 + row for row in range(len(TIME))]


def test_numbers_marked_as_hexadecimal_are_read(tmp_path: Path) -> None:
    run = read(tmp_path, make_status([f"0x{word:X}" for word in WORDS]), columns=STATUS)
    np.testing.assert_array_equal(run["status_1"], WORDS)
    assert "status: its whole numbers are hexadecimal" in run.metadata["import"]["done"]


def test_bare_hexadecimal_numbers_are_asked_about(tmp_path: Path) -> None:
    content = make_status([f"{word:04X}" for word in WORDS])
    assert "such as '01E0', perhaps hexadecimal: set hexadecimal = 'status' in [file]" in find_refusal(
        tmp_path, content, columns=STATUS
    )
    run = read(tmp_path, content, 'hexadecimal = "status"', STATUS)
    np.testing.assert_array_equal(run["status_1"], WORDS)
    sentence = find_refusal(tmp_path, content, 'hexadecimal = "torque"', STATUS)
    assert "column 'torque' holds '0.0000', which is not hexadecimal" in sentence
    assert "has no column 'state', which file.hexadecimal names" in find_refusal(
        tmp_path, content, 'hexadecimal = "state"', STATUS
    )


@pytest.mark.parametrize("place", [3, 55])
def test_an_exponent_that_may_be_a_digit_is_asked_about(tmp_path: Path, place: int) -> None:
    cells = [f"{row:04d}" for row in range(len(TIME))]
    cells[place] = "01E5"
    content = make_status(cells)
    sentence = find_refusal(tmp_path, content, columns=STATUS)
    assert f"column 'status' holds '01E5' in line {place + 2}, which may be hexadecimal, or 100000" in sentence
    assert read(tmp_path, content, 'hexadecimal = ""', STATUS)["status_1"][place] == 1e5
    hexadecimal = read(tmp_path, content, 'hexadecimal = "status"', STATUS)["status_1"]
    assert (hexadecimal[place], hexadecimal[20]) == (0x1E5, 0x20)


@pytest.mark.parametrize("other", ["0.5", "-3", "2e3", "1E+05"])
def test_an_exponent_beside_fractions_and_signs_is_one(tmp_path: Path, other: str) -> None:
    cells = ["1E5", other, *["7"] * (len(TIME) - 2)]
    assert read(tmp_path, make_status(cells), columns=STATUS)["status_1"][0] == 1e5


def test_words_of_letters_are_no_numbers(tmp_path: Path) -> None:
    cells = ["BAD", *["12"] * (len(TIME) - 1)]
    assert "holds 'BAD' in line 2, which is no number" in find_refusal(tmp_path, make_status(cells), columns=STATUS)


@pytest.mark.parametrize(
    ("mark", "time", "torque", "factor"),
    [(",", "{:.2f} sec", "{:.4f}", 1.0), (";", "{:.2f} s", "{:.4f} kNm", 1e3), ("\t", "{:.2f}", "{:.4f}mNm", 1e-3)],
)
def test_a_unit_behind_each_number_is_that_of_the_column(
    tmp_path: Path, mark: str, time: str, torque: str, factor: float
) -> None:
    rows = (mark.join((time.format(a), torque.format(b))) for a, b in zip(TIME, TORQUE, strict=True))
    run = read(tmp_path, "\n".join([f"time{mark}torque", *rows, ""]), columns=UNITS)
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["torque_nm"], factor * TORQUE, rtol=1e-12)


@pytest.mark.parametrize("other", ["mNm", "gear"])
def test_units_that_change_are_refused(tmp_path: Path, other: str) -> None:
    rows = [
        f"{a:.2f},{b:.4f} {other if row == 40 else 'Nm'}" for row, (a, b) in enumerate(zip(TIME, TORQUE, strict=True))
    ]
    assert "column 'torque' for torque_nm holds text" in find_refusal(
        tmp_path, "\n".join(["time,torque", *rows, ""]), columns=UNITS
    )


def read_times(tmp_path: Path, cells: list[str]) -> tuple[np.ndarray, str]:
    rows = (f"{cell},{torque:.4f}" for cell, torque in zip(cells, TORQUE, strict=False))
    run = read(tmp_path, "\n".join(["time,torque", *rows, ""]), columns=UNITS.replace(', unit = "s"', ""))
    return run["time_s"], run.metadata["import"].get("start", "")


def test_names_of_zones_tell_where_summer_time_ends(tmp_path: Path) -> None:
    cells = [f"2025-10-26 02:59:{50 + n} CEST" if n < 10 else f"2025-10-26 02:00:{n - 10:02d} CET" for n in range(40)]
    times, start = read_times(tmp_path, cells)
    np.testing.assert_allclose(times, np.arange(40.0))
    assert start == "2025-10-26T00:59:50+00:00"


@pytest.mark.parametrize(
    ("cell", "start"),
    [
        ("2 juil. 2025 10:11:{:02d}", "2025-07-02T10:11:00"),
        ("2 juin 2025 10:11:{:02d}", "2025-06-02T10:11:00"),
        ("02 août 2025 10:11:{:02d}", "2025-08-02T10:11:00"),
        ("Sun Mar  2 10:11:{:02d} CET 2025", "2025-03-02T09:11:00+00:00"),
        ("2025-061T10:11:{:02d}", "2025-03-02T10:11:00"),
    ],
)
def test_dates_of_other_languages_and_tools_are_right(tmp_path: Path, cell: str, start: str) -> None:
    times, message = read_times(tmp_path, [cell.format(n) for n in range(50)])
    np.testing.assert_allclose(times, np.arange(50.0))
    assert message == start


def test_an_hour_back_is_told_as_the_end_of_summer_time(tmp_path: Path) -> None:
    cells = [f"2025-10-26 02:59:{50 + n}" if n < 10 else f"2025-10-26 02:00:{n - 10:02d}" for n in range(40)]
    rows = (f"{cell},{torque:.4f}" for cell, torque in zip(cells, TORQUE, strict=False))
    content = "\n".join(["time,torque", *rows, ""])
    sentence = find_refusal(tmp_path, content, columns=UNITS.replace(', unit = "s"', ""))
    assert "an hour back is where summer time ends: split the file there" in sentence


def test_an_hour_forward_and_a_row_twice_are_told_as_such(tmp_path: Path) -> None:
    cells = [f"2025-03-30 01:59:{50 + n}" if n < 10 else f"2025-03-30 03:00:{n - 10:02d}" for n in range(40)]
    rows = [f"{cell},{torque:.4f}" for cell, torque in zip(cells, TORQUE, strict=False)]
    columns = UNITS.replace(', unit = "s"', "")
    sentence = find_refusal(tmp_path, "\n".join(["time,torque", *rows, ""]), columns=columns)
    assert sentence.endswith("; an hour forward is where summer time begins: write the times in UTC")
    sentence = find_refusal(tmp_path, "\n".join(["time,torque", *rows[:5], *rows[4:9], ""]), columns=columns)
    assert "does not increase in row 5: 4 s after 4 s; where a row is there twice, remove one of them" in sentence


@pytest.mark.parametrize("name", ["ms", "Milliseconds"])
def test_milliseconds_beside_whole_seconds_belong_to_the_time(tmp_path: Path, name: str) -> None:
    moments = [1500 * row + 200 for row in range(len(TIME))]
    rows = (
        f"10:{11 + at // 60000}:{at // 1000 % 60:02d},{at % 1000:03d},{torque:.4f}"
        for at, torque in zip(moments, TORQUE, strict=True)
    )
    run = read(tmp_path, "\n".join([f"time,{name},torque", *rows, ""]), columns=UNITS.replace(', unit = "s"', ""))
    np.testing.assert_allclose(run["time_s"], 1.5 * np.arange(len(TIME)), atol=1e-9)
    assert f"time: with the fractions of its seconds in '{name}', 1/1000 s" in run.metadata["import"]["done"]


def test_milliseconds_since_the_start_do_not_belong_to_the_time(tmp_path: Path) -> None:
    rows = (f"10:11:{12 if row < 9 else 13},{16 * row},{torque:.4f}" for row, torque in enumerate(TORQUE))
    content = "\n".join(["time,ms,torque", *rows, ""])
    assert "does not increase in row 1" in find_refusal(tmp_path, content, columns=UNITS.replace(', unit = "s"', ""))


def test_digits_from_0_to_f_are_asked_about(tmp_path: Path) -> None:
    cells = [f"{row % 16:X}" for row in range(len(TIME))]
    assert "perhaps hexadecimal" in find_refusal(tmp_path, make_status(cells), columns=STATUS)
    run = read(tmp_path, make_status(cells), 'hexadecimal = "status"', STATUS)
    np.testing.assert_array_equal(run["status_1"], np.arange(len(TIME)) % 16)


@pytest.mark.parametrize(("one", "zero"), [("Y", "N"), ("J", "N"), ("t", "f"), ("O", "N"), ("s", "n"), ("V", "F")])
def test_a_column_of_both_initials_is_a_flag(tmp_path: Path, one: str, zero: str) -> None:
    flags = np.arange(60) // 20 % 2
    run = read(tmp_path, make_status([one if flag else zero for flag in flags]), columns=STATUS)
    np.testing.assert_array_equal(run["status_1"], flags)


@pytest.mark.parametrize("letters", ["N", "Y", "PND", "NT"])
def test_a_letter_without_its_opposite_is_no_flag(tmp_path: Path, letters: str) -> None:
    content = make_status([letters[row // 20 % len(letters)] for row in range(60)])
    assert f"'status' for status_1 holds text, such as {letters[0]!r}" in find_refusal(
        tmp_path, content, columns=STATUS
    )


STATES = STATUS.replace('from = "status"', 'from = "status", states = { N = 0, y = 1, "half open" = 0.5 }')


@pytest.mark.parametrize("words", [["N"], ["Y", "N"], ["n", "Half Open"], ["2", "N"], ["N", "1", "3"]])
def test_words_are_the_numbers_that_the_map_gives_them(tmp_path: Path, words: list[str]) -> None:
    numbers = {"n": 0.0, "y": 1.0, "half open": 0.5}
    cells = [words[row // 20 % len(words)] for row in range(len(TIME))]
    run = read(tmp_path, make_status(cells), columns=STATES)
    np.testing.assert_array_equal(
        run["status_1"], [numbers.get(cell.lower()) or float(cell.isdigit() and cell) for cell in cells]
    )


def test_a_word_without_a_number_in_the_map_is_told(tmp_path: Path) -> None:
    cells = ["Shut" if row == 7 else "Y" for row in range(len(TIME))]
    told = find_refusal(tmp_path, make_status(cells), columns=STATES)
    assert "holds 'Shut' in line 9, which is no number; give its number in `states`" in told


@pytest.mark.parametrize(
    ("states", "told"),
    [
        ("{ N = 0, n = 1 }", "has 'n' more than once"),
        ("{ N = 'off' }", "status_1.states.N is 'off'; allowed is a number"),
        ("1", "status_1.states is 1; allowed is a table"),
    ],
)
def test_states_that_are_no_numbers_of_words_are_told(tmp_path: Path, states: str, told: str) -> None:
    columns = STATUS.replace('from = "status"', f'from = "status", states = {states}')
    assert told in find_refusal(tmp_path, make_status(["N"] * len(TIME)), columns=columns)


def test_a_column_is_not_read_with_two_meanings_of_its_words(tmp_path: Path) -> None:
    columns = STATES + 'other_1 = { from = "status", states = { N = 5 } }\n'
    assert "is read twice with different states" in find_refusal(
        tmp_path, make_status(["N"] * len(TIME)), columns=columns
    )


@pytest.mark.parametrize(
    ("words", "told"), [(["0101", "1110"], True), (["1101", "0110"], True), (["101", "110"], False)]
)
def test_digits_0_and_1_with_one_in_front_are_told_to_be_bits_perhaps(
    tmp_path: Path, words: list[str], told: bool
) -> None:
    cells = [words[row // 20 % 2] for row in range(len(TIME))]
    run = read(tmp_path, make_status(cells), columns=STATUS)
    np.testing.assert_array_equal(run["status_1"], [float(cell) for cell in cells])
    assert any("the digits 0 and 1 only, and as many: bits" in note for note in run.metadata["import"]["done"]) == told


@pytest.mark.parametrize("words", [["0101", "0102"], ["001", "01"], ["0", "1"], ["0.1", "1.1"]])
def test_other_digits_are_no_bits(tmp_path: Path, words: list[str]) -> None:
    run = read(tmp_path, make_status([words[row // 20 % 2] for row in range(len(TIME))]), columns=STATUS)
    assert not any("bits, perhaps" in note for note in run.metadata["import"]["done"])


def test_states_give_the_numbers_of_bits(tmp_path: Path) -> None:
    columns = STATUS.replace('from = "status"', 'from = "status", states = { "0101" = 5, "0010" = 2 }')
    run = read(tmp_path, make_status(["0101" if row % 20 else "0010" for row in range(len(TIME))]), columns=columns)
    np.testing.assert_array_equal(run["status_1"], [5.0 if row % 20 else 2.0 for row in range(len(TIME))])


def test_a_marked_binary_number_is_not_taken_for_a_hexadecimal_one(tmp_path: Path) -> None:
    refusal = find_refusal(tmp_path, make_status(["0b0101"] * len(TIME)), columns=STATUS)
    assert "holds text, such as '0b0101'; allowed are numbers; set states" in refusal
