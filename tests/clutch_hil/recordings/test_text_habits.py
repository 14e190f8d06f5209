"""Text files as tools and people write them, in which a column, a row or a factor could be lost in silence."""

import bz2
import gzip
import lzma
import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from clutch_hil.recordings.import_map import load_map
from protocols.errors import InputError
from protocols.files.runs import REQUIRED
from tests.clutch_hil.recordings.text_files import (
    MAP,
    NAMES,
    ROWS,
    SPEED,
    TIME,
    TORQUE,
    assert_right,
    convert_run,
    find_refusal,
    make_table,
    read,
    write_with_comma,
)

FOREIGN = {
    "log.csv.gz": (gzip.compress(make_table().encode()), "compressed by gzip: unpack it with gunzip"),
    "log.csv.bz2": (bz2.compress(make_table().encode()), "compressed by bzip2: unpack it with bunzip2"),
    "log.csv.xz": (lzma.compress(make_table().encode()), "compressed by xz: unpack it with unxz"),
    "log.xlsx": (
        b"PK\x03\x04\x14\x00\x06\x00" + bytes(22) + b"[Content_Types].xml",
        "a spreadsheet: save its data as CSV",
    ),
    "log.zip": (b"PK\x03\x04\x14\x00\x06\x00" + bytes(22) + b"log.csv", "a ZIP archive: unpack it"),
    "log.xls": (bytes.fromhex("d0cf11e0a1b11ae1") + bytes(99), "a file of an older Office: save its data as CSV"),
    "log.npy": (
        b"\x93NUMPY\x01\x00v\x00{'descr': '<f8'}",
        "an array of NumPy: write it into a CSV, Parquet or .mat file",
    ),
    "rows.json": (b'[\n  {"time": 0.0, "torque": 1.0}\n]\n', "JSON: write its numbers into CSV, one row a sample"),
    "columns.json": (
        b'{"time": [0.0, 0.01], "torque": [1.0, 2.0]}',
        "JSON: write its numbers into CSV, one row a sample",
    ),
    "log.tdm": (
        b'<?xml version="1.0"?>\n<usi:tdm version="1.0">',
        "the header of a TDM file: save its channels as TDMS",
    ),
    "log.html": (b"<!DOCTYPE html><table><tr><td>1</td></tr></table>", "XML or HTML: save its data as CSV"),
    "log.famos": (
        b"|CF,2,1,1;|CK,1,3,1,1;\r\n|NO,1,8,0,0,,0,;",
        "a file of imc FAMOS: save its channels as CSV, MDF or TDMS",
    ),
    "log.dat": (
        b"DIAEXTENDED  {@:ENGLISH\n#BEGINGLOBALHEADER\n1,WINDOWS 32Bit\n",
        "the header of a DAT file of DIAdem: save its channels as TDMS",
    ),
    "busmaster.log": (b"***BUSMASTER Ver 3.2.2***\n***PROTOCOL CAN***\n", "a log of BUSMASTER: save its frames as ASC"),
    "savvycan.csv": (
        b"Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2\n0,00000100,false,Rx,0,2,01,02,\n",
        "a log of SavvyCAN: save its frames as ASC, TRC or candump",
    ),
    "python-can.csv": (
        b"timestamp,arbitration_id,extended,remote,error,dlc,data\n1.0,0x100,0,0,0,2,AQI=\n",
        "a log of python-can in CSV: save its frames as ASC, BLF or candump",
    ),
    "canking.txt": (
        b"Chn Identifier Flg   DLC  D0...1...2  Time     Dir\n 0    00000100         2  01  02       1.000000 R\n",
        "a log of Kvaser CanKing: save its frames as ASC or BLF",
    ),
    "log.crtd": (b"1520400000.000000 1R11 100 01 02\n", "a log of OVMS (CRTD): save its frames as candump"),
    "kvaser.csv": (
        b"Kvaser Memorator Log\n====\nTime,Channel,ID,Flags,DLC,Data0,Data1\n0.5,1,100,0,2,01,02\n",
        "a log of Kvaser in CSV: save its frames as ASC or BLF",
    ),
    "frames.csv": (
        b"log of today\nBus,No,Time,ID,DLC,Data0,Data1\n1,1,0.01,256,2,1,2\n",
        "a table of the frames of a bus: save its frames as ASC, BLF or candump",
    ),
    "vehicle-spy.csv": (
        b"Line,Abs Time(Sec),Rel Time (Sec),Status,Network,Node,Arb ID,Remote,Xtd,B1,B2\n1,0.01,0.01,0,HS CAN,,100,F,F,1,2\n",
        "a table of the frames of a bus: save its frames as ASC, BLF or candump",
    ),
    "css.csv": (
        b"TimestampEpoch;BusChannel;ID;IDE;DLC;DataLength;Dir;EDL;BRS;ESI;RTR;DataBytes\n1.5;1;100;0;2;2;0;0;0;0;0;0102\n",
        "a table of the frames of a bus: save its frames as ASC, BLF or candump",
    ),
    "pcan.csv": (
        b"Message Number,Time Offset (ms),Type,ID,Data Length,Data Bytes\n1,1059.9,Rx,0300,2,00 01\n",
        "a table of the frames of a bus: save its frames as ASC, BLF or candump",
    ),
    "reversed.log": (
        b" (1.250000)  can0  100   [8]  88`77`66`55`44`33`22`11\n",
        "a log of candump with its bytes reversed (-S), as bits (-i) or with points between them: record it with candump -L",
    ),
    "bits.log": (
        b" (1.250000)  can0  100   [2]  00000001 11110000\n",
        "a log of candump with its bytes reversed (-S), as bits (-i) or with points between them: record it with candump -L",
    ),
    "lecroy.trc": (
        b"#9000000446WAVEDESC\0\0\0\0\0\0\0\0LECROY_2_3" + bytes(99),
        "a binary waveform of LeCroy or Teledyne: save it as ASCII or CSV",
    ),
    "scope.bin": (b"AG10" + bytes(99), "a binary waveform of Keysight: save it as CSV"),
    "scope.isf": (b":WFMP:NR_P 10000;:WFMP:BYT_N 2;", "a waveform of Tektronix (.isf): save it as CSV"),
    "influx.txt": (
        b"rig,host=a torque=1.5,speed=2i 1796000000000000000\n",
        "line protocol of InfluxDB: export its fields as CSV, a column each",
    ),
    "log.pcap": (b"\xd4\xc3\xb2\xa1\x02\x00\x04\x00", "a capture of packets: save its frames by candump -l"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_a_file_of_another_kind_is_named_and_what_to_do(tmp_path: Path, name: str) -> None:
    content, what = FOREIGN[name]
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"^{re.escape(f'recording {path} cannot be read, as it is {what}')}$"):
        open_recording(path)


@pytest.mark.parametrize(
    "header", ["[General]\n", "[s] [Nm]\n", "<bench 7>\n", "{run 7}\n", "PKW 7\n", "BZ 1\n", "ID 7, Data 3\n"]
)
def test_a_line_above_the_names_is_not_taken_for_another_kind_of_file(tmp_path: Path, header: str) -> None:
    assert_right(read(tmp_path, header + make_table()))


@pytest.mark.parametrize("number", ["-9999", "-9999.000", "1e37"])
def test_a_number_that_stands_for_no_value_counts_as_missing(tmp_path: Path, number: str) -> None:
    lines = make_table().splitlines()
    for row in (20, 21):
        lines[row + 1] = ",".join([lines[row + 1].split(",")[0], number, lines[row + 1].split(",")[2]])
    columns = MAP.replace('"Nm" }', f'"Nm", missing = {number} }}')
    text = "\n".join([*lines, ""])
    assert "torque_nm is not a number in row 20, one of 2 such rows" in find_refusal(tmp_path, text, columns=columns)
    run = read(tmp_path, text, "resample_hz = 100.0", columns)
    assert f"torque: 2 samples of {float(number):g}, which is no value" in convert_run(run)
    bridged = np.interp(TIME, np.delete(TIME, (20, 21)), np.delete(TORQUE, (20, 21)))
    np.testing.assert_allclose(run["torque_nm"], bridged, atol=1e-9)


TWO = '[columns]\ntime_s = { from = "time", unit = "s" }\ntorque_nm = { from = "torque", unit = "Nm" }\n'


def make_rows(header: str, *rows: str) -> str:
    return "\n".join([header, *rows, ""])


# --- delimiters and marks ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "above", ["Start 10:11:12", "Date: 05.03.2024 10:11:12", "T0=05.03.2024 10:11:12\tSR=100 Hz\tx"]
)
def test_a_clock_time_above_the_rows_does_not_part_cells(tmp_path: Path, above: str) -> None:
    rows = [f"{t:.2f}\t{'' if k % 3 else 1}\t{1000 + k}" for k, t in enumerate(TIME)]
    columns = '[columns]\ntime_s = { number = 1, unit = "s" }\nspeed_rad_s = { number = 3, unit = "rad/s" }\n'
    run = read(tmp_path, make_rows(above, *rows), "header = false", columns)
    np.testing.assert_array_equal(run["speed_rad_s"], 1000.0 + np.arange(ROWS))


def test_a_column_that_ends_before_the_others_ends_no_rows(tmp_path: Path) -> None:
    table = make_table("\t", header="time\ttorque\tspeed\ttemp")
    rows = [f"{line}\t{20.5 if k < 20 else ''}" if k else line for k, line in enumerate(table.splitlines())]
    assert_right(read(tmp_path, make_rows("Date: 05.03.2024 10:11:12", *rows)))


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


# --- words among numbers ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", [slice(0, 3), slice(-10, None), slice(-40, None), slice(20, 30)])
def test_a_word_in_a_column_that_nobody_asks_for_takes_no_row(tmp_path: Path, where: slice) -> None:
    words = np.zeros(ROWS, bool)
    words[where] = True
    lines = make_table().splitlines()
    rows = [f"{line},{'OVER' if words[k] else k + 0.5}" for k, line in enumerate(lines[1:])]
    assert_right(read(tmp_path, make_rows("time,torque,speed,aux", *rows)))


@pytest.mark.parametrize("row", [0, 30, ROWS - 1])
def test_a_word_in_a_column_that_is_asked_for_is_an_error_wherever_it_is(tmp_path: Path, row: int) -> None:
    lines = make_table().splitlines()
    cells = lines[row + 1].split(",")
    lines[row + 1] = f"{cells[0]},OVER,{cells[2]}"
    sentence = find_refusal(tmp_path, make_rows(*lines))
    assert f"column 'torque' holds 'OVER' in line {row + 2}" in sentence


def test_a_summary_below_the_rows_is_no_row(tmp_path: Path) -> None:
    run = read(tmp_path, make_table() + "Mean,0.1,2\nMax,1.0,n.a.\n1,of,1 pages\n")
    assert_right(run)
    assert "left out lines 62 to 64 at the end" in convert_run(run)


# --- names above groups, and names again ------------------------------------------------------------------------------


@pytest.mark.parametrize("groups", ["clutch,,motor", "clutch,clutch,motor"], ids=["merged", "repeated"])
def test_a_line_of_groups_above_the_names_is_none_of_names(tmp_path: Path, groups: str) -> None:
    run = read(tmp_path, make_table(header=f"{groups}\n{','.join(NAMES)}"))
    assert_right(run)
    assert f"above the names: {groups}" in convert_run(run)


def test_a_line_that_describes_the_columns_stands_below_the_names(tmp_path: Path) -> None:
    assert_right(read(tmp_path, make_table(header="time,torque,speed\nof the rig,of the clutch,of the motor")))
    twice = make_table(header="time,torque,speed,speed\nof the rig,of the clutch,of the motor,of the brake", end=",1")
    assert_right(read(tmp_path, twice, columns=MAP.replace('from = "speed"', "number = 3")))


@pytest.mark.parametrize(
    "header",
    [
        "time,torque,speed\n,T40B,encoder\n,SN 123,SN 456\ns,Nm,rad/s", "run,clutch,motor\ntime,torque,speed\ns,Nm,rad/s",
        ",1,2\ntime,torque,speed\ns,Nm,rad/s", "0,1,2\ntime,torque,speed",
    ],
    ids=["sensors below", "groups above", "channels above", "numbers above"],
)  # fmt: skip
def test_names_are_found_among_lines_of_sensors_groups_and_channels(tmp_path: Path, header: str) -> None:
    assert_right(read(tmp_path, make_table(header=header)))


HEADERS = {
    "names": "time,torque,speed",
    "names and units": "time,torque,speed\ns,Nm,rad/s",
    "in quotes": '"time","torque","speed"',
    "remarks": "Recorder,bench 7\nSampling,100 Hz\ntime,torque,speed",
    "a mark": "\ufefftime,torque,speed",
}


@pytest.mark.parametrize("name", HEADERS)
def test_names_that_stand_again_between_the_rows_are_left_out(tmp_path: Path, name: str) -> None:
    lines = make_table(header=HEADERS[name]).splitlines()
    count = len(lines) - ROWS
    run = read(tmp_path, make_rows(*lines[: count + 30], *lines[:count], *lines[count + 30 :]))
    assert_right(run)
    message = f"left out {count} lines between the rows that repeat those above them, the first is line {count + 31}"
    assert message in convert_run(run)


def test_other_names_between_the_rows_are_refused(tmp_path: Path) -> None:
    lines = make_table().splitlines()
    text = make_rows(*lines[:31], "time,speed,torque", *lines[31:])
    assert "column 'time' holds 'time' in line 32, which is no number" in find_refusal(tmp_path, text)


def test_a_word_that_also_stands_above_the_rows_is_no_heading_in_a_column_of_words(tmp_path: Path) -> None:
    rows = [f"{'idle' if k < 30 else 'phase'},{t:.2f},{TORQUE[k]}" for k, t in enumerate(TIME)]
    run = read(tmp_path, make_rows("phase,time,torque", *rows), columns=TWO)
    np.testing.assert_array_equal(run["torque_nm"], TORQUE)


def test_segments_of_labview_that_go_on_are_one_recording(tmp_path: Path) -> None:
    lines = make_table("\t", header="time\ttorque\tspeed\tComment").splitlines()
    segment = "Channels\t2\nSamples\t30\t30\nTime\t09:47:{:02d}.10\t09:47:02.10\n***End_of_Header***\t\t\n" + lines[0]
    text = make_rows(segment.format(2), *lines[1:31], "", segment.format(3), *lines[31:])
    assert_right(read(tmp_path, "LabVIEW Measurement\t\n***End_of_Header***\t\n\t\n" + text))


def test_two_recordings_in_one_file_are_refused_where_the_second_begins(tmp_path: Path) -> None:
    sentence = find_refusal(tmp_path, make_table() + make_table())
    assert "does not increase in row 60" in sentence
    assert "repeat those above them, the first is line 62" in sentence


# --- several axes of time ---------------------------------------------------------------------------------------------

SIDE_BY_SIDE = """
[columns]
time_s = { from = "time 1" }
torque_nm = { from = "torque", unit = "Nm" }
speed_rad_s = { from = "speed", unit = "rad/s" }
"""


def make_side_by_side(unit: str = "s", factor: float = 1.0) -> str:
    """Torque at each time, and speed at every second one: a shorter table beside the first, in another `unit`."""
    rows = [
        f"{t:.2f};{TORQUE[k]};" + (f"{factor * TIME[2 * k]:.2f};{SPEED[2 * k]}" if 2 * k < ROWS else ";")
        for k, t in enumerate(TIME)
    ]
    return make_rows(f"time 1 [s];torque;time 2 [{unit}];speed", *rows)


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e3)])
def test_tables_side_by_side_have_each_its_own_time(tmp_path: Path, unit: str, factor: float) -> None:
    run = read(tmp_path, make_side_by_side(unit, factor), "resample_hz = 100.0", SIDE_BY_SIDE)
    assert_right(run, slice(0, ROWS - 1))
    assert "has several axes of time, 'time 1 [s]'" in convert_run(run)


def test_tables_side_by_side_are_not_joined_unasked(tmp_path: Path) -> None:
    sentence = find_refusal(tmp_path, make_side_by_side(), columns=SIDE_BY_SIDE)
    assert "torque_nm and speed_rad_s on different rasters" in sentence


@pytest.mark.parametrize("other", ["time since start [ms]", "Time of flight [s]", "time left [s]", "times"])
def test_a_further_time_of_the_same_rows_is_no_axis(tmp_path: Path, other: str) -> None:
    """In other units, constant, or running back: it is not another clock."""
    value = {"time since start [ms]": lambda t: 1e3 * t + 7.0, "time left [s]": lambda t: 9.0 - t}.get(
        other, lambda t: 0.2
    )
    lines = make_table(header=f"time [s],{other},torque,speed").splitlines()
    rows = [
        f"{line.partition(',')[0]},{value(t):.3f},{line.partition(',')[2]}"
        for t, line in zip(TIME, lines[1:], strict=True)
    ]
    assert_right(read(tmp_path, make_rows(lines[0], *rows)))


# --- dates and epochs -------------------------------------------------------------------------------------------------


def test_a_date_beside_the_time_of_day_is_its_date(tmp_path: Path) -> None:
    rows = [f"05.03.2024;10:11:{12 + k};{k}" for k in range(10)]
    file = tmp_path / "apart.csv"
    file.write_text(make_rows("date;time;torque", *rows), encoding="utf-8")
    recording = open_recording(file)
    assert recording.start == "2024-03-05T10:11:12"
    assert 'time_s = { from = "time" }' in draft_map(file, recording)


def make_two_days(second: str, date: str) -> str:
    """20 rows from 16:00:00 on 5 March, and 20 from the time `second` on, which have the `date`."""
    hour, minute, first = map(int, second.split(":"))
    rows = [f"05.03.2024;16:00:{k:02d};{k}" for k in range(20)]
    return make_rows(
        "date;time;torque", *rows, *(f"{date};{hour:02d}:{minute:02d}:{first + k:02d};{k}" for k in range(20))
    )


@pytest.mark.parametrize(
    ("second", "date", "gap"),
    [
        ("08:00:00", "06.03.2024", 16 * 3600.0), ("16:00:20", "06.03.2024", 86400.0 + 20.0),
        ("16:05:00", "08.03.2024", 3 * 86400.0 + 300.0),
    ],
    ids=["earlier the next day", "later the next day", "days later"],
)  # fmt: skip
def test_days_between_rows_are_those_of_the_dates(tmp_path: Path, second: str, date: str, gap: float) -> None:
    text = make_two_days(second, date)
    columns = TWO + 'speed_rad_s = { from = "torque", unit = "rad/s" }\n'
    (tmp_path / "map.toml").write_text(f"[file]\nlongest_gap_s = 5.0\n{columns}", encoding="utf-8")
    (tmp_path / "days.csv").write_text(text, encoding="utf-8")
    one, other = load_map(str(tmp_path / "map.toml")).read_runs(tmp_path / "days.csv")
    np.testing.assert_array_equal(one["time_s"], np.arange(20.0))
    np.testing.assert_array_equal(other["time_s"], gap + np.arange(20.0))
    assert "time: its days are those of 'date'" in convert_run(one)


@pytest.mark.parametrize("second", ["08:00:00", "17:00:00"], ids=["earlier", "later"])
def test_days_between_rows_of_dates_that_can_be_misread_are_asked_for(tmp_path: Path, second: str) -> None:
    text = make_two_days(second, "03/06/2024").replace("05.03.2024", "03/05/2024")
    assert "set time_format = '%d/%m/%Y' or '%m/%d/%Y' in [file]" in find_refusal(tmp_path, text, columns=TWO)
    run = read(tmp_path, text, 'time_format = "%m/%d/%Y"\nresample_hz = 1.0\nlongest_gap_s = 1e5', TWO)
    assert run["time_s"][-1] == 86400.0 + 3600.0 * (int(second[:2]) - 16) + 19.0


def test_dates_that_can_be_misread_do_not_matter_where_the_clock_passes_midnight(tmp_path: Path) -> None:
    rows = [
        f"03/{5 if k < 10 else 6:02d}/2024;{23 if k < 10 else 0:02d}:{59 if k < 10 else 0:02d}:{(50 + k) % 60:02d};{k}"
        for k in range(20)
    ]
    run = read(tmp_path, make_rows("date;time;torque", *rows), columns=TWO)
    np.testing.assert_array_equal(run["time_s"], np.arange(20.0))


@pytest.mark.parametrize("date", ["05.03.2024", "", "06.03."], ids=["of the start", "of the first rows", "damaged"])
def test_dates_that_tell_no_days_leave_the_clock_alone(tmp_path: Path, date: str) -> None:
    rows = [f"05.03.2024;23:59:{50 + k};{k}" for k in range(10)]
    rows += [f"{date if k == 5 or date != '06.03.' else '06.03.2024'};00:00:{k:02d};{k}" for k in range(10)]
    run = read(tmp_path, make_rows("date;time;torque", *rows), columns=TWO)
    np.testing.assert_array_equal(run["time_s"], np.arange(20.0))


@pytest.mark.parametrize(("ticks", "unit"), [(1_000, "ms"), (1_000_000, "us"), (1_000_000_000, "ns")])
def test_an_epoch_keeps_its_digits(tmp_path: Path, ticks: int, unit: str) -> None:
    step = {"ms": 1, "us": 10, "ns": 10_000}[unit]  # 1 kHz, 100 kHz
    rows = [f"{1709683197 * ticks + step * k},{k}" for k in range(ROWS)]
    run = read(tmp_path, make_rows("time,torque", *rows), columns=TWO.replace(', unit = "s"', ""))
    np.testing.assert_allclose(run["time_s"], step * np.arange(ROWS) / ticks, rtol=1e-14)
    assert run.metadata["import"]["start"] == "2024-03-05T23:59:57+00:00"


@pytest.mark.parametrize(("first", "unit"), [(45356.5, "d"), (3.79e9, "s"), (739_000.5, "d"), (2_460_760.5, "d")])
def test_days_of_a_spreadsheet_and_other_epochs_are_no_date_of_ours(tmp_path: Path, first: float, unit: str) -> None:
    step = 1.0 if unit == "s" else 1.0 / 86400.0
    rows = [f"{first + step * k:.9f},{k}" for k in range(ROWS)]
    run = read(tmp_path, make_rows("time,torque", *rows), columns=TWO.replace('"s"', f'"{unit}"'))
    np.testing.assert_allclose(run["time_s"], np.arange(ROWS), atol=1e-4)
    assert "start" not in run.metadata["import"]


@pytest.mark.parametrize(
    ("first", "message"),
    [
        (45356.5, True),
        (739_000.5, True),
        (60_759.5, True),
        (2_460_760.5, True),
        (0.59, True),
        (45356.5, False),
        (12.5, False),
    ],
)
def test_days_that_are_taken_for_seconds_are_refused(tmp_path: Path, first: float, message: bool) -> None:
    step = 0.1 / 86400.0 if message else 0.1
    rows = [f"{first + step * k:.12f},{k}" for k in range(ROWS)]
    doubt = "'time' counts days of a spreadsheet, perhaps; set unit = 'd' then"
    resampled = f"resample_hz = {0.5 / step}"
    if message:
        assert doubt in find_refusal(tmp_path, make_rows("time,torque", *rows), resampled, TWO)
    sure = TWO.replace('unit = "s"', 'unit = "s", unit_from = "map"')
    done = convert_run(read(tmp_path, make_rows("time,torque", *rows), resampled, sure))
    assert (doubt in done) is message


@pytest.mark.parametrize("first", [0.0, -0.3, 1e-5])
def test_a_fast_recording_that_begins_near_its_trigger_is_in_seconds(tmp_path: Path, first: float) -> None:
    rows = [f"{first + 1e-6 * k:.9f},{k}" for k in range(ROWS)]
    assert "days" not in convert_run(read(tmp_path, make_rows("time,torque", *rows), columns=TWO))


def test_ms_since_1970_are_not_taken_for_seconds(tmp_path: Path) -> None:
    rows = [f"{1709683197000 + 10 * k},{k}" for k in range(ROWS)]
    columns = TWO.replace('unit = "s"', 'unit = "s", unit_from = "map"')
    sentence = find_refusal(tmp_path, make_rows("time,torque", *rows), columns=columns)
    assert "begins at 1.70968e+12 s, which no clock shows" in sentence


# --- no time at all ---------------------------------------------------------------------------------------------------

BY_ROW = '[columns]\ntime_s = { rate_hz = 100.0 }\ntorque_nm = { from = "torque", unit = "Nm" }\n'


def test_rows_at_a_stated_rate_need_no_column_of_time(tmp_path: Path) -> None:
    run = read(tmp_path, make_rows("torque,p", *(f"{q},1" for q in TORQUE)), columns=BY_ROW)
    np.testing.assert_allclose(run["time_s"], TIME, rtol=1e-12)
    np.testing.assert_array_equal(run["torque_nm"], TORQUE)
    assert "time_s is the number of the row over 100 Hz" in convert_run(run)


def test_a_time_too_coarse_to_increase_is_told_with_the_way_out(tmp_path: Path) -> None:
    table = make_rows("time,torque", *(f"{t:.1f},{q}" for t, q in zip(TIME, TORQUE, strict=True)))
    assert "where the rows are evenly spaced, time_s = { rate_hz = ... }" in find_refusal(tmp_path, table, columns=TWO)
    np.testing.assert_array_equal(read(tmp_path, table, columns=BY_ROW)["torque_nm"], TORQUE)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (BY_ROW.replace("100.0", "0.0"), "time_s.rate_hz is 0; allowed is above 0"),
        (BY_ROW.replace("100.0", "-1.0"), "time_s.rate_hz is -1; allowed is above 0"),
        (BY_ROW.replace("100.0", "1e12"), "time_s.rate_hz is 1e+12; allowed is above 0"),
        (BY_ROW.replace("100.0", '100.0, unit = "s"'), "it is allowed only as the single entry of time_s"),
        (BY_ROW.replace('from = "torque", unit = "Nm"', "rate_hz = 5.0"), "torque_nm has rate_hz"),
        ("[columns]\ntime_s = { rate_hz = 100.0 }\n", "has no column except time_s"),
    ],
)
def test_a_wrong_rate_of_rows_is_refused(tmp_path: Path, columns: str, message: str) -> None:
    assert message in find_refusal(tmp_path, make_rows("torque,p", "1,2", "2,3", "3,4"), columns=columns)


def test_a_draft_makes_no_time_of_another_column(tmp_path: Path) -> None:
    file = tmp_path / "no time.csv"
    file.write_text(make_rows("position [mm],torque [Nm]", "0,1", "2,3", "4,5"), encoding="utf-8")
    draft = draft_map(file, open_recording(file))
    assert "\ntime_s" not in draft
    assert '# time_s = { from = ""' in draft
    assert 'position_m = { from = "position" }' in draft


def test_a_draft_names_the_columns_of_a_wet_clutch_that_it_lacks(tmp_path: Path) -> None:
    file = tmp_path / "rig.csv"
    file.write_text(make_rows("time [s],clutch torque [Nm]", "0,1", "1,3", "2,5"), encoding="utf-8")
    draft = draft_map(file, open_recording(file))
    assert 'clutch_torque_nm = { from = "clutch torque" }' in draft
    *_, names, instead = draft.splitlines()
    assert "formula" in instead
    lacking = names.removeprefix("# ").split(", ")
    assert lacking == [name for name in REQUIRED if name not in ("time_s", "clutch_torque_nm")]
    tomllib.loads(draft)


# --- tools ------------------------------------------------------------------------------------------------------------


def test_labview_gives_rows_no_cell_for_the_last_name(tmp_path: Path) -> None:
    header = "LabVIEW Measurement\t\nDate\t2024/03/05\nTime\t09:47:02.1010842323\n***End_of_Header***\t\n\t\n"
    header += "Channels\t1\t\nY_Unit_Label\tVolts\t\nDelta_X\t0.01\t\n***End_of_Header***\t\t\n"
    assert_right(read(tmp_path, header + make_table("\t", header="time\ttorque\tspeed\tComment")))


def test_catman_writes_a_line_of_entries_below_the_names(tmp_path: Path) -> None:
    above = "HBM_CATMAN_DATAFILE_VERSION 5.0\n\nDATE=05.03.2024 10:11:12\nSEPARATOR=9\n"
    names = "time\ttorque\tspeed\nT0=05.03.2024 10:11:12\tSR=100 Hz\tSR=100 Hz\ns\tNm\trad/s"
    assert_right(read(tmp_path, above + make_table("\t", header=names, write=write_with_comma)))


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


@pytest.mark.parametrize("names", ["X_Value,torque,X_Value,speed", "t1,torque,t2,speed", "X,torque,X,speed"])
def test_two_tables_whose_times_tell_no_unit_are_not_put_on_one_time(tmp_path: Path, names: str) -> None:
    rows = [f"{0.01 * n:.2f},{n},{0.02 * n:.2f},{n}" for n in range(60)]
    both = '[columns]\ntime_s = { number = 1, unit = "s" }\ntorque_nm = { number = 2, unit = "Nm" }\n'
    text = make_rows(names, *rows)
    assert "both rise, and differently, as times of two tables beside each other do" in find_refusal(
        tmp_path, text, columns=both + 'speed_rad_s = { number = 4, unit = "rad/s" }\n'
    )
    assert read(tmp_path, text, columns=both)["time_s"][1] == pytest.approx(0.01)
    second = '[columns]\ntime_s = { number = 3, unit = "s" }\nspeed_rad_s = { number = 4, unit = "rad/s" }\n'
    assert read(tmp_path, text, columns=second)["time_s"][1] == pytest.approx(0.02)
    with_units = make_rows(names, "s,Nm,s,rad/s", *rows)
    run = read(tmp_path, with_units, "resample_hz = 50.0", both + "speed_rad_s = { number = 4 }\n")
    assert run["speed_rad_s"][10] == pytest.approx(run["time_s"][10] / 0.02, abs=1e-6)


def test_turns_a_minute_may_be_written_without_what_is_counted(tmp_path: Path) -> None:
    rows = [f"{0.01 * n:.2f},{n}" for n in range(60)]
    text = make_rows("time,N_DYNO", "s,1/min", *rows)
    columns = '[columns]\ntime_s = { from = "time" }\nslip_speed_rad_s = { from = "N_DYNO" }\n'
    assert "set unit = 'rpm' where these are turns a minute" in find_refusal(tmp_path, text, columns=columns)
    run = read(tmp_path, text, columns=columns.replace('"N_DYNO" }', '"N_DYNO", unit = "rpm" }'))
    assert run["slip_speed_rad_s"][30] == pytest.approx(np.pi)


@pytest.mark.parametrize(
    "words", [("on", "off"), ("WAHR", "FALSCH"), ("ein", "aus"), ("Ja", "Nein"), ("VRAI", "FAUX"), ("oui", "non")]
)
def test_flags_of_other_languages_are_a_status(tmp_path: Path, words: tuple[str, str]) -> None:
    rows = [f"{0.01 * k:.2f};{words[0] if k < 30 else words[1]}" for k in range(ROWS)]
    columns = '[columns]\ntime_s = { from = "time", unit = "s" }\nvalve_1 = { from = "valve", unit = "1" }\n'
    run = read(tmp_path, make_rows("time;valve", *rows), columns=columns)
    np.testing.assert_array_equal(run["valve_1"], np.arange(ROWS) < 30)


@pytest.mark.parametrize("mark", [".", ","])
def test_a_sign_that_stands_apart_is_one(tmp_path: Path, mark: str) -> None:
    """As loggers of Graphtec write."""
    table = make_table(";", write=lambda value: f"{'-' if value < 0.0 else '+'} {abs(value):9.4f}".replace(".", mark))
    assert_right(read(tmp_path, table))


@pytest.mark.parametrize(
    "write",
    [lambda t: f"1 days {t}", lambda t: f'"1 day, {t}"', lambda t: f"{t}"],
    ids=["of pandas", "of Python", "without days"],
)
def test_durations_of_python_are_times(tmp_path: Path, write: Callable[[str], str]) -> None:
    times = [write(f"23:59:59.{700000 + round(1e6 * t)}") if t < 0.295 else "" for t in TIME]
    times = [
        cell or f"{2 if 'day' in times[0] else 0} days 00:00:00.{round(1e6 * t) - 300000:06d}"
        for cell, t in zip(times, TIME, strict=True)
    ]
    assert_right(read(tmp_path, make_table(times=times)))


def test_text_in_a_column_is_shown_with_what_to_do(tmp_path: Path) -> None:
    text = make_rows("time,torque", *(f"2024-03-31_01h59m{n:02d}s,{n}" for n in range(60)))
    message = find_refusal(tmp_path, text, columns=TWO)
    assert "such as '2024-03-31_01h59m00s'" in message
    assert "set time_format in [file]" in message


def test_a_scale_of_zero_is_refused(tmp_path: Path) -> None:
    columns = TWO.replace('"Nm" }', '"Nm", scale = 0 }')
    assert "torque_nm.scale is 0; allowed is any other number" in find_refusal(tmp_path, make_table(), columns=columns)


def test_true_and_false_need_no_unit(tmp_path: Path) -> None:
    rows = [f"{0.01 * k:.2f},{'TRUE' if k % 2 else 'FALSE'}" for k in range(ROWS)]
    columns = '[columns]\ntime_s = { from = "time", unit = "s" }\nenabled_1 = { from = "on" }\n'
    run = read(tmp_path, make_rows("time,on", *rows), columns=columns)
    np.testing.assert_array_equal(run["enabled_1"], np.arange(ROWS) % 2)
