"""HDF5 files: datasets by path, units and times from attributes and scales; damaged ones end no process but their own."""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from clutch_hil.recordings.channel import Recording, choose_channel
from clutch_hil.recordings.format import open_recording, recognise
from clutch_hil.recordings.formats.hdf5 import open_hdf5
from clutch_hil.recordings.formats.matlab import open_level73
from clutch_hil.recordings.isolated import IsolatedRecording
from protocols.errors import InputError
from tests.clutch_hil.recordings.maps import find_refusal, import_by

ROWS = 50
T = 0.01 * np.arange(ROWS)
Q = np.sin(T)
MOST_SECONDS = 60.0  # 10 s of computing, on a machine that others share


def write(tmp_path: Path, fill: Callable[[h5py.File], None], **options: Any) -> Path:
    file = tmp_path / "recording.h5"
    with h5py.File(file, "w", **options) as content:
        fill(content)
    return file


def read_values(recording: Recording, wanted: str) -> np.ndarray:
    return recording.read([choose_channel(Path("x"), recording.channels, wanted)])[0].values


def write_logger(file: h5py.File) -> None:
    """As many loggers write: a group a rate, a time axis attached as a scale, units as attributes."""
    file.attrs["start_time"] = "2024-05-06T07:08:09"
    fast = file.create_group("fast")
    clock = fast.create_dataset("time", data=1e3 * T)
    clock.attrs["units"] = "ms"
    clock.make_scale("time")
    torque = fast.create_dataset("torque", data=Q, compression="gzip", chunks=(10,))
    torque.attrs["unit"], torque.attrs["description"] = "Nm", "at the shaft"
    pair = fast.create_dataset("pair", data=np.column_stack([T, Q]))
    for dataset in (torque, pair):
        dataset.dims[0].attach_scale(clock)
    slow = file.create_group("slow")
    slow["torque"] = Q[::5]
    slow["gain"] = 3.5
    slow["remark"] = "hello"
    slow["on"] = T > 0.3
    slow["words"] = np.array(["a", "b"], dtype=h5py.string_dtype())
    slow["cube"] = np.ones((2, 3, 4))
    gear = h5py.enum_dtype({"first": 1, "second": 2}, basetype="i4")
    slow.create_dataset("gear", data=1 + np.arange(ROWS) // 30, dtype=gear)
    slow["table"] = np.array([(1.0, 2), (3.0, 4)], dtype=[("x", "f8"), ("n", "i4")])
    file["elsewhere"] = h5py.ExternalLink("/etc/passwd", "/x")
    file["again"] = h5py.SoftLink("/slow")
    file["slow/back"] = file["/"]


def test_datasets_become_channels(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, write_logger))
    assert [(c.path, c.name, c.unit, c.kind, c.raster) for c in recording.channels] == [
        ("fast/pair[:,0]", "pair(1)", "", "number", "/fast/time"),
        ("fast/pair[:,1]", "pair(2)", "", "number", "/fast/time"),
        ("fast/time", "time", "s", "time", "/fast/time"),
        ("fast/torque", "torque", "Nm", "number", "/fast/time"),
        ("slow/gear", "gear", "", "status", "50 rows"),
        ("slow/on", "on", "", "status", "50 rows"),
        ("slow/table/x", "x", "", "number", "/slow/table"),
        ("slow/table/n", "n", "", "number", "/slow/table"),
        ("slow/torque", "torque", "", "number", "10 rows"),
        ("slow/words", "words", "", "text", "2 rows"),
    ]
    assert recording.numbers == {"slow/gain": 3.5}
    assert recording.start == "2024-05-06T07:08:09"
    assert recording.notes == [
        "start_time is 2024-05-06T07:08:09",
        "left out slow/cube (an array of 2 x 3 x 4 numbers)",
    ]
    assert recording.channels[3].comment == "at the shaft"
    assert recording.channels[3].rate_hz == pytest.approx(100.0)
    (torque,) = recording.read([recording.channels[3]])
    np.testing.assert_array_equal(torque.values, Q)
    np.testing.assert_allclose(torque.time, T, rtol=1e-12)
    for path, wanted in (("fast/pair[:,1]", Q), ("time", T), ("slow/table/n", [2, 4]), ("on", T > 0.3)):
        np.testing.assert_allclose(read_values(recording, path), wanted, rtol=1e-12)
    with pytest.raises(InputError, match="has 2 columns 'torque'; select one by `from`: 'fast/torque', 'slow/torque'"):
        read_values(recording, "torque")


def test_a_file_behind_other_bytes_is_found(tmp_path: Path) -> None:
    file = write(tmp_path, write_logger, userblock_size=1024)
    assert recognise(file).name == "HDF5"
    assert read_values(open_recording(file), "gear")[-1] == 2.0


def test_matlab_files_without_their_first_bytes_are_read_as_such(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        matrix = file.create_dataset("y", data=np.vstack([T, Q]))  # MATLAB's 50 x 2
        matrix.attrs["MATLAB_class"] = np.bytes_("double")

    recording = open_recording(write(tmp_path, fill))
    assert [c.path for c in recording.channels] == ["y(:,1)", "y(:,2)"]
    np.testing.assert_array_equal(read_values(recording, "y(2)"), Q)


def write_scales(file: h5py.File) -> None:
    clock = file.create_dataset("x", data=1e3 * T)
    clock.attrs["units"] = "ms"
    clock.make_scale("x")
    file["g/wide"] = np.vstack([Q, T, -Q])
    file["g/wide"].dims[1].attach_scale(clock)


def write_times_beside(file: h5py.File) -> None:
    file["time"], file["g/wide"], file["g/few"] = T, np.vstack([Q, T, -Q]), np.ones(3)


def write_alone(file: h5py.File) -> None:
    file["g/wide"] = np.vstack([Q, T, -Q])


@pytest.mark.parametrize("fill", [write_scales, write_times_beside, write_alone])
def test_a_dataset_of_channels_by_times_has_a_column_each(tmp_path: Path, fill: Callable[[h5py.File], None]) -> None:
    recording = open_recording(write(tmp_path, fill))
    wide = [c for c in recording.channels if c.path.startswith("g/wide")]
    assert [(c.path, c.name, c.rows) for c in wide] == [(f"g/wide[{k},:]", f"wide({k + 1})", ROWS) for k in range(3)]
    np.testing.assert_array_equal(read_values(recording, "g/wide[2,:]"), -Q)
    if fill is write_scales:
        assert wide[0].raster == "/x"
        np.testing.assert_allclose(recording.read(wide)[2].time, T, rtol=1e-12)  # type: ignore[arg-type]


def test_rows_stay_the_first_axis_where_nothing_speaks_against_it(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file["a/y"], file["a/time"] = np.ones((20, 60)), np.arange(20.0)
        file["b/y"], file["b/speed"] = np.ones((20, 60)), np.arange(20.0)
        file["c/y"], file["c/time"] = np.ones((60, 60)), np.arange(60.0)
        file["d/y"], file["d/frequencies"] = np.ones((200, 60)), np.arange(60.0)
        file["e/y"] = np.ones((60, 200))
        file["f/y"], file["f/time"] = np.ones((200, 2)), np.arange(2.0)

    rows = {c.path.split("[")[0]: c.rows for c in open_recording(write(tmp_path, fill)).channels if "/y" in c.path}
    assert rows == {"a/y": 20, "b/y": 20, "c/y": 60, "d/y": 200, "e/y": 60, "f/y": 200}


# --- bounds -----------------------------------------------------------------------------------------------------------


def write_huge(file: h5py.File) -> None:
    file.create_dataset("x", shape=(1 << 40,), dtype="f8", chunks=(1 << 20,))


def write_chunk(file: h5py.File) -> None:
    file.create_dataset("x", shape=(1 << 28,), dtype="f8", chunks=(1 << 28,), compression="gzip")


def write_outside(file: h5py.File) -> None:
    file.create_dataset("x", shape=(ROWS,), dtype="f8", external=[("/etc/passwd", 0, 8 * ROWS)])


def read_all(file: Path) -> None:
    recording = open_hdf5(file)
    recording.read(recording.channels)


@pytest.mark.parametrize(
    ("fill", "message"),
    [
        (write_huge, r"the 1 requested columns have together 1.1e\+12 rows; allowed are 5e\+07"),
        (write_chunk, "rows"),
        (write_outside, "x keeps its numbers in another file"),
        (lambda file: None, "has no columns of numbers"),
    ],
)
def test_what_is_too_large_or_elsewhere_is_refused(
    tmp_path: Path, fill: Callable[[h5py.File], None], message: str
) -> None:
    file = write(tmp_path, fill)
    with pytest.raises(InputError, match=message):
        read_all(file)


def test_a_too_large_chunk_is_refused(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file.create_dataset("x", shape=(100,), dtype="f8", chunks=(1 << 24,), maxshape=(None,))

    recording = open_hdf5(write(tmp_path, fill))
    with pytest.raises(InputError, match="x has chunks of 128 MiB; allowed are 64 MiB"):
        recording.read(recording.channels)


# --- damaged files ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", ["cut", "superblock", "objects", "data"])
def test_damaged_files_are_read_or_refused_in_one_sentence(tmp_path: Path, where: str) -> None:
    file = write(tmp_path, write_logger)
    raw = bytearray(file.read_bytes())
    if where == "cut":
        del raw[len(raw) // 2 :]
    else:
        begin, end = {"superblock": (9, 96), "objects": (96, 2000), "data": (2000, len(raw))}[where]
        chance = np.random.default_rng(1)
        for at in chance.integers(begin, end, 12):
            raw[at] = chance.integers(256)
    file.write_bytes(raw)
    begun = time.monotonic()
    try:
        recording = open_recording(file)
        recording.read(recording.channels)
    except InputError as refused:
        sentence = str(refused)
    else:
        sentence = ""
    assert "\n" not in sentence
    assert sentence.startswith("recording") or where == "data"
    assert time.monotonic() - begun < MOST_SECONDS


def test_a_cut_file_of_matlab_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "recording.mat"
    with h5py.File(file, "w", userblock_size=512) as content:
        content.create_dataset("q", data=Q[None]).attrs["MATLAB_class"] = np.bytes_("double")
    raw = bytearray(file.read_bytes())
    raw[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    file.write_bytes(raw)
    np.testing.assert_array_equal(read_values(open_level73(file), "q"), Q)
    file.write_bytes(raw[:-300])
    with pytest.raises(InputError, match=r"recording .* is cut or damaged"):
        open_recording(file)


# --- netCDF -----------------------------------------------------------------------------------------------------------


def write_packed(file: h5py.File) -> None:
    """Whole numbers with a scale, an offset and a number for no value, and times since a date."""
    clock = file.create_dataset("time", data=np.arange(ROWS, dtype="i8") * 10)
    clock.attrs["units"] = "milliseconds since 2024-03-05 10:11:12"
    clock.make_scale("time")
    raw = np.arange(ROWS, dtype="i2") * 100
    raw[3] = -32768
    torque = file.create_dataset("torque", data=raw)
    torque.attrs.update(
        {"units": "N m", "scale_factor": np.float32(0.01), "add_offset": 5.0, "_FillValue": np.int16(-32768)}
    )
    torque.dims[0].attach_scale(clock)
    gap = file.create_dataset("gap", data=raw.astype(float))
    gap.attrs["missing_value"] = -32768.0
    gap.dims[0].attach_scale(clock)


def test_packed_numbers_are_unpacked(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, write_packed))
    expected = 5.0 + np.arange(ROWS)
    expected[3] = np.nan
    np.testing.assert_allclose(read_values(recording, "torque"), expected, rtol=1e-12)
    np.testing.assert_allclose(read_values(recording, "gap"), 100.0 * (expected - 5.0), atol=1e-9)


def read_packed(tmp_path: Path, stored: np.ndarray, attributes: dict[str, Any]) -> tuple[np.ndarray, list[str]]:
    """Values of a dataset with these numbers and attributes, and the notes after it was read."""

    def fill(file: h5py.File) -> None:
        file.create_dataset("q", data=stored).attrs.update(attributes)

    recording = open_recording(write(tmp_path, fill))
    return read_values(recording, "q"), recording.notes


@pytest.mark.parametrize("kind", ["i1", "i2", "i4"])
def test_numbers_that_are_said_to_be_unsigned_are(tmp_path: Path, kind: str) -> None:
    most = 2 ** (8 * np.dtype(kind).itemsize)
    numbers = np.array([0, 1, most // 2 - 1, most // 2, most - 2, most - 1])
    attributes = {"_Unsigned": "true", "scale_factor": 0.5, "add_offset": 3.0, "_FillValue": np.array(-1, kind)}
    values, notes = read_packed(tmp_path, numbers.astype(kind.replace("i", "u")).view(kind), attributes)
    np.testing.assert_array_equal(values, [*(3.0 + 0.5 * numbers[:-1]), np.nan])
    assert notes == []
    values, _ = read_packed(tmp_path, np.array([-1, 0, 1], kind), {"_Unsigned": "false"})
    np.testing.assert_array_equal(values, [-1, 0, 1])


@pytest.mark.parametrize(
    ("attributes", "kept"),
    [
        ({"valid_range": np.array([-100, 200], "i2")}, [-10.0, 0.0, 10.0, 20.0, np.nan]),
        ({"valid_min": np.int16(0)}, [np.nan, 0.0, 10.0, 20.0, 30.0]),
        ({"valid_max": np.int16(100), "valid_min": np.int16(-50)}, [np.nan, 0.0, 10.0, np.nan, np.nan]),
        ({"valid_max": 10.0}, [-10.0, 0.0, 10.0, np.nan, np.nan]),  # of another type than the numbers: of the values
        ({"valid_max": np.int16(100), "missing_value": np.int16(300)}, [-10.0, 0.0, 10.0, np.nan, np.nan]),
    ],
)
def test_what_is_outside_of_the_valid_range_is_missing(
    tmp_path: Path, attributes: dict[str, Any], kept: list[float]
) -> None:
    stored = np.array([-100, 0, 100, 200, 300], "i2")
    values, notes = read_packed(tmp_path, stored, {"scale_factor": 0.1, **attributes})
    np.testing.assert_allclose(values, kept)
    outside = np.count_nonzero(np.isnan(kept)) - ("missing_value" in attributes)
    assert notes == [f"q: {outside} of 5 samples are outside of its valid range, and count as missing"]


def test_a_range_of_unsigned_numbers_is_one(tmp_path: Path) -> None:
    stored = np.array([10, 200, 250], "u1").view("i1")
    values, _ = read_packed(tmp_path, stored, {"_Unsigned": "true", "valid_range": np.array([0, 240], "u1").view("i1")})
    np.testing.assert_array_equal(values, [10, 200, np.nan])


def test_a_number_of_32_bits_for_no_value_is_found(tmp_path: Path) -> None:
    fill = np.float32(9.9692099683868690e36)  # of netCDF
    values, _ = read_packed(tmp_path, np.array([1.5, fill], "f4"), {"_FillValue": fill})
    np.testing.assert_array_equal(values, [1.5, np.nan])


def test_times_since_a_date_are_times_of_day(tmp_path: Path) -> None:
    text = '[columns]\ntime_s = { from = "time" }\ntorque_nm = { from = "torque" }\n[file]\nresample_hz = 100.0\n'
    run = import_by(tmp_path, write(tmp_path, write_packed), text)
    np.testing.assert_allclose(run["time_s"], 0.01 * np.arange(len(run["time_s"])), atol=1e-6)
    assert run.metadata["import"]["start"] == "2024-03-05T10:11:12+00:00"


@pytest.mark.parametrize(
    ("unit", "seconds"), [("hours", 3600.0), ("msec", 1e-3), ("microseconds", 1e-6), ("days", 86400.0)]
)
def test_times_since_a_date_need_be_no_axis(tmp_path: Path, unit: str, seconds: float) -> None:
    steps = 0.01 * np.arange(ROWS)

    def fill(file: h5py.File) -> None:
        file["time"], file["q"] = steps / seconds, Q
        file["time"].attrs["units"] = f"{unit} since 2024-03-05 10:11:12"

    text = '[columns]\ntime_s = { from = "time", unit = "s" }\ntorque_nm = { from = "q", unit = "Nm" }\n'
    run = import_by(tmp_path, write(tmp_path, fill), text)
    np.testing.assert_allclose(run["time_s"], steps, rtol=0.0, atol=1e-6)
    assert run.metadata["import"]["start"] == "2024-03-05T10:11:12+00:00"


def test_whole_ns_since_1970_keep_their_digits(tmp_path: Path) -> None:
    steps = 1000 * np.arange(ROWS) + np.arange(ROWS) % 7

    def fill(file: h5py.File) -> None:
        file["t"], file["q"] = 1_711_850_000_000_000_123 + steps, Q

    text = '[columns]\ntime_s = { from = "t", unit = "ns" }\ntorque_nm = { from = "q", unit = "Nm" }\n'
    run = import_by(tmp_path, write(tmp_path, fill), text)
    np.testing.assert_allclose(run["time_s"], 1e-9 * steps, rtol=0.0, atol=1e-15)


# --- the other process --------------------------------------------------------------------------------------------------


def abort(path: Path) -> Recording:
    os.abort()


def write_loop(path: Path) -> Recording:
    while True:
        pass


def eat(path: Path) -> Recording:
    return np.ones(1 << 40)  # type: ignore[return-value]


def refuse(path: Path) -> Recording:
    raise InputError(f"recording {path} is not liked")


@pytest.mark.parametrize(
    ("opener", "message"),
    [
        (abort, r"the library that reads it ended \(signal 6\)"),
        (write_loop, r"the library that reads it ended \(after 1 s of computing\)"),
        (eat, "needs more than 2 GiB of memory"),
        (refuse, "is not liked"),
    ],
)
def test_what_ends_the_other_process_is_told(opener: Callable[[Path], Recording], message: str) -> None:
    limit = 1 if opener is write_loop else 10
    with pytest.raises(InputError, match=message):
        IsolatedRecording(Path("some.h5"), f"{__name__}:{opener.__name__}", most_seconds=limit)


def test_the_other_process_ends_with_the_recording(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, write_logger))
    assert isinstance(recording, IsolatedRecording)
    process = recording.child.process
    assert process.poll() is None
    del recording
    assert process.wait(timeout=10) is not None


def test_a_unit_in_a_name_is_one_where_no_attribute_tells_it(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file["torque [kNm]"] = Q
        file["speed (rpm)"] = Q
        file["both [V]"] = Q
        file["both [V]"].attrs["unit"] = "mV"
        file["pair"] = np.column_stack([Q, Q])

    channels = open_recording(write(tmp_path, fill)).channels
    assert {(c.name, c.path, c.unit) for c in channels} == {
        ("torque", "torque [kNm]", "kNm"), ("speed", "speed (rpm)", "rpm"), ("both [V]", "both [V]", "mV"),
        ("pair(1)", "pair[:,0]", ""), ("pair(2)", "pair[:,1]", ""),
    }  # fmt: skip


def test_a_time_in_words_is_refused_without_an_entry_that_hdf5_does_not_know(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file["time"] = [f"at {t:06.3f} o'clock" for t in T]
        file["torque"] = Q

    columns = '[columns]\ntime_s = { from = "time" }\ntorque_nm = { from = "torque", unit = "Nm" }\n'
    sentence = find_refusal(tmp_path, write(tmp_path, fill), columns)
    assert sentence.endswith("allowed are columns of numbers, also of numbers, times or on and off as text")
