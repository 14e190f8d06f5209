"""HDF5 files: datasets by path, units and times from attributes and scales; damaged ones end no process but their own."""

import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from clutch_hil.recordings.format import open_recording, recognise
from clutch_hil.recordings.formats.hdf5 import open_hdf5
from clutch_hil.recordings.formats.matlab import open_level73
from protocols.errors import InputError
from tests.clutch_hil.recordings.hdf5_files import ROWS, Q, T, read_values, write, write_logger

MOST_SECONDS = 60.0  # 10 s of computing, on a machine that others share


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
