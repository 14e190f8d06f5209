"""A rate that a map states, or a number of the row that it takes for seconds: what the file says of its times is told."""

from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from nptdms import ChannelObject, GroupObject, TdmsWriter

from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from clutch_hil.recordings.stated_rate import read_stated_rate, split_value
from tests.clutch_hil.recordings.maps import find_refusal, import_by

ROWS = 60
TORQUE = np.round(np.sin(0.01 * np.arange(ROWS)), 4)
DOUBT = "by the file the rate is another one"


def make_map(time: str) -> str:
    return f'[columns]\ntime_s = {{ {time} }}\ntorque_nm = {{ from = "torque", unit = "Nm" }}\n'


def write_text(tmp_path: Path, above: str, first: str, step: float) -> Path:
    rows = (f"{step * row:g},{torque:.4f}" for row, torque in enumerate(TORQUE))
    path = tmp_path / "recording.csv"
    path.write_text("\n".join([*([above] if above else []), f"{first},torque", *rows, ""]))
    return path


def import_denied(tmp_path: Path, path: Path, time: str) -> str:
    """What an import tells that a map asks for by `unit_from`, which is refused without it."""
    refused = find_refusal(tmp_path, path, make_map(time))
    assert DOUBT in refused
    assert "; set that rate, or unit_from = 'map' beside rate_hz where the file is wrong" in refused
    return import_told(tmp_path, path, f'{time}, unit_from = "map"')


def import_told(tmp_path: Path, path: Path, time: str) -> str:
    return "; ".join(import_by(tmp_path, path, make_map(time)).metadata["import"]["done"])


@pytest.mark.parametrize(
    ("above", "rate", "doubt"),
    [
        ("Sample rate [Hz]: 200", 100.0, True),
        ("Sample rate [Hz]: 100", 100.0, False),
        ("Abtastrate: 0.1", 100.0, False),
        ("x0: 0\ndx: 0.005", 100.0, True),
        ("x0: 0\ndx: 0.01", 100.0, False),
    ],
)
def test_a_rate_that_the_head_denies_is_told(tmp_path: Path, above: str, rate: float, doubt: bool) -> None:
    path = write_text(tmp_path, above, "count", 2.0)
    message = (import_denied if doubt else import_told)(tmp_path, path, f"rate_hz = {rate}")
    assert (DOUBT in message) == doubt


def test_a_rate_that_increments_deny_is_told(tmp_path: Path) -> None:
    path = tmp_path / "recording.tdms"
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("bench", "torque", TORQUE, {"wf_increment": 0.01, "unit_string": "Nm"})])
    message = import_denied(tmp_path, path, "rate_hz = 50.0")
    assert f"{DOUBT}: torque is 100 Hz" in message
    assert "'bench/time', which are times by the file, are not used" in message
    assert DOUBT not in import_told(tmp_path, path, "rate_hz = 100.0")


@pytest.mark.parametrize(("name", "step", "doubt"), [("Sample", 1.0, True), ("No.", 1.0, True), ("Sample", 0.5, False)])
def test_a_number_of_the_row_that_is_taken_for_seconds_is_told(
    tmp_path: Path, name: str, step: float, doubt: bool
) -> None:
    message = import_told(tmp_path, write_text(tmp_path, "", name, step), f'from = "{name}", unit = "s"')
    assert (f"{name!r} counts rows, perhaps; set time_s = {{ rate_hz = ... }} then" in message) == doubt


@pytest.mark.parametrize(
    ("place", "key", "value", "message"),
    [
        ("/", "sample_rate", 100.0, "sample_rate is 100 Hz"),
        ("bench", "Sampling Frequency [kHz]", 0.1, "bench/Sampling Frequency [kHz] is 100 Hz"),
        ("bench", "rate_hz", 100, "bench/rate_hz is 100 Hz"),
        ("bench/torque", "dt", 0.01, "bench/torque/dt is 0.01 s"),
        ("bench/torque", "samplerate", "100 Hz", "bench/torque/samplerate [Hz] is 100 Hz"),
        ("bench/torque", "SamplePeriodMs", 10, "bench/torque/SamplePeriodMs is 0.01 s"),
        ("other", "sample_rate", 100.0, ""),
        ("bench/torque", "crate", 100.0, ""),
    ],
)
def test_a_rate_among_attributes_is_told_where_it_is_denied(
    tmp_path: Path, place: str, key: str, value: object, message: str
) -> None:
    path = tmp_path / "recording.h5"
    with h5py.File(path, "w") as file:
        file["bench/torque"], file["other/x"] = TORQUE, TORQUE
        file[place].attrs[key] = value
    notes = (import_denied if message else import_told)(tmp_path, path, "rate_hz = 50.0")
    assert (f"{DOUBT}: {message}" in notes) if message else (DOUBT not in notes)
    assert DOUBT not in import_told(tmp_path, path, "rate_hz = 100.0")


def test_rates_that_contradict_are_told(tmp_path: Path) -> None:
    path = tmp_path / "recording.h5"
    with h5py.File(path, "w") as file:
        file["torque"] = TORQUE
        file["torque"].attrs.update({"sample_rate": 100.0, "rate_hz": 1000.0})
    assert f"{DOUBT}: torque/rate_hz is 1000 Hz" in import_told(tmp_path, path, "rate_hz = 100.0")


def test_a_rate_among_properties_and_in_metadata_is_told(tmp_path: Path) -> None:
    path = tmp_path / "recording.tdms"
    with TdmsWriter(path) as writer:
        writer.write_segment([GroupObject("bench", {"SampleRate": 100.0}), ChannelObject("bench", "torque", TORQUE)])
    assert f"{DOUBT}: bench/SampleRate is 100 Hz" in import_denied(tmp_path, path, "rate_hz = 50.0")
    table = pa.table({"torque": TORQUE}).replace_schema_metadata(
        {"PANDAS_ATTRS": '{"interval": 3, "sample_time": "10 ms"}'}
    )
    pq.write_table(table, tmp_path / "recording.parquet")
    message = import_denied(tmp_path, tmp_path / "recording.parquet", "rate_hz = 50.0")
    assert message.endswith(f"{DOUBT}: sample_time [ms] is 0.01 s")


def test_coarse_times_do_not_deny_a_rate(tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    rows = (f"10:11:{12 + (row + 9) // 10:02d},{torque:.4f}" for row, torque in enumerate(TORQUE))
    path.write_text("\n".join(["clock,torque", *rows, ""]))
    assert f"{DOUBT}: torque is 9.83333 Hz" in import_told(tmp_path, path, "rate_hz = 12.0")
    assert f"{DOUBT}: torque is 9.83333 Hz" in import_denied(tmp_path, path, "rate_hz = 100.0")


@pytest.mark.parametrize("step", [10.0, 1.0])
def test_whole_numbers_of_seconds_may_be_ms(tmp_path: Path, step: float) -> None:
    path = write_text(tmp_path, "", "time", step)
    message = import_told(tmp_path, path, 'from = "time", unit = "s"')
    assert f"time_s rises by {step:g} s a row in whole numbers, and the file states no unit of 'time'" in message
    assert "whole numbers" not in import_told(tmp_path, path, 'from = "time", unit = "ms"')
    path = write_text(tmp_path, "", "time [s]", step)
    assert "whole numbers" not in import_told(tmp_path, path, 'from = "time"')


def test_a_unit_of_time_that_the_stated_rate_denies_is_refused(tmp_path: Path) -> None:
    path = write_text(tmp_path, "Sampling interval: 10 ms", "time", 10.0)
    sentence = find_refusal(tmp_path, path, make_map('from = "time", unit = "s"'))
    assert (
        "'time' for time_s rises by 10 a row, in s by the map, and by the file Sampling interval [ms] is 0.01 s"
        in sentence
    )
    assert "set unit = 'ms'" in sentence
    assert import_by(tmp_path, path, make_map('from = "time", unit = "ms"'))["time_s"][1] == pytest.approx(0.01)
    slow = import_by(tmp_path, path, make_map('from = "time", unit = "s", unit_from = "map"'))
    assert slow["time_s"][1] == pytest.approx(10.0)


def test_millionths_of_days_are_not_taken_for_ms(tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    rows = (f"{45718424444.4 + 1e6 * row / 86400.0:.6f};{torque:.4f}" for row, torque in enumerate(TORQUE))
    path.write_text("\n".join(["Time_ms;torque", *rows, ""]))
    sentence = find_refusal(tmp_path, path, make_map('from = "Time_ms", unit = "ms"'))
    assert "as millionths of days of a spreadsheet do (WinCC), in ms by the map; set unit_from = 'map', and" in sentence
    run = import_by(tmp_path, path, make_map('from = "Time_ms", unit = "ud", unit_from = "map"'))
    np.testing.assert_allclose(run["time_s"], np.arange(ROWS), atol=1e-5)


@pytest.mark.parametrize("cell", ["inf", "nan"])
def test_a_time_without_end_is_refused_in_a_sentence(tmp_path: Path, cell: str) -> None:
    path = write_text(tmp_path, "", "time", 10.0)
    path.write_text(path.read_text().replace("\n100,", f"\n{cell},").replace("\n110,", f"\n{cell},"))
    assert "is not a number in row 10" in find_refusal(tmp_path, path, make_map('from = "time", unit = "s"'))


@pytest.mark.parametrize("value", [0.0, -1.0, 1e-320, 1e308, float("inf")])
def test_a_number_that_is_no_rate_tells_none(value: float) -> None:
    assert read_stated_rate("sample_rate", value) is read_stated_rate("dt", value) is None


RIGOL = "X,torque,Start,Increment,\nSequence,Volt,-3.0E-01,1.0E-02,"
RIGOL_BARE = "torque,t0 = -3.0E-01,tInc = 1.0E-02,"
SIGLENT = "Sample Interval,Analog:1.0E-02\nVertical Units,CH1:V\nSource,CH1\ncount,torque"
LMS = "Number of points,60\nIncrement,0.01\ncount,torque"
HANTEK = "#CHANNEL:CH1\n#CLOCK=10.0mS\n#SIZE=60\ncount,torque"
RIGOL_SECONDS = "torque,t0 = -3.0E-01s, tInc = 1.0E-02s,"
KEYSIGHT = "Start:,0\nPoints:,60\nXInc:,1E-02\nXOrg:,0\ncount,torque"
OWON = "Frequency:,?\nSample interval:,10ms"
YOKOGAWA_TABS = "TraceName\tpressure\ttorque\nVUnit\tV\tV\nHResolution\t1.0E-2\t1.0E-2\nHUnit\ts\ts"
YOKOGAWA = '"TraceName",torque\n"VUnit",V\n"SampleRate",100\n"HResolution",0.01\n"HUnit",s\n"Date",2024/03/05'


def write_below(tmp_path: Path, head: str, lead: str, end: str = "") -> Path:
    """Rows without times below the lines `head` of an oscilloscope. lead: before each row, with its number for {}."""
    rows = (f"{lead.format(row)}{torque:.4f}{end}" for row, torque in enumerate(TORQUE))
    path = tmp_path / "recording.csv"
    path.write_text("\n".join([head, *rows, ""]))
    return path


@pytest.mark.parametrize(
    ("head", "lead", "end", "name"),
    [
        (RIGOL, "{},", ",", "Increment"),
        (RIGOL, "{},", "", "Increment"),
        (RIGOL, "{},", ",,", "Increment"),
        (RIGOL_BARE, "", ",", "tInc"),
        (RIGOL_SECONDS, "", ",", "tInc"),
        (KEYSIGHT, "{},", "", "XInc"),
        (SIGLENT, "{},", "", "Sample Interval"),
        (LMS, "{},", "", "Increment"),
        (HANTEK, "{},", "", "CLOCK [ms]"),
        (YOKOGAWA, ",", "", "SampleRate"),
    ],
)
def test_the_rate_in_the_head_of_an_oscilloscope_is_compared(
    tmp_path: Path, head: str, lead: str, end: str, name: str
) -> None:
    path = write_below(tmp_path, head, lead, end)
    columns = (
        '[columns]\ntime_s = {{ rate_hz = {} }}\ntorque_nm = {{ from = "torque", unit = "Nm", unit_from = "map" }}\n'
    )
    assert f"{DOUBT}: {name} is" in find_refusal(tmp_path, path, columns.format(1000.0))
    run = import_by(tmp_path, path, columns.format(100.0))
    np.testing.assert_allclose(run["torque_nm"], TORQUE)
    np.testing.assert_allclose(run["time_s"], 0.01 * np.arange(ROWS))


@pytest.mark.parametrize(
    ("head", "lead", "name"), [(OWON, "{},", "Sample interval [ms]"), (YOKOGAWA_TABS, "1.5\t", "HResolution")]
)
def test_the_rate_above_rows_of_other_cells_is_compared(tmp_path: Path, head: str, lead: str, name: str) -> None:
    path = write_below(tmp_path, head, lead)
    columns = '[columns]\ntime_s = {{ rate_hz = {} }}\ntorque_nm = {{ number = 2, unit = "Nm", unit_from = "map" }}\n'
    assert f"{DOUBT}: {name} is" in find_refusal(tmp_path, path, columns.format(1000.0))
    np.testing.assert_allclose(import_by(tmp_path, path, columns.format(100.0))["torque_nm"], TORQUE)
    assert "Sample interval:" not in [channel.name for channel in open_recording(path, {}).channels]


@pytest.mark.parametrize(
    "head",
    [
        "10 msec/sample", '"Sample Rate","100.000","Hz"', "Sample period 10 ms", "Samples per second: 100", "Abtastrate;100;Hz",
        "Aufzeichnungsintervall: 10 ms", "Intervall [ms];10", "Fréquence d'échantillonnage : 100 Hz", "100 Hz", "# 0.1 kHz",
        "100 SPS", "sampled at 100 Hz", "one sample every 10 ms", "Increment,1.0e-02,s", '# {"dt": 0.01}',
        '{"sample_rate": 100, "rig": {"name": "7"}}',
    ],
)  # fmt: skip
def test_a_rate_in_the_words_of_other_tools_is_compared(tmp_path: Path, head: str) -> None:
    path = write_below(tmp_path, f"recorded today\n{head}\ncount,torque", "1,")
    assert DOUBT in find_refusal(tmp_path, path, make_map("rate_hz = 50.0"))
    np.testing.assert_allclose(import_by(tmp_path, path, make_map("rate_hz = 100.0"))["torque_nm"], TORQUE)


def test_the_rate_beside_the_first_rows_is_compared(tmp_path: Path) -> None:
    beside = ["Record Length,60", "Sample Interval,1.0E-02", "Vertical Units,V", "Trigger Point,0"]
    rows = [f"{beside[k] if k < len(beside) else ','},,{0.01 * k:.2f},{torque:.4f}" for k, torque in enumerate(TORQUE)]
    path = tmp_path / "recording.csv"
    path.write_text("\n".join([*rows, ""]))
    columns = '[columns]\ntime_s = {{ rate_hz = {} }}\ntorque_nm = {{ number = 5, unit = "Nm" }}\n'
    assert f"{DOUBT}: Sample Interval is 0.01 s" in find_refusal(tmp_path, path, columns.format(50.0))
    np.testing.assert_allclose(import_by(tmp_path, path, columns.format(100.0))["torque_nm"], TORQUE)


@pytest.mark.parametrize("lead", ["{}.0E-02,", ""])
def test_volts_of_a_division_are_no_unit_of_a_column(tmp_path: Path, lead: str) -> None:
    head = "#timebase=2000000000(ps)\n,#voltbase=5000000(uV)\n#size=60"
    path = write_below(tmp_path, head, lead)
    number = 1 + bool(lead)
    columns = f'[columns]\ntime_s = {{ rate_hz = 100.0 }}\nvalve_voltage_v = {{ number = {number}, unit = "V" }}\n'
    np.testing.assert_allclose(import_by(tmp_path, path, columns)["valve_voltage_v"], TORQUE)


def test_a_number_of_the_row_is_refused_as_time_where_the_file_states_a_rate(tmp_path: Path) -> None:
    path = write_below(tmp_path, LMS, "{},")
    sentence = find_refusal(tmp_path, path, make_map('from = "count", unit = "s"'))
    assert "'count' for time_s rises by 1 a row, in s by the map, and by the file Increment is 0.01 s" in sentence
    assert "set time_s = { rate_hz = 100 }" in sentence
    path = write_below(tmp_path, RIGOL, "{},")
    assert "rate_hz where it counts rows" in find_refusal(tmp_path, path, make_map('from = "X", unit = "s"'))


def test_a_draft_proposes_the_rate_that_the_file_states(tmp_path: Path) -> None:
    path = write_below(tmp_path, RIGOL, "{},", ",")
    assert "time_s = { rate_hz = 100 }  # by the file, Increment is 0.01 s: check this" in draft_map(
        path, open_recording(path, {})
    )


@pytest.mark.parametrize(
    ("name", "step", "line"),
    [
        ("x", 0.01, 'time_s = { from = "x", unit = "s" }  # the file states no unit of time: check that it is s'),
        (
            "x",
            0.33,
            "# time_s = { rate_hz = 100 }  # by the file, Increment is 0.01 s: check this, as x rises otherwise",
        ),
        (
            "X_Value",
            0.33,
            'time_s = { from = "X_Value", unit = "s" }  # the file states no unit of time: check that it is s',
        ),
    ],
)
def test_a_draft_prefers_times_to_a_rate(tmp_path: Path, name: str, step: float, line: str) -> None:
    path = write_text(tmp_path, "Increment: 0.01", name, step)
    assert line in draft_map(path, open_recording(path, {})).splitlines()


@pytest.mark.parametrize(
    ("name", "text", "rate"),
    [
        ("Sample Rate", "2.5MSa/s", 2.5e6),
        ("Sampling Rate", "100 Samples/s", 100.0),
        ("CLOCK", "1.000uS", 1e6),
        ("Interval", "10ms", 100.0),
    ],
)
def test_rates_as_oscilloscopes_write_them(name: str, text: str, rate: float) -> None:
    value = split_value(name, text)
    assert value
    stated = read_stated_rate(*value)
    assert stated
    assert stated.agrees(rate)


def test_other_clocks_increments_and_resolutions_state_no_rate() -> None:
    assert split_value("clock", "16 MHz") is None
    for name in ("clock", "interval", "speed increment", "time resolution"):
        assert read_stated_rate(name, 10.0) is None
