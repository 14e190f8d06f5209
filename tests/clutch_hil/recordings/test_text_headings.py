"""Lines above the rows of text files of tools: labels before units, units far above the names, statistics below them."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.channel import choose_channel
from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from protocols.errors import InputError
from tests.clutch_hil.recordings.maps import find_refusal, import_by
from tests.clutch_hil.recordings.text_files import NAMES, ROWS, SPEED, TIME, TORQUE, assert_right, make_table, read

RPM = np.pi / 30.0  # rad/s

LABVIEW = """LabVIEW Measurement\t
Separator\tTab
X_Columns\tOne
***End_of_Header***\t
Channels\t2\t\t
Samples\t60\t60\t
Y_Unit_Label\tNm\trpm\t
X_Dimension\tTime\tTime\t
X0\t0.0000E+0\t0.0000E+0\t
Delta_X\t0.010000\t0.010000\t
***End_of_Header***\t\t\t
X_Value\ttorque\tspeed\tComment
"""
OSCILLOSCOPE = """Model,MSO24
Horizontal Scale,0.1
Vertical Units,Nm,rpm,
Vertical Offset,0,
Labels,Clutch,Motor,
TIME,torque,speed
"""
STATISTICS = """time;torque;speed
s;Nm;rpm
Min;0;0.5;
Maximum;1;200
Mean;0.5;100
"""
CONTROLDESK = """path;;Model Root/Clutch;Model Root/Motor
name;time;torque;speed
unit;s;Nm;rpm
trace_values
"""
CHANNELS = """Operator;speed;fast

Channel;Name;Unit
1;time;s
2;torque;Nm
3;speed;[rpm]

time;torque;speed
"""
LABELLED = "# units: s, Nm, rpm\ntime,torque,speed\n"
JAPANESE = "時間;トルク;回転数\n秒;N・m;rpm\n"
HIOKI = """Trigger Time,today
CH,torque[Nm],speed[rpm]
Mode,Voltage,Voltage
Range,10V,10V
Time,torque[Nm],speed[rpm]
"""
INSPECTOR = "time,torque,speed\n,Type: double,Type: double\n,Units: Nm,Units: rpm\n,Interp: linear,Interp: linear\n"
YOKOGAWA = """"Header Size"           ,9
"BlockNumber"           ,1               ,1
"TraceName"             ,"torque        ","speed         "
"BlockSize"             ,60              ,60
"VUnit"                 ,"Nm            ","rpm           "
"SampleRate"            ,100.0           ,100.0
"HUnit"                 ,"s             ","s             "
"Date"                  ,"2019/11/26","2019/11/26"
"Time"                  ,"12:33:56.100895200    ","12:33:56.100895200    "

"""
BARE_LABVIEW = """***End_of_Header***\t
Channels\t2\t\t
Y_Unit_Label\tNm\trpm\t
X_Dimension\tTime\tTime\t
Delta_X\t1.000000\t1.000000\t
***End_of_Header***\t\t\t
X_Value\ttorque\tspeed\tComment
"""
KEYSIGHT = "x-axis,1,2\nsecond,Nm,rpm\n"
# Lines above -> mark between cells, lead of each row, names of time, torque and speed
FORMS = {
    "LabVIEW": (LABVIEW, "\t", "", ("X_Value", "torque", "speed")),
    "an oscilloscope": (OSCILLOSCOPE, ",", "", ("TIME", "torque", "speed")),
    "Yokogawa": (YOKOGAWA, ",", "", ("TraceName", "torque", "speed")),
    "LabVIEW, numbers that are no units": (BARE_LABVIEW, "\t", "", ("X_Value", "torque", "speed")),
    "commas between names, blanks between cells": ("time [s], torque [Nm], speed [rpm]\n", "  ", "", NAMES),
    "statistics": (STATISTICS, ";", "", ("time", "torque", "speed")),
    "ControlDesk": (CONTROLDESK, ";", ";", ("time", "torque", "speed")),
    "a list of channels": (CHANNELS, ";", "", ("time", "torque", "speed")),
    "units behind a word": (LABELLED, ",", "", ("time", "torque", "speed")),
    "statistics of channels": (HIOKI, ",", "", ("Time", "torque", "speed")),
    "a label in each cell": (INSPECTOR, ",", "", ("time", "torque", "speed")),
    "numbers of channels": (KEYSIGHT, ",", "", ("x-axis", "1", "2")),
    "Japanese": (JAPANESE, ";", "", ("時間", "トルク", "回転数")),
}


def write(tmp_path: Path, kind: str) -> tuple[Path, tuple[str, str, str]]:
    above, mark, lead, names = FORMS[kind]
    cells = zip(TIME, TORQUE, SPEED, strict=True)
    rows = [lead + mark.join(f"{value:.4f}" for value in row) for row in cells]
    path = tmp_path / "recording.csv"
    path.write_text(above + "\n".join([*rows, ""]), encoding="utf-8")
    return path, names


@pytest.mark.parametrize("kind", FORMS)
def test_names_and_units_are_found_where_tools_write_them(tmp_path: Path, kind: str) -> None:
    path, (time, torque, speed) = write(tmp_path, kind)
    columns = f"""
        [columns]
        time_s = {{ from = "{time}", unit = "s" }}
        torque_nm = {{ from = "{torque}" }}
        speed_rad_s = {{ from = "{speed}" }}
    """
    run = import_by(tmp_path, path, columns)
    assert len(run["time_s"]) == ROWS
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["torque_nm"], TORQUE, rtol=1e-12)
    np.testing.assert_allclose(run["speed_rad_s"], RPM * SPEED, rtol=1e-12)


# X_Value is no name of a time, and one file tells no unit of it that a draft could take
@pytest.mark.parametrize("kind", [kind for kind in FORMS if kind not in ("LabVIEW", "statistics of channels")])
def test_a_draft_leaves_out_empty_columns_and_imports(tmp_path: Path, kind: str) -> None:
    path, _ = write(tmp_path, kind)
    draft = draft_map(path, open_recording(path))
    assert ("# left out, with no value in the first and last rows: name\n" in draft) == (kind == "ControlDesk")
    run = import_by(tmp_path, path, draft)
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)


def write_rows(tmp_path: Path, above: str, mark: str, *columns: Sequence[str]) -> Path:
    path = tmp_path / "recording.csv"
    rows = [mark.join(row) for row in zip(*columns, strict=True)]
    path.write_text(above + "\n".join([*rows, ""]), encoding="utf-8")
    return path


def format_all(values: Iterable[float], spec: str = ".4f") -> list[str]:
    return [format(value, spec) for value in values]


TWINCAT = """Name\tScope Project

Name\ttorque\tName\tspeed
Data-Type\tREAL64\tData-Type\tREAL64
SampleTime[ms]\t10\tSampleTime[ms]\t10
Unit\tkNm\tUnit\trpm
ScaleFactor\t1\tScaleFactor\t1
BitMask\t0xff\tBitMask\t0xff

"""


def test_labels_before_each_cell_name_the_columns(tmp_path: Path) -> None:
    times = format_all(1e3 * TIME)
    path = write_rows(tmp_path, TWINCAT, "\t", times, format_all(TORQUE), times, format_all(SPEED))
    columns = """
        [columns]
        time_s = { number = 1, unit = "ms" }
        torque_nm = { from = "torque" }
        speed_rad_s = { from = "speed" }
    """
    run = import_by(tmp_path, path, columns)
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["torque_nm"], 1e3 * TORQUE, rtol=1e-12)
    np.testing.assert_allclose(run["speed_rad_s"], RPM * SPEED, rtol=1e-12)
    assert "by the file SampleTime[ms] is 0.01 s; set unit = 'ms'" in find_refusal(
        tmp_path, path, columns.replace('"ms"', '"s"')
    )


def test_a_label_before_names_far_above_the_rows_is_found(tmp_path: Path) -> None:
    above = '"Model","DL850"\n"TraceName","torque","speed"\n"BlockSize",60,60\n"VUnit","kNm","rpm"\n"SampleRate",100,100\n\n'
    path = write_rows(tmp_path, above, ",", [""] * ROWS, format_all(TORQUE), format_all(SPEED))
    columns = (
        '[columns]\ntime_s = { rate_hz = 100.0 }\ntorque_nm = { from = "torque" }\nspeed_rad_s = { from = "speed" }\n'
    )
    run = import_by(tmp_path, path, columns)
    np.testing.assert_allclose(run["torque_nm"], 1e3 * TORQUE, rtol=1e-12)
    np.testing.assert_allclose(run["speed_rad_s"], RPM * SPEED, rtol=1e-12)


def test_a_label_in_the_first_row_takes_no_row_away(tmp_path: Path) -> None:
    labels = ["trace_values", *[""] * (ROWS - 1)]
    above = "trace_names,time,torque,speed\nunits,s,Nm,rpm\n"
    path = write_rows(tmp_path, above, ",", labels, format_all(TIME), format_all(TORQUE), format_all(SPEED))
    run = import_by(tmp_path, path, PLAIN)
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)


def test_a_remark_in_the_first_row_before_times_of_day_takes_no_row_away(tmp_path: Path) -> None:
    remarks = ["start", *[""] * (ROWS - 1)]
    clock = [f"10:11:{12.0 + t:06.3f}" for t in TIME]
    path = write_rows(tmp_path, "remark,torque,time\n", ",", remarks, format_all(-TORQUE), clock)
    run = import_by(tmp_path, path, PLAIN.replace(', unit = "s"', ""))
    np.testing.assert_allclose(run["torque_nm"], -TORQUE, rtol=1e-12)


PLAIN = '[columns]\ntime_s = { from = "time", unit = "s" }\ntorque_nm = { from = "torque", unit = "Nm" }\n'


@pytest.mark.parametrize(("quote", "mark"), [('"', " "), ("", " "), ('"', ";")])
def test_names_of_rows_need_no_name_themselves(tmp_path: Path, quote: str, mark: str) -> None:
    above = (
        mark.join(f"{quote}{name}{quote}" for name in ("time", "torque", "shaft speed" if quote else "speed")) + "\n"
    )
    counts = [f"{quote}{row + 1}{quote}" for row in range(ROWS)]
    path = write_rows(tmp_path, above, mark, counts, format_all(TIME), format_all(TORQUE), format_all(SPEED))
    run = import_by(tmp_path, path, PLAIN)
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["torque_nm"], TORQUE, rtol=1e-12)


@pytest.mark.parametrize("first", ["count", "Sample No.", "nr [-]", "Messpunkt"])
def test_a_name_of_rows_is_not_put_above_the_next_column(tmp_path: Path, first: str) -> None:
    """Where a file names all columns but the last one, R would name all but the first."""
    path = tmp_path / "recording.csv"
    cells = enumerate(zip(TORQUE, SPEED, strict=True), 1)
    path.write_text(
        "\n".join([f"{first};torque;speed", *(f"{n};{torque:.4f};{speed:.4f};7" for n, (torque, speed) in cells)])
    )
    columns = '[columns]\ntime_s = { rate_hz = 100.0 }\ntorque_nm = { from = "torque", unit = "Nm" }\n'
    assert "line 1 has 3 names, rows have 4 cells" in find_refusal(tmp_path, path, columns)


@pytest.mark.parametrize("header", ["count [-];torque;speed", "count;torque;speed\n-;Nm;rad/s"])
def test_names_stay_above_their_columns_where_each_row_ends_with_a_mark(tmp_path: Path, header: str) -> None:
    path = tmp_path / "recording.csv"
    cells = enumerate(zip(TORQUE, SPEED, strict=True), 1)
    path.write_text("\n".join([header, *(f"{n};{torque:.4f};{speed:.4f};" for n, (torque, speed) in cells), ""]))
    run = import_by(
        tmp_path,
        path,
        '[columns]\ntime_s = { rate_hz = 100.0 }\ntorque_nm = { from = "torque", unit = "Nm" }\n'
        'speed_rad_s = { from = "speed", unit = "rad/s" }\n',
    )
    np.testing.assert_allclose(run["torque_nm"], TORQUE)
    np.testing.assert_allclose(run["speed_rad_s"], SPEED)


def test_lines_of_fewer_cells_above_the_names_have_none_of_them(tmp_path: Path) -> None:
    counts = [str(row + 1) for row in range(ROWS)]
    above = "CH,CH1,CH2\nName,clutch,motor\nUnit,kNm,rpm\nNo.,time,torque,speed\n"
    path = write_rows(tmp_path, above, ",", counts, format_all(TIME), format_all(TORQUE), format_all(SPEED))
    np.testing.assert_allclose(import_by(tmp_path, path, PLAIN)["torque_nm"], TORQUE, rtol=1e-12)


@pytest.mark.parametrize(("above", "first"), [("No.,time,torque\n", 1), ("time,torque,speed\n", 5)])
def test_a_name_too_few_is_refused_elsewhere(tmp_path: Path, above: str, first: int) -> None:
    counts = [str(first + row) for row in range(ROWS)]
    path = write_rows(tmp_path, above, ",", counts, format_all(TIME), format_all(TORQUE), format_all(SPEED))
    assert "line 1 has 3 names, rows have 4 cells" in find_refusal(tmp_path, path, PLAIN)


@pytest.mark.parametrize(("label", "sentence"), [("Factor", "the file states Factor = 0.1 of it"), ("Range", "")])
def test_factors_in_a_line_above_whole_numbers_are_asked_about(tmp_path: Path, label: str, sentence: str) -> None:
    above = f"{label},0.1,1\ntime,torque,speed\ns,Nm,rpm\n"
    path = write_rows(tmp_path, above, ",", format_all(TIME), format_all(range(ROWS), "d"), format_all(SPEED))
    if sentence:
        assert sentence in find_refusal(tmp_path, path, PLAIN)
        scaled = import_by(tmp_path, path, PLAIN.replace('"Nm" }', '"Nm", scale = 0.1 }'))["torque_nm"]
        np.testing.assert_allclose(scaled, 0.1 * np.arange(ROWS), rtol=1e-12)
    else:
        np.testing.assert_array_equal(import_by(tmp_path, path, PLAIN)["torque_nm"], np.arange(ROWS))


@pytest.mark.parametrize(
    ("above", "names", "units"),
    [
        (
            "Sample Interval,0.01\nHorizontal Units,s\nModel Number,SDS1104\nSecond,Value\n",
            ["Second", "Value"],
            ["", ""],
        ),
        ("Model,TBS1102\nHorizontal Units,s\nVertical Units,V\nTIME,CH1\n", ["TIME", "CH1"], ["", "V"]),
        ("Unit,kNm\nTime,Torque\n", ["Time", "Torque"], ["", "kNm"]),
        ("Time,Torque\nUnit,kNm\n", ["Time", "Torque"], ["", "kNm"]),
    ],
)
def test_units_of_an_axis_do_not_take_the_place_of_names(
    tmp_path: Path, above: str, names: list[str], units: list[str]
) -> None:
    recording = open_recording(write_rows(tmp_path, above, ",", format_all(TIME), format_all(TORQUE)))
    assert [channel.name for channel in recording.channels] == names
    assert [channel.unit for channel in recording.channels] == units


def test_the_unit_of_time_is_not_that_of_all_columns(tmp_path: Path) -> None:
    above = '"TraceName","torque","speed"\n"VUnit","kNm","rpm"\n"SampleRate",100,100\n"HUnit","s","s"\n"Date","2025/03/25"\n\n'
    path = write_rows(tmp_path, above, ",", [""] * ROWS, format_all(TORQUE), format_all(SPEED))
    channels = open_recording(path).channels
    assert {channel.name: channel.unit for channel in channels}.items() >= {"torque": "kNm", "speed": "rpm"}.items()


def test_the_unit_of_a_column_without_a_name_is_found(tmp_path: Path) -> None:
    path = write_rows(tmp_path, "in s,CH1 in V\n", ",", format_all(TIME), format_all(TORQUE))
    assert [(c.name, c.unit) for c in open_recording(path).channels] == [("in s", "s"), ("CH1", "V")]
    assert '\ntime_s = { from = "in s" }' in draft_map(path, open_recording(path))


def test_a_table_that_lies_on_its_side_is_told(tmp_path: Path) -> None:
    path = tmp_path / "lying.csv"
    rows = (("time [s]", TIME), ("torque [Nm]", TORQUE), ("speed [rad/s]", SPEED))
    path.write_text("".join(f"{name},{','.join(format_all(values))}\n" for name, values in rows))
    sentence = find_refusal(tmp_path, path, '[columns]\ntime_s = { from = "time" }\ntorque_nm = { from = "torque" }\n')
    assert f"lies on its side: line 1 has 'time [s]' and then {ROWS} numbers; turn it" in sentence


def test_a_short_recording_of_labview_without_times_is_parted_by_its_tabs_and_has_its_rate(tmp_path: Path) -> None:
    above = "".join(
        f"{key}\t{value}\n" for key, value in (("Writer_Version", 2), ("Reader_Version", 2), ("Operator", "x"))
    )
    above += "***End_of_Header***\t\n\t\nSamples\t60\t60\t\nY_Unit_Label\tkNm\trpm\t\nDelta_X\t0.010000\t0.010000\t\n"
    above += "***End_of_Header***\t\t\t\nX_Value\ttorque\tspeed\tComment\n"
    path = write_rows(tmp_path, above, "\t", [""] * ROWS, format_all(TORQUE), format_all(SPEED))
    columns = '[columns]\ntime_s = { rate_hz = 100.0 }\ntorque_nm = { from = "torque" }\n'
    np.testing.assert_allclose(import_by(tmp_path, path, columns)["torque_nm"], 1e3 * TORQUE, rtol=1e-12)
    sentence = find_refusal(tmp_path, path, columns.replace("100.0", "1000.0"))
    assert "by the file the rate is another one: Delta_X is 0.01 s" in sentence


def test_a_name_with_two_blanks_is_found_as_the_file_has_it(tmp_path: Path) -> None:
    path = write_rows(
        tmp_path, "Time  1 - default sample rate [s]\ttorque [Nm]\n", "\t", format_all(TIME), format_all(TORQUE)
    )
    columns = '[columns]\ntime_s = { from = "Time  1 - default sample rate" }\ntorque_nm = { from = "torque" }\n'
    np.testing.assert_allclose(import_by(tmp_path, path, columns)["time_s"], TIME, atol=1e-12)


def test_units_behind_their_label_are_units_also_where_half_are_unknown(tmp_path: Path) -> None:
    head = LABVIEW.replace("rpm", "turns of a crank")
    path = write_rows(tmp_path, head, "\t", format_all(TIME), format_all(TORQUE), format_all(SPEED))
    assert [channel.unit for channel in open_recording(path).channels[1:]] == ["Nm", "turns of a crank"]


def test_several_times_of_labview_are_seconds(tmp_path: Path) -> None:
    """Which `X_Dimension` says: the columns that are called X_Value have no unit."""
    head = (
        "LabVIEW Measurement\t\nX_Columns\tMulti\n***End_of_Header***\t\nChannels\t2\t\t\t\nY_Unit_Label\tNm\t\trpm\t\n"
    )
    head += "X_Dimension\tTime\t\tTime\t\n***End_of_Header***\t\t\t\t\nX_Value\ttorque\tX_Value\tspeed\tComment\n"
    columns = [format_all(values) for values in (TIME, TORQUE, 2.0 * TIME, SPEED)]
    path = write_rows(tmp_path, head, "\t", *columns)
    recording = open_recording(path)
    torque, speed = (choose_channel(path, recording.channels, name) for name in ("torque", "speed"))
    for signal, spread in zip(recording.read([torque, speed]), (1.0, 2.0), strict=True):
        assert signal.time is not None
        np.testing.assert_allclose(signal.time, spread * TIME, atol=1e-12)


@pytest.mark.parametrize("index", ["time", "time [ms]"])
def test_the_name_of_an_index_is_in_a_line_below_the_names(tmp_path: Path, index: str) -> None:
    """As pandas writes it where the columns have two levels of names."""
    path = write_rows(
        tmp_path, f",torque,speed\n,kNm,rpm\n{index},,\n", ",", format_all(TIME), format_all(TORQUE), format_all(SPEED)
    )
    recording = open_recording(path)
    told = [(channel.name, channel.unit) for channel in recording.channels]
    assert told == [("time", "ms" if "ms" in index else ""), ("torque", "kNm"), ("speed", "rpm")]


def test_a_name_of_the_row_may_be_a_number_sign(tmp_path: Path) -> None:
    """As Owon writes it: the line of names was taken for a comment, and the settings above it for names."""
    rows = "".join(f"{row},{torque:.4f}\n" for row, torque in enumerate(TORQUE))
    path = tmp_path / "recording.csv"
    path.write_text(f"Unit:(mV)\n,CH1\nFrequency,F=1.0kHz\nSample Interval,10ms\n#,torque(mNm)\n{rows}")
    columns = '[columns]\ntime_s = { rate_hz = 100.0 }\ntorque_nm = { from = "torque" }\n'
    np.testing.assert_allclose(import_by(tmp_path, path, columns)["torque_nm"], 1e-3 * TORQUE, atol=1e-12)


def test_settings_beside_the_first_rows_take_no_row_away(tmp_path: Path) -> None:
    """As Tektronix writes them, TDS 1000 and 2000."""
    settings = ["Record Length,6.0E+01", "Sample Interval,1.0E-02", "Source,CH1", "Pt Fmt,Y", "Yzero,0.0E+00"]
    cells = zip([*settings, *[","] * (ROWS - len(settings))], TIME, TORQUE, strict=True)
    path = tmp_path / "recording.csv"
    path.write_text("".join(f"{setting},,{time:016.12f},{torque:9.5f},\n" for setting, time, torque in cells))
    columns = '[columns]\ntime_s = { number = 4, unit = "s" }\ntorque_nm = { number = 5, unit = "Nm" }\n'
    run = import_by(tmp_path, path, columns)
    np.testing.assert_allclose(run["time_s"], TIME)
    np.testing.assert_allclose(run["torque_nm"], TORQUE)


@pytest.mark.parametrize("first", ["{time:.4f}", "23-Feb-2022 06:34:{time:06.3f}"])
def test_rows_before_all_sensors_answer_are_rows(tmp_path: Path, first: str) -> None:
    """As the app Torque writes them: they were taken for lines above the rows, and the names were lost with them."""
    silent = [
        f"fix,{first.format(time=time)},{torque:.4f}" + ",-" * 6 for time, torque in zip(TIME[:9], TORQUE, strict=False)
    ]
    whole = [
        f"fix,{first.format(time=time)},{torque:.4f}" + 6 * f",{speed:.4f}"
        for time, torque, speed in zip(TIME[9:], TORQUE[9:], SPEED[9:], strict=True)
    ]
    path = tmp_path / "recording.csv"
    path.write_text("\n".join(["gps,time,torque,speed,a,b,c,d,e", *silent, *whole, ""]))
    time = "" if "Feb" in first else ', unit = "s"'
    run = import_by(
        tmp_path,
        path,
        f'[columns]\ntime_s = {{ from = "time"{time} }}\ntorque_nm = {{ from = "torque", unit = "Nm" }}\n',
    )
    np.testing.assert_allclose(run["time_s"], TIME, atol=1e-9)
    np.testing.assert_allclose(run["torque_nm"], TORQUE)


@pytest.mark.parametrize("index", [False, True])
def test_the_numbers_of_columns_of_pandas_are_no_row(tmp_path: Path, index: bool) -> None:
    rows = [f"{1.5 + 0.01 * row:.2f},{torque:.4f}" for row, torque in enumerate(TORQUE)]
    text = "\n".join([",0,1", *(f"{k},{row}" for k, row in enumerate(rows)), ""] if index else ["0,1", *rows, ""])
    first = 1 + index
    columns = (
        f'[columns]\ntime_s = {{ number = {first}, unit = "s" }}\ntorque_nm = {{ number = {first + 1}, unit = "Nm" }}\n'
    )
    if not index:
        (tmp_path / "recording.csv").write_text(text)
        assert "line 1, '0,1', can be a row or the numbers of columns; set header = false or header = true" in (
            find_refusal(tmp_path, tmp_path / "recording.csv", columns)
        )
        with pytest.raises(InputError, match=r"jumps by 1\.5 s after row 0"):
            read(tmp_path, text, "header = false", columns)
    run = read(tmp_path, text, "" if index else "header = true", columns)
    np.testing.assert_array_equal(run["torque_nm"], TORQUE)
    assert run["time_s"][0] == 1.5


@pytest.mark.parametrize(
    ("name", "unit", "told"),
    [("rad/s", "rpm", True), ("rpm", "rpm", False), ("U/min", "rpm", False), ("motor", "rpm", False)],
)
def test_units_of_a_name_and_of_a_line_that_contradict_each_other_are_told(
    tmp_path: Path, name: str, unit: str, told: bool
) -> None:
    rows = (f"{time:.2f},{torque:.4f},{speed:.2f}" for time, torque, speed in zip(TIME, TORQUE, SPEED, strict=True))
    text = "\n".join([f"time,torque,speed [{name}]", f"s,Nm,{unit}", *rows, ""])
    run = read(tmp_path, text)
    np.testing.assert_allclose(run["speed_rad_s"], RPM * np.round(SPEED, 2))
    note = f"speed: its unit is {name} by its name, and {unit} by the line of units, which is used"
    assert (note in run.metadata["import"]["done"]) == told


@pytest.mark.parametrize("end", ["", ";"])
def test_a_remark_of_as_many_cells_right_above_the_names_has_no_names(tmp_path: Path, end: str) -> None:
    rows = (
        f"{time:.2f};{torque:.4f};{speed:.2f}{end}" for time, torque, speed in zip(TIME, TORQUE, SPEED, strict=True)
    )
    run = read(tmp_path, "\n".join(["Operator;Smith;x", "time;torque;speed", *rows, ""]))
    np.testing.assert_allclose(run["torque_nm"], TORQUE)


VBOX = """File created on 23/04/2018 at 09:20:26

[header]
satellites
time
velocity kmh
battery vo

[channel units]
v

[comments]
VBSp V01.01

[column names]
sats time velocity battery vo
[data]
"""


def test_names_are_those_of_a_list_where_one_of_them_has_a_blank(tmp_path: Path) -> None:
    """As VBOX writes them: below `[column names]` are five words for four columns."""
    path = tmp_path / "drive.vbo"
    rows = [f"010 0751{41.65 + t:05.2f} {3.58 + n:07.3f} +3.90400E+00" for n, t in enumerate(TIME)]
    path.write_text(VBOX + "\n".join([*rows, ""]))
    recording = open_recording(path)
    assert [channel.name for channel in recording.channels] == ["satellites", "time", "velocity kmh", "battery vo"]
    assert "names in line 4" in recording.notes
    (speed,) = recording.read([recording.channels[2]])
    np.testing.assert_allclose(speed.values, 3.58 + np.arange(ROWS))
    drafted = draft_map(path, recording)
    assert 'from = "velocity kmh", unit = "km/h"' in drafted
    path.write_text(VBOX.replace("battery vo", "battery") + "\n".join([*rows, ""]))
    assert [channel.name for channel in open_recording(path).channels] == ["sats", "time", "velocity", "battery"]


def test_a_zero_byte_before_a_unit_does_not_lose_it(tmp_path: Path) -> None:
    assert_right(read(tmp_path, make_table(header="time,torque,speed\n\0Sekunden,( Nm ),rad/s")))
    path = tmp_path / "a recording.csv"
    assert [channel.unit for channel in open_recording(path).channels] == ["Sekunden", "Nm", "rad/s"]
