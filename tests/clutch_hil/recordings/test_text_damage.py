"""Damaged, ambiguous and huge text files: read with what was left out, or refused with the line and the entry to set."""

import random
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from clutch_hil.recordings.format import open_recording
from protocols.errors import InputError
from tests.clutch_hil.recordings.memory_taken import less_memory_than
from tests.clutch_hil.recordings.text_files import (
    BLOCK,
    FORMS,
    ISO,
    MAP,
    MOST_BYTES,
    MOST_SECONDS,
    ROWS,
    SPEED,
    TIME,
    TORQUE,
    TWO,
    assert_right,
    convert_run,
    find_refusal,
    make_table,
    read,
    write_with_comma,
)  # fmt: skip

# --- what is damaged --------------------------------------------------------------------------------------------------


def damage_line(line: int, text: str) -> str:
    """The recording with another text in a `line`, counted from 1."""
    lines = make_table().splitlines()
    lines[line - 1] = text
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "0.0900,0.1",
            "left out 1 damaged row, the first in line 11 with 2 cells where the others have 3: '0.0900,0.1'",
        ),
        (
            "0.0900,0.1,3,4",
            "left out 1 damaged row, the first in line 11 with 4 cells where the others have 3: '0.0900,0.1,3,4'",
        ),
        ('0.0900,"0.1,27.25', "left out 1 damaged row, the first in line 11 with a quote without its end"),
        ("0.0900,0\0\0\0,27.25", "left out 1 line with zero bytes"),
    ],
)
def test_a_damaged_row_is_left_out_and_told(tmp_path: Path, text: str, message: str) -> None:
    assert message in find_refusal(tmp_path, damage_line(11, text))  # as the rate is not constant without it
    run = read(tmp_path, damage_line(11, text), "resample_hz = 100.0")
    assert message in convert_run(run)
    np.testing.assert_allclose(run["speed_rad_s"], SPEED)  # a straight line


def test_many_damaged_rows_are_another_layout(tmp_path: Path) -> None:
    content = damage_line(11, "1,2\n3,4\n5")
    assert "3 of 62 rows do not fit, first line 11 with 2 cells where the others have 3: '1,2'" in find_refusal(
        tmp_path, content
    )


@pytest.mark.parametrize("word", ["", "NaN", "#N/A", " n/a ", "-", "1.#QNAN", "OVER", "-\u221e", "1.#INF"])
def test_a_cell_without_a_value_counts_as_missing(tmp_path: Path, word: str) -> None:
    content, file = damage_line(11, f"0.0900,{word},27.2500"), 'missing = "over, ---"'
    assert "torque_nm is not a number in row 9" in find_refusal(tmp_path, content, file)
    run = read(tmp_path, content, file + "\nresample_hz = 100.0")
    assert "torque: 1 of 60 cells have no value" in convert_run(run)
    np.testing.assert_allclose(np.delete(run["torque_nm"], 9), np.delete(TORQUE, 9))


def test_a_missing_first_cell_is_no_comment(tmp_path: Path) -> None:
    assert "the time of torque_nm is not a number in row 9" in find_refusal(tmp_path, damage_line(11, "#N/A,0.1,27.25"))


def test_a_last_row_that_was_cut_behind_a_delimiter_is_left_out(tmp_path: Path) -> None:
    """Of numbers with decimals such a row is known by their number; these have none."""
    text = "time,torque,gear\n" + "".join(
        f"{time:.2f},{torque:.4f},4\n" for time, torque in zip(TIME, TORQUE, strict=True)
    )
    run = read(tmp_path, text[:-2], columns=TWO + 'gear_1 = { from = "gear", unit = "1" }\n')
    assert len(run["gear_1"]) == ROWS - 1
    assert "a row that was cut" in convert_run(run)


def test_a_last_row_without_a_value_is_a_row_where_others_have_none(tmp_path: Path) -> None:
    lines = make_table().splitlines()
    lines[-5] = lines[-5].rpartition(",")[0] + ","
    text = "\n".join([*lines[:-1], lines[-1].rpartition(",")[0] + ","])
    run = read(tmp_path, text, "resample_hz = 100.0", TWO)
    assert len(run["time_s"]) == ROWS


@pytest.mark.parametrize("cut", [8, 9, 12, 19])  # in the last number, before it, in the one before, in the time
def test_a_cut_last_line_is_left_out_and_told(tmp_path: Path, cut: int) -> None:
    whole = make_table().rstrip("\n")
    line = whole.splitlines()[-1][:-cut]
    run = read(tmp_path, whole[:-cut])
    assert_right(run, slice(-1))
    assert f"left out line 61 at the end, a row that was cut: {line!r}" in convert_run(run)


@pytest.mark.parametrize(
    ("footer", "what"),
    [
        ("Min,0,1\nMax,1,2\n", "lines 62 to 63 at the end, statistics"),
        ("Mean: 0.3,1\n", "line 62 at the end, no whole rows"),
        ("0.6,1.5\n", "line 62 at the end, a row of 2 cells where the others have 3"),
        (
            "\nPeak,Value\n1,2.5\n2,3.5\n",
            "lines 63 to 65 at the end, a second table, of 2 columns; split the file to read it",
        ),
        ("*** END ***\n", "line 62 at the end, no whole rows"),
        ("\n,0.01,88.75\n", "line 63 at the end, cells below an empty line, such as means"),
        ("\n\n,-1,0.25\n,1,177.25\n", "lines 64 to 65 at the end, cells below an empty line, such as means"),
        ("\n,0.01,88.75\n\nMax,1,177.25\n", "lines 63 to 65 at the end, statistics"),
    ],
)
def test_what_stands_below_the_rows_is_told_as_what_it_is(tmp_path: Path, footer: str, what: str) -> None:
    run = read(tmp_path, make_table() + footer)
    assert_right(run)
    assert f"left out {what}: " in convert_run(run)


def test_lines_of_words_between_the_rows_are_left_out_and_told(tmp_path: Path) -> None:
    """As a program writes them beside its rows; one row of another width would be damage."""
    lines = make_table().splitlines()
    for place in (50, 30, 10):
        lines.insert(place, "1 temperature probe detected.")
    assert_right(read(tmp_path, "\n".join([*lines, ""])))
    told = "left out 3 lines of words, the first is line 11: '1 temperature probe detected.'"
    assert told in convert_run(read(tmp_path, "\n".join([*lines, ""])))
    for place in range(55, 5, -5):
        lines.insert(place, "no sensor")
    assert "13 lines between 60 rows are words, first line 11: 'no sensor'" in find_refusal(
        tmp_path, "\n".join([*lines, ""])
    )


@pytest.mark.parametrize("begin", ["0.2.80V, 0.00A, inf", "8.2500", ",6.2500", "0 0.00A, inf"])
def test_the_rest_of_a_row_with_which_a_log_begins_has_no_names(tmp_path: Path, begin: str) -> None:
    title = "=~=~=~=~=~=~=~=~=~=~=~= PuTTY log 2022.03.27 13:18:46 =~=~=~=~=~=~=~=~=~=~=~="
    numbered = MAP
    for number, name in enumerate(("time", "torque", "speed"), 1):
        numbered = numbered.replace(f'from = "{name}"', f"number = {number}")
    for delimiter in (",", " "):
        table = make_table(delimiter, header="")
        assert_right(read(tmp_path, "\n".join([title, begin.replace(",", delimiter), table]), columns=numbered))
        assert_right(read(tmp_path, f"{title}\n{table}", columns=numbered))


def test_words_between_rows_that_blanks_part_are_left_out_and_told(tmp_path: Path) -> None:
    lines = make_table(" ").splitlines()
    for place in (50, 30):
        lines.insert(place, "Good packet")
    told = "left out 2 lines of words, the first is line 31: 'Good packet'"
    assert told in convert_run(read(tmp_path, "\n".join([*lines, ""])))
    lines[30] = "1 packet"
    told = "left out 1 damaged row, the first in line 31 with 2 cells"
    assert told in convert_run(read(tmp_path, "\n".join([*lines, ""]), "resample_hz = 100.0"))


def test_means_below_the_rows_are_no_row_where_rows_are_counted(tmp_path: Path) -> None:
    """A row without a time would else be one more sample."""
    by_row = MAP.replace('from = "time", unit = "s"', "rate_hz = 100.0")
    assert_right(read(tmp_path, make_table() + "\n,0.01,88.75\n", columns=by_row))
    last_without_time = make_table() + ",0.01,88.75\n"  # a row, as no empty line is between it and the others
    assert len(read(tmp_path, last_without_time, columns=by_row)["time_s"]) == ROWS + 1


def test_of_two_rows_at_one_time_the_last_one_counts(tmp_path: Path) -> None:
    """As OpenModelica writes them, before and after an event."""
    lines = make_table().splitlines()
    before = lines[31].replace(f"{TORQUE[30]:.4f}", "9.0000")
    run = read(tmp_path, "\n".join([*lines[:31], before, *lines[31:], ""]))
    assert_right(run)
    told = "left out 1 row at the time of the row after it, as at an event of a simulation, the first at 0.3 s"
    assert told in convert_run(run)
    coarse = [*lines[:31], *([before] * 4), *lines[31:], ""]
    assert "where a row is there twice, remove one of them" in find_refusal(tmp_path, "\n".join(coarse))


def test_a_last_line_without_end_is_told(tmp_path: Path) -> None:
    assert "line 61 ends without a line end: its last number may be cut" in convert_run(
        read(tmp_path, make_table()[:-1])
    )


def test_zero_bytes_at_the_end_are_told(tmp_path: Path) -> None:
    run = read(tmp_path, make_table() + "\0" * 3000)
    assert_right(run)
    assert "left out the zero bytes at the end" in convert_run(run)


def test_rows_between_names_and_numbers_are_told(tmp_path: Path) -> None:
    run = read(tmp_path, damage_line(2, "0.0000,wait,wait"))
    assert "left out line 2, '0.0000,wait,wait': no row of numbers" in convert_run(run)


@pytest.mark.parametrize(
    ("content", "file", "message"),
    [
        (damage_line(11, "0.0900,broken,27.25"), "",
         "column 'torque' holds 'broken' in line 11, which is no number; correct it"),
        (damage_line(11, '0.0900,"1,5",27.25'), "", "in line 11, which is no number; set decimal or thousands in [file]"),
        (make_table() + make_table(), "", "does not increase in row 60: 0 s after 0.59 s"),
        (make_table(header="time,torque,torque"), "", "has 2 columns 'torque'; select one by `from`: 'torque (column 2)'"),
        (make_table(",", write=write_with_comma), "", "line 1 has 3 names, rows have 6 cells: set delimiter or decimal"),
        (make_table(header="time,torque"), "", "line 1 has 2 names, rows have 3 cells"),
        (
            make_table(";", write=lambda value: f"{1 + abs(value):.3f}".replace(".", ",")), "",
            "cells such as '1,000' can be a fraction or have a mark between thousands; set decimal = ',' or thousands = ','",
        ),
        (
            make_table(times=[f"03/02/2025 {cell[11:]}" for cell in ISO]), "",
            "set time_format = '%d/%m/%Y %H:%M:%S' or '%m/%d/%Y %H:%M:%S' in",
        ),
        (make_table(times=[f"03.02.25 {cell[11:]}" for cell in ISO]), "",
         "does not tell which number is the year; set time_format"),
        (make_table(times=[f"10:{row:02d}" for row in range(ROWS)]), "", "set time_format = '%H:%M' or '%M:%S'"),
        (make_table(times=[*ISO[:9], "2025-02-30T10:11:12", *ISO[10:]]), "",
         "'2025-02-30T10:11:12' in line 11, which is no time"),
        (make_table(times=[*ISO[:9], "", *ISO[10:]]), "", "the time of torque_nm is not a number in row 9"),
        (make_table(times=["x" + cell for cell in ISO]), "", "column 'time' for time_s holds text"),
        (make_table(header="time [s],torque [kN],speed"), "", "torque_nm is in 'kN', which cannot be converted into 'Nm'"),
        (make_table(header="time [s],torque [%],speed"), "", "unit = 'Nm', unit_from = 'map' and scale, in Nm per %"),
        (make_table(), 'delimiter = ";"', "has no rows of numbers; line 61 is '0.5900,-0.3739,177.2500'; set delimiter"),
        (make_table(), 'delimiter = "ab"', "file.delimiter is 'ab'; allowed is one character"),
        (make_table(), 'decimal = ":"', "file.decimal is ':'; allowed are . and ,"),
        (make_table(), 'decimal = ","\nthousands = ","', "file.thousands is ','; allowed are"),
        (make_table(), 'encoding = "klingon"', "file.encoding is 'klingon'; allowed are names such as utf-8"),
        (make_table(), 'encoding = "hex"', "file.encoding is 'hex'"),
        (FORMS["cp1252"][0], 'encoding = "utf-8"', "is not utf-8, as `encoding` in [file] says"),
        (make_table(), "skip_lines = 61", "skip_lines is 61; allowed is below 61, of 61 lines"),
        (make_table(), "skip_lines = -1", "file.skip_lines is -1; allowed is 0 or more"),
        (make_table(), "units_row = 7", "units_row is 7, which is not a line of 3 cells above the rows; such lines are 1"),
        (make_table(times=ISO), 'time_format = "%Q"', "file.time_format is '%Q'; %Q is unknown"),
        (make_table(times=ISO), 'time_format = "%d %H"', "allowed is one of each of %Y %m %d, or none"),
        (make_table(times=ISO), 'time_format = "%d.%m.%Y"', "time_format '%d.%m.%Y' fits no column; the first row is"),
        (make_table(), "raster = 1", "entry file.raster is unknown"),
        ("time,torque,speed\n", "", "has no rows of numbers; line 1 is 'time,torque,speed'"),
        ("nothing but words\n" * 9, "", "has no rows of numbers"),
        ("\n \n\n", "", "has no line of text"),
        ("", "", "is empty"),
        (bytes(600), "", "is of no known format"),
        (bytes(range(256)) * 9, "", "is of no known format"),
        ("1," * 2_000_000, "", "line 1 has more than 1048576 bytes"),
        (",".join("1" * 20_000) + "\n", "", "has 20000 columns; allowed are 10000"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_the_line_and_the_entry_to_set(
    tmp_path: Path, content: str | bytes, file: str, message: str
) -> None:
    assert message in find_refusal(tmp_path, content, file)


@pytest.mark.parametrize(
    ("file", "first"), [('decimal = ","', 1.0), ('thousands = ","', 1000.0)], ids=["decimal", "thousands"]
)
def test_an_ambiguous_mark_is_read_as_the_map_says(tmp_path: Path, file: str, first: float) -> None:
    rows = "".join(f"{1 + row},000;{5 + row},250;{5 + row},125\n" for row in range(ROWS))
    run = read(tmp_path, "time;torque;speed\n" + rows, file)
    assert run["time_s"][1] - run["time_s"][0] == first
    assert run["torque_nm"][0] == pytest.approx(5.25 * first)


@pytest.mark.parametrize(
    ("file", "day"), [('time_format = "%d/%m/%Y"', 86400.0), ('time_format = "%m/%d/%Y"', 31 * 86400.0)]
)
def test_an_ambiguous_date_is_read_as_the_map_says(tmp_path: Path, file: str, day: float) -> None:
    content = "time,torque,speed\n01/01/2025,1,2\n02/01/2025,2,3\n"
    assert "can begin with the day or the month" in find_refusal(tmp_path, content)
    assert read(tmp_path, content, file)["time_s"].tolist() == [0.0, day]


def test_columns_are_asked_for_by_number_where_there_are_no_names(tmp_path: Path) -> None:
    columns = MAP.replace('from = "time"', "number = 1").replace('from = "torque"', "number = 2")
    columns = columns.replace('from = "speed"', "number = 3")
    assert_right(read(tmp_path, make_table(header=""), columns=columns))
    assert_right(read(tmp_path, make_table(), "header = false", columns))
    named = read(
        tmp_path,
        make_table(header="1,2,3"),
        "header = true",
        MAP.replace('"time"', '"1"').replace('"torque"', '"2"').replace('"speed"', '"3"'),
    )
    assert_right(named)
    doubled = read(tmp_path, make_table(header="time,torque,torque"), columns=columns)
    assert_right(doubled)


def test_an_older_map_may_leave_out_the_row_of_units(tmp_path: Path) -> None:
    assert_right(read(tmp_path, make_table(header="time,torque,speed\ns,Nm,rad/s"), "skip_rows = 1"))


# --- bounds -----------------------------------------------------------------------------------------------------------


def test_a_large_file_is_read_in_blocks_and_only_what_is_asked_for(tmp_path: Path) -> None:
    path, rows = tmp_path / "large.csv", 200_000
    line = ",".join(["{0:.3f}", "{0:.3f}", *["1.234567890123"] * 8])
    path.write_text("a,b,c,d,e,f,g,h,i,j\n" + "\n".join(map(line.format, range(rows))), encoding="utf-8")
    assert path.stat().st_size > 5 * BLOCK
    before = pa.total_allocated_bytes()
    tracemalloc.start()
    recording = open_recording(path)
    _, opened = tracemalloc.get_traced_memory()
    (signal,) = recording.read(recording.channels[1:2])
    _, taken = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_array_equal(signal.values, np.arange(rows))
    assert opened < 8 * BLOCK
    assert taken < 8 * BLOCK + 8 * rows
    assert pa.total_allocated_bytes() - before < 8 * BLOCK


def test_a_word_far_down_is_told_by_its_line(tmp_path: Path) -> None:
    lines = ["time,torque,speed", *(f"{row},{row % 7},1.5" for row in range(600_000))]
    lines[3] = "# comments, blank lines and a damaged row before do not disturb the count"
    lines[40_000], lines[90_000], lines[500_000] = "", "1,2", "500000,word,1"
    assert "column 'torque' holds 'word' in line 500001" in find_refusal(tmp_path, "\n".join(lines))


def test_more_rows_than_memory_allows_are_refused_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("protocols.files.bounds.MOST_ROWS", ROWS - 1)
    assert "has 60 rows; allowed are 59" in find_refusal(tmp_path, make_table())


@pytest.mark.parametrize(
    "header",
    [
        "time,torque,speed," + "_" * 200_000,
        "time,torque,speed,a" + " " * 200_000 + "b",
        ";" * 200_000 + "\ntime,torque,speed,x",
    ],
    ids=["long name", "blanks", "delimiters"],
)
def test_long_cells_cost_no_time(tmp_path: Path, header: str) -> None:
    begin = time.perf_counter()
    assert_right(read(tmp_path, make_table(header=header, end=",1")))
    assert time.perf_counter() - begin < MOST_SECONDS


def mutate(content: bytes, random_: random.Random) -> bytes:
    """The content, cut, with bytes changed, lines doubled, taken out or joined, or numbers made huge."""
    for _ in range(random_.randint(1, 3)):
        place, end = sorted(random_.randrange(len(content) + 1) for _ in range(2))
        kind = random_.randrange(7)
        if kind == 0:
            content = content[:end]
        elif kind == 1:
            content = content[:place] + random_.randbytes(random_.randint(1, 9)) + content[place + 4 :]
        elif kind == 2:
            content = content[:place] + content[place : place + 300] * random_.choice([2, 2000]) + content[place:]
        elif kind == 3:
            content = content[:place] + content[place + random_.randint(1, 200) :]
        elif kind == 4:
            content = content.replace(
                random_.choice([b"\n", b",", b".", b"1"]),
                random_.choice([b"", b"\0", b'"', b";", b"9" * 40, b"\r"]),
                random_.choice([1, 5, -1]),
            )
        elif kind == 5:
            content = (
                content[:place]
                + random_.choice([b"9" * 400, b"1e308", b"-1e999", b"\xff\xfe", b"#", b'"', b"\0" * 5000])
                + content[place:]
            )
        else:
            content = content[::-1] if random_.random() < 0.2 else content[place:]
        content = content[: 1 << 22] or b"\n"
    return content


@pytest.mark.parametrize("form", list(FORMS)[::3])
def test_mutated_files_are_read_or_refused_in_bounded_time_and_memory(tmp_path: Path, form: str) -> None:
    content, file = FORMS[form]
    raw = content if isinstance(content, bytes) else content.encode()
    random_ = random.Random(form)
    for _ in range(12):
        mutated = mutate(raw, random_)
        begin = time.perf_counter()
        with less_memory_than(MOST_BYTES):
            try:
                run = read(tmp_path, mutated, file)
            except InputError as error:
                sentence = str(error)
            else:
                sentence = ""
                assert all(np.isfinite(values).all() for values in run.columns.values())
        assert "\n" not in sentence
        assert time.perf_counter() - begin < MOST_SECONDS


def test_memory_that_is_taken_for_a_moment_is_seen() -> None:
    with pytest.raises(AssertionError), less_memory_than(MOST_BYTES):
        np.ones(MOST_BYTES // 8 + (1 << 21)).sum()  # 16 MiB more: what it held before it may take unseen


@pytest.mark.parametrize("names", ["time,gear,torque,speed\n", ""])
def test_a_table_with_other_columns_above_is_told_apart(tmp_path: Path, names: str) -> None:
    """As after a restart of a logger with one channel more: the first half was taken for remarks, and lost."""
    rows = make_table().splitlines()
    half = 1 + ROWS // 2
    below = [row.replace(",", ",7,", 1) for row in rows[half - 10 :]]
    text = "\n".join([*rows[:half], *names.splitlines(), *below, ""])
    sentence = find_refusal(tmp_path, text, columns=MAP if names else MAP.replace('from = "torque"', "number = 3"))
    assert "has two tables: rows of 3 cells from line 2 to 31, of 4 below; set skip_lines = 31 in [file]" in sentence
    if names:
        run = read(tmp_path, text, "skip_lines = 31")
        np.testing.assert_allclose(run["torque_nm"], TORQUE[half - 11 :], atol=1e-12)


def test_a_small_table_above_the_names_is_none(tmp_path: Path) -> None:
    calibration = "".join(f"{k},{2.5 * k}\n" for k in range(9))
    assert_right(read(tmp_path, "Calibration\n" + calibration + make_table()))


@pytest.mark.parametrize("mark", ["#", "# ", "% "])
def test_rows_of_another_channel_below_are_refused(tmp_path: Path, mark: str) -> None:
    head = "{0}CHANNEL:{1}\n{0}CLOCK=10.0mS\n{0}SIZE=60\n{0}UNITS:V\n\n"
    columns = '[columns]\ntime_s = { rate_hz = 100.0 }\nvalve_voltage_v = { number = 1, unit = "V" }\n'
    rows = "".join(f"{value}\n" for value in TORQUE)
    one, other = (head.format(mark, channel) + rows for channel in ("CH1", "CH2"))
    sentence = find_refusal(tmp_path, one + "\n\n" + other, columns=columns)
    assert f"has rows of another channel below '{mark}CHANNEL:CH2' in line 68, above are those of 'CH1'" in sentence
    np.testing.assert_allclose(read(tmp_path, one, columns=columns)["valve_voltage_v"], TORQUE)


def test_a_long_comment_that_names_a_channel_takes_no_time(tmp_path: Path) -> None:
    comment = "#CHANNEL:CH1" + 60_000 * " " + "x"
    begin = time.process_time()
    assert_right(read(tmp_path, f"{comment}\n" + make_table().replace("\n0.1000,", f"\n{comment}\n0.1000,")))
    assert time.process_time() - begin < MOST_SECONDS
