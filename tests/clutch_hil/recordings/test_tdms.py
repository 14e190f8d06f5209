"""TDMS files: starts, increments, time stamps, scalings and units count; cuts are told; an index beside is not read."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nptdms import ChannelObject, GroupObject, RootObject, TdmsFile, TdmsWriter

from benchmarks.mutations import check_damaged
from clutch_hil.recordings.channel import choose_channel
from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording, recognise
from clutch_hil.recordings.import_map import load_map
from protocols.errors import InputError
from tests.clutch_hil.recordings.maps import find_refusal, import_by

ROWS = 400
TIME = np.arange(ROWS) / 200.0
POSITION, FORCE = np.sin(TIME), np.cos(TIME)
START = np.datetime64("2026-01-02T03:04:05.250000", "us")
MAP = """
[columns]
time_s = { from = "time_s", unit = "s" }
position_m = { from = "pos", unit = "m" }
motor_force_n = { from = "force", unit = "N" }
"""


def make_timing(increment: float = 1 / 200, start: np.datetime64 | None = START, **more: Any) -> dict[str, Any]:
    begin = {} if start is None else {"wf_start_time": start}
    return {"wf_increment": increment, "wf_start_offset": 0.0, **begin, **more}


def write(path: Path, *segments: list[Any], index: bool = False) -> Path:
    with TdmsWriter(str(path), index_file=index) as writer:
        for objects in segments:
            writer.write_segment(objects)
    return path


def make_plain() -> list[Any]:
    return [
        RootObject({"gear_ratio": 2.5, "operator": "me"}), GroupObject("fast"),
        ChannelObject("fast", "pos", POSITION, make_timing(unit_string="mm")),
        ChannelObject("fast", "force", FORCE, make_timing(unit_string="N")),
    ]  # fmt: skip


def read(path: Path, name: str) -> tuple[np.ndarray, np.ndarray | None]:
    recording = open_recording(path)
    (signal,) = recording.read([choose_channel(path, recording.channels, name)])
    return signal.values, signal.time


@pytest.mark.parametrize("name", ["a.tdms", "A.TDMS", "a.dat"])
def test_start_and_increment_are_the_time(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / name, make_plain())
    assert recognise(path).name == "TDMS"
    run = import_by(tmp_path, path, MAP)
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["position_m"], 1e-3 * POSITION)  # the file's unit counts
    assert run.metadata["gear_ratio"] == 2.5
    assert run.metadata["import"]["start"] == "2026-01-02T03:04:05.250000+00:00"


def make_pieces() -> list[list[Any]]:
    measured = (("pos", POSITION), ("force", FORCE))
    return [[ChannelObject("g", n, v[k : k + 50], make_timing()) for n, v in measured] for k in range(0, ROWS, 50)]


def test_many_segments_are_one_signal(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tdms", *make_pieces())
    np.testing.assert_array_equal(import_by(tmp_path, path, MAP)["position_m"], POSITION)


def test_channels_that_begin_later_keep_their_times(tmp_path: Path) -> None:
    late = START + np.timedelta64(500_000, "us")
    path = write(
        tmp_path / "a.tdms",
        [
            ChannelObject("fast", "pos", TIME, make_timing(unit_string="m")),
            ChannelObject("slow", "force", TIME[::10] + 0.5, make_timing(1 / 20, late, unit_string="N")),
        ],
    )
    np.testing.assert_allclose(read(path, "force")[1], 0.5 + TIME[::10], atol=1e-9)
    assert "different rasters" in find_refusal(tmp_path, path, MAP)
    run = import_by(tmp_path, path, "[file]\nresample_hz = 200.0\n" + MAP)
    np.testing.assert_allclose(run["motor_force_n"], run["time_s"], atol=1e-9)
    np.testing.assert_allclose(run["position_m"], run["time_s"], atol=1e-9)


@pytest.mark.parametrize(
    ("other", "raster"),
    [
        (make_timing(1 / 20), "g, 400 rows with times at 20 Hz from 0 s"),
        (make_timing(start=START + np.timedelta64(500_000, "us")), "g, 400 rows with times at 200 Hz from 0.5 s"),
        (make_timing(wf_start_offset=0.5), "g, 400 rows with times at 200 Hz from 0.5 s"),
    ],
)
def test_channels_with_as_many_rows_keep_their_own_times(tmp_path: Path, other: dict[str, Any], raster: str) -> None:
    late = (0.5 if "0.5" in raster else 0.0) + np.arange(ROWS) * other["wf_increment"]
    path = write(
        tmp_path / "a.tdms",
        [
            ChannelObject("g", "pos", TIME, make_timing(unit_string="m")),
            ChannelObject("g", "force", late, other | {"unit_string": "N"}),
        ],
    )
    recording = open_recording(path)
    first = "g, 400 rows with times at 200 Hz from 0 s"
    assert [c.raster for c in recording.channels] == [first, raster, first, raster]
    assert len({c.path for c in recording.channels}) == 4
    assert "\nresample_hz = " in draft_map(path, recording)
    np.testing.assert_allclose(read(path, "force")[1], late, atol=1e-9)
    assert "different rasters" in find_refusal(tmp_path, path, MAP)
    run = import_by(tmp_path, path, "[file]\nresample_hz = 200.0\n" + MAP)
    np.testing.assert_allclose(run["motor_force_n"], run["time_s"], atol=1e-9)
    np.testing.assert_allclose(run["position_m"], run["time_s"], atol=1e-9)


def test_rasters_that_differ_by_less_than_their_names_tell_have_two_names(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a.tdms",
        [
            ChannelObject("g", "pos", TIME, make_timing(unit_string="m")),
            ChannelObject("g", "force", FORCE, make_timing((1 + 1e-9) / 200, unit_string="N")),
        ],
    )
    rasters = [c.raster for c in open_recording(path).channels]
    assert rasters[1] == f"{rasters[0]} (2)"
    assert "different rasters" in find_refusal(tmp_path, path, MAP)


def make_two(first: dict[str, Any], second: dict[str, Any]) -> list[list[Any]]:
    """Both channels in two segments of ROWS / 2, each with its own timing."""
    half = ROWS // 2
    parts = ((slice(0, half), first), (slice(half, ROWS), second))
    return [
        [ChannelObject("g", "pos", POSITION[k], timing), ChannelObject("g", "force", FORCE[k], timing)]
        for k, timing in parts
    ]


def add_ms(milliseconds: int) -> np.datetime64:
    return START + np.timedelta64(milliseconds, "ms")


@pytest.mark.parametrize(
    ("second", "late"),
    [
        (make_timing(start=add_ms(3_600_000)), 3600.0 + TIME[: ROWS // 2]),
        (make_timing(wf_start_offset=5.0), 5.0 + TIME[: ROWS // 2]),
        (make_timing(1 / 100, add_ms(1000)), 1.0 + 2.0 * TIME[: ROWS // 2]),
    ],
)
def test_an_appended_acquisition_keeps_its_own_times(tmp_path: Path, second: dict[str, Any], late: np.ndarray) -> None:
    path = write(tmp_path / "a.tdms", *make_two(make_timing(), second))
    values, time = read(path, "force")
    np.testing.assert_array_equal(values, FORCE)
    assert time is not None
    np.testing.assert_allclose(time, [*TIME[: ROWS // 2], *late], atol=1e-9)
    recording = open_recording(path)
    assert recording.channels[0].end_s == pytest.approx(late[-1])
    assert "g/pos, g/force: 2 acquisitions one after another, each with its own times" in recording.notes
    if late[0] > 2.0:
        assert "jumps by" in find_refusal(tmp_path, path, MAP)
        toml = tmp_path / "cut.toml"
        toml.write_text("[file]\nlongest_gap_s = 0.1\n" + MAP, encoding="utf-8")
        runs = load_map(str(toml)).read_runs(path)
        assert [len(run["time_s"]) for run in runs] == [ROWS // 2, ROWS // 2]


@pytest.mark.parametrize(
    "second",
    [
        make_timing(start=add_ms(1000)),
        make_timing(start=add_ms(1002)),  # less than half an increment late, by the clock of the writer
        make_timing(wf_start_offset=1.0),
        {},
        make_timing(),
    ],
)
def test_a_segment_that_goes_on_is_no_new_acquisition(tmp_path: Path, second: dict[str, Any]) -> None:
    path = write(tmp_path / "a.tdms", *make_two(make_timing(), second))
    np.testing.assert_array_equal(read(path, "force")[1], TIME[-1] / (ROWS - 1) * np.arange(ROWS))
    recording = open_recording(path)
    assert recording.start == "2026-01-02T03:04:05.250000+00:00"
    assert recording.notes == []


@pytest.mark.parametrize("first", [{}, make_timing(start=None)])
def test_what_a_later_segment_says_first_is_about_all_rows(tmp_path: Path, first: dict[str, Any]) -> None:
    path = write(tmp_path / "a.tdms", *make_two(first, make_timing()))
    np.testing.assert_allclose(read(path, "force")[1], TIME, atol=1e-12)
    assert open_recording(path).start == "2026-01-02T03:04:05.250000+00:00"


def test_a_start_that_no_row_followed_does_not_count(tmp_path: Path) -> None:
    first, second = make_two(make_timing(start=None), make_timing(start=add_ms(9000), wf_xunit_string="s"))
    empty = [ChannelObject("g", "pos", np.empty(0), make_timing(start=add_ms(5000)))]
    named = [ChannelObject("g", "pos", np.empty(0), make_timing())]
    path = write(tmp_path / "a.tdms", first, named, empty, second)
    np.testing.assert_allclose(read(path, "pos")[1], 9.0 * (TIME >= 1.0) + TIME % 1.0, atol=1e-9)


def test_what_is_said_after_all_rows_is_about_all_rows(tmp_path: Path) -> None:
    late = [ChannelObject("g", name, np.empty(0), make_timing(start=add_ms(250))) for name in ("pos", "force")]
    path = write(tmp_path / "a.tdms", *make_two(make_timing(), make_timing()), late)
    assert open_recording(path).start == "2026-01-02T03:04:05.500000+00:00"
    np.testing.assert_allclose(read(path, "force")[1], TIME, atol=1e-12)


@pytest.mark.parametrize(
    ("second", "sentence"),
    [
        (make_timing(1 / 100), "at 2026-01-02T03:04:05.250000+00:00 with an increment of 0.01 s in segment 2"),
        (
            make_timing(start=add_ms(500)),
            "at 2026-01-02T03:04:05.750000+00:00 with an increment of 0.005 s in segment 2",
        ),
    ],
)
def test_segments_whose_times_overlap_are_refused(tmp_path: Path, second: dict[str, Any], sentence: str) -> None:
    path = write(tmp_path / "a.tdms", *make_two(make_timing(), second))
    begin = "begins at 2026-01-02T03:04:05.250000+00:00 with an increment of 0.005 s in segment 1, and"
    assert find_refusal(tmp_path, path, MAP).startswith(
        f"recording {path}: the times of 'g/pos' are not known, as it {begin} {sentence}; split the file there"
    )
    assert f"g/pos, g/force: no times are known, as it {begin} {sentence}" in open_recording(path).notes
    run = import_by(tmp_path, path, MAP.replace('{ from = "time_s", unit = "s" }', "{ rate_hz = 200.0 }"))
    np.testing.assert_array_equal(run["motor_force_n"], FORCE)


def test_time_stamps_are_the_time_of_their_group(tmp_path: Path) -> None:
    stamps = START + (1e6 * TIME).astype("m8[us]")
    measured = [ChannelObject("g", "pos", POSITION), ChannelObject("g", "force", FORCE)]
    path = write(tmp_path / "a.tdms", [ChannelObject("g", "clock", stamps), *measured])
    for clock in ("clock", "time_s"):
        run = import_by(tmp_path, path, MAP.replace('from = "time_s"', f'from = "{clock}"'))
        np.testing.assert_allclose(run["time_s"], TIME, atol=1e-6)
    assert open_recording(path).start.startswith("2026-01-02T03:04:05.25")


def test_a_spectrum_has_no_time(tmp_path: Path) -> None:
    spectrum = make_timing(2.0, None, wf_xunit_string="Hz")
    measured = [ChannelObject("g", "pos", POSITION, spectrum), ChannelObject("g", "force", FORCE, spectrum)]
    path = write(tmp_path / "a.tdms", measured)
    assert read(path, "pos")[1] is None
    assert any("is recorded over Hz, which gives no time" in note for note in open_recording(path).notes)
    assert "no column 'time_s'" in find_refusal(tmp_path, path, MAP)


def test_milliseconds_on_the_axis_become_seconds(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a.tdms", [ChannelObject("g", "pos", POSITION, make_timing(5.0, None, wf_xunit_string="ms"))]
    )
    np.testing.assert_allclose(read(path, "pos")[1], TIME)


LINEAR = {
    "NI_Number_Of_Scales": 1, "NI_Scaling_Status": "unscaled", "NI_Scale[0]_Scale_Type": "Linear",
    "NI_Scale[0]_Linear_Slope": 0.5, "NI_Scale[0]_Linear_Y_Intercept": 1.0, "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
}  # fmt: skip


def test_scalings_are_applied_and_an_unknown_one_is_refused(tmp_path: Path) -> None:
    raw = np.arange(ROWS, dtype="i2")
    path = write(tmp_path / "a.tdms", [ChannelObject("g", "pos", raw, LINEAR)])
    np.testing.assert_array_equal(read(path, "pos")[0], 0.5 * raw + 1.0)
    path = write(tmp_path / "b.tdms", [ChannelObject("g", "pos", raw, LINEAR | {"NI_Scale[0]_Scale_Type": "Magic"})])
    with pytest.raises(InputError, match="has the scaling 'Magic', which is unknown"):
        read(path, "pos")
    path = write(tmp_path / "c.tdms", [ChannelObject("g", "pos", raw, LINEAR | {"NI_Number_Of_Scales": 2_000_000_000})])
    with pytest.raises(InputError, match="without channels"):
        read(path, "pos")


def test_flags_are_a_status_and_text_is_told(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a.tdms", [ChannelObject("g", "on", TIME > 1.0), ChannelObject("g", "remark", ["ok"] * ROWS)]
    )
    kinds = {channel.name: (channel.kind, channel.unit) for channel in open_recording(path).channels}
    assert kinds == {"on": ("status", "1"), "remark": ("text", "")}
    with pytest.raises(InputError, match="holds text"):
        read(path, "remark")


def test_a_name_in_two_groups_has_two_paths(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tdms", [ChannelObject("a", "x", TIME), ChannelObject("b", "x", 2 * TIME)])
    np.testing.assert_array_equal(read(path, "b/x")[0], 2 * TIME)
    with pytest.raises(InputError, match="has 2 columns 'x'; select one by `from`: 'a/x', 'b/x'"):
        read(path, "x")


def test_an_index_of_another_recording_is_not_read(tmp_path: Path) -> None:
    write(tmp_path / "other.tdms", [ChannelObject("fast", "pos", 2 * TIME[:7], make_timing())], index=True)
    path = write(tmp_path / "a.tdms", make_plain())
    (tmp_path / "other.tdms_index").rename(tmp_path / "a.tdms_index")
    with TdmsFile.open(path) as misled:  # what nptdms makes of it, in silence
        assert len(misled["fast"]["pos"]) == 7
    np.testing.assert_array_equal(read(path, "pos")[0], POSITION)
    index = tmp_path / "a.tdms_index"
    with pytest.raises(InputError, match=r"is the index of a TDMS file; give the \.tdms file itself"):
        open_recording(index)


def test_a_cut_file_is_read_as_far_as_it_reaches(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tdms", *make_pieces())
    path.write_bytes(path.read_bytes()[:-100])
    run = import_by(tmp_path, path, MAP)
    rows = len(run["time_s"])
    assert ROWS - 50 < rows < ROWS
    np.testing.assert_array_equal(run["motor_force_n"], FORCE[:rows])
    assert any("the last segment is not whole" in note for note in run.metadata["import"]["done"])


def test_damaged_files_are_read_or_refused_in_a_sentence(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "a.tdms", make_plain(), [ChannelObject("g", "x", np.arange(ROWS, dtype="i2"), LINEAR)])
    read_count, refused = check_damaged(path, path.read_bytes(), 80)
    assert read_count
    assert refused
    assert capfd.readouterr() == ("", "")


def test_a_unit_in_a_name_is_one_where_no_property_tells_it(tmp_path: Path) -> None:
    named = ChannelObject("g", "pos (mm)", POSITION, make_timing())
    other = ChannelObject("g", "force (N)", FORCE, make_timing(unit_string="kN"))
    channels = open_recording(write(tmp_path / "a.tdms", [named, other])).channels
    assert [(c.name, c.unit) for c in channels][:2] == [("pos", "mm"), ("force (N)", "kN")]


@pytest.mark.parametrize("name", ["Time", "Time (s)"])
def test_groups_with_a_channel_of_times_each_are_joined(tmp_path: Path, name: str) -> None:
    fast = [ChannelObject("fast", name, TIME), ChannelObject("fast", "pos", TIME)]
    slow = [ChannelObject("slow", name, TIME[::2]), ChannelObject("slow", "force", TIME[::2])]
    path = write(tmp_path / "a.tdms", [*fast, *slow])
    columns = f"""
[file]
resample_hz = 200.0
[columns]
time_s = {{ from = "fast/{name}", unit = "s" }}
position_m = {{ from = "pos", unit = "m" }}
motor_force_n = {{ from = "force", unit = "N" }}
"""
    run = import_by(tmp_path, path, columns)
    np.testing.assert_allclose(run["motor_force_n"], run["time_s"], atol=1e-9)
    np.testing.assert_allclose(run["position_m"], run["time_s"], atol=1e-9)
