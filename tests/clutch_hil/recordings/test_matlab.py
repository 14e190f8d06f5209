"""MATLAB files of every level: what is inside becomes channels with the right names, units, times and numbers, or is told.

Files are written by scipy.io and mat-io, which share no code with the reader. It agrees with scipy.io on scipy's own files.
"""

import os
import random
import resource
import struct
import time
import zlib
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import matio
import numpy as np
import pandas as pd
import pytest
from matio.utils import MatlabOpaque
from scipy.io import loadmat, savemat

from clutch_hil.recordings.channel import Recording, choose_channel
from clutch_hil.recordings.format import open_recording, recognise
from clutch_hil.recordings.import_map import load_map
from clutch_hil.recordings.matlab.bytes import BinaryFile
from clutch_hil.recordings.matlab.level4 import is_level4, read_level4
from clutch_hil.recordings.matlab.level5 import is_level5, read_level5
from clutch_hil.recordings.matlab.value import Cell, Line, Numbers, Struct, Text
from protocols.errors import InputError
from tests import needs

ROWS = 60
T = 0.01 * np.arange(ROWS)
Q, F = np.sin(T), np.cos(3.0 * T)
MOST_MEMORY = 200e6  # bytes that a refused file may take: the reader's own buffers are far smaller
MOST_SECONDS = 20.0


def write(tmp_path: Path, content: dict[str, Any], **options: Any) -> Path:
    file = tmp_path / "recording.mat"
    savemat(file, content, **options)
    return file


def values(recording: Recording, wanted: str) -> np.ndarray:
    channel = choose_channel(Path("recording.mat"), recording.channels, wanted)
    (signal,) = recording.read([channel])
    return signal.values


def structs(*elements: dict[str, Any]) -> np.ndarray:
    """A structure array, as savemat and mat-io take it."""
    array = np.empty((1, len(elements)), dtype=[(name, object) for name in elements[0]])
    for k, element in enumerate(elements):
        for name, value in element.items():
            array[0, k][name] = value
    return array


def column(values: np.ndarray) -> np.ndarray:
    return np.asarray(values, float).reshape(-1, 1)


# --- plain variables --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{}, {"do_compression": True}, {"format": "4"}], ids=["5", "5 deflated", "4"])
def test_vectors_matrices_and_single_numbers(tmp_path: Path, options: dict[str, Any]) -> None:
    content = {"t": T, "q": column(Q), "y": np.column_stack([Q, F]), "gain": 3.5, "remark": "hello"}
    recording = open_recording(write(tmp_path, content, **options))
    assert [c.path for c in recording.channels] == ["t", "q", "y(:,1)", "y(:,2)"]
    assert [c.name for c in recording.channels] == ["t", "q", "y(1)", "y(2)"]
    assert {c.raster for c in recording.channels} == {"60 rows"}
    assert recording.numbers == {"gain": 3.5}
    for path, wanted in (("t", T), ("q", Q), ("y(:,1)", Q), ("y(2)", F)):
        np.testing.assert_array_equal(values(recording, path), wanted)


def test_a_matrix_of_to_file_is_read_by_its_rows(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, {"ans": np.vstack([T, Q, F])}))
    assert [c.path for c in recording.channels] == ["ans(1,:)", "ans(2,:)", "ans(3,:)"]
    np.testing.assert_array_equal(values(recording, "ans(2)"), Q)


def test_the_rows_of_a_matrix_are_those_of_the_vectors_beside_it(tmp_path: Path) -> None:
    wide = np.arange(5 * 70.0).reshape(5, 70)
    recording = open_recording(write(tmp_path, {"t": T[:5], "y": wide}))
    assert choose_channel(tmp_path, recording.channels, "y(70)").path == "y(:,70)"
    np.testing.assert_array_equal(values(recording, "y(70)"), wide[:, 69])


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4"])
def test_numbers_of_every_type(tmp_path: Path, kind: str) -> None:
    stored = (100.0 * Q).astype(kind)
    recording = open_recording(write(tmp_path, {"t": T, "q": stored}))
    np.testing.assert_array_equal(values(recording, "q"), stored.astype(float))
    assert choose_channel(tmp_path, recording.channels, "q").kind == "number"


def test_truth_values_are_a_status(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, {"t": T, "on": T > 0.3}))
    assert [c.kind for c in recording.channels] == ["number", "status"]
    np.testing.assert_array_equal(values(recording, "on"), T > 0.3)


def test_numbers_above_2_to_the_53_are_told(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, {"t": T, "ns": 1_700_000_000_000_000_001 + np.arange(ROWS)}))
    values(recording, "ns")
    assert recording.notes == ["ns: whole numbers above 2^53 have lost their last digits"]


def test_what_cannot_be_a_column_is_told_by_name(tmp_path: Path) -> None:
    from scipy.sparse import csc_array

    content = {"t": T, "z": 1j * T, "s": csc_array(np.eye(3)), "cube": np.ones((3, 4, 5)), "empty": np.zeros((0, 3))}
    (note,) = open_recording(write(tmp_path, content)).notes
    assert note == (
        "left out z (complex numbers: save real(...) and imag(...)); s (a sparse matrix: save full(...));"
        " cube (an array of 3 x 4 x 5 numbers)"
    )


def test_a_file_of_big_endian_bytes_is_read(tmp_path: Path) -> None:
    file = tmp_path / "recording.mat"
    file.write_bytes(level5(array(6, (1, ROWS), b"q", element(9, Q.astype(">f8").tobytes(), ">"), ">"), order=">"))
    np.testing.assert_array_equal(values(open_recording(file), "q"), Q)


# --- structures and cells ---------------------------------------------------------------------------------------------


def test_structures_have_dotted_paths_and_short_names(tmp_path: Path) -> None:
    content = {"run": {"t": T, "left": {"f": F, "k": 2.0}, "right": {"f": Q}}}
    recording = open_recording(write(tmp_path, content))
    assert [c.path for c in recording.channels] == ["run.t", "run.left.f", "run.right.f"]
    assert recording.numbers == {"run.left.k": 2.0}
    np.testing.assert_array_equal(values(recording, "t"), T)
    np.testing.assert_array_equal(values(recording, "run.right.f"), Q)
    with pytest.raises(InputError, match=r"has 2 columns 'f'; ask for one by `from`: 'run.left.f', 'run.right.f'"):
        values(recording, "f")


def test_a_structure_array_of_vectors_and_one_of_single_numbers(tmp_path: Path) -> None:
    runs = structs({"x": T}, {"x": Q})
    log = structs(*({"t": t, "x": q} for t, q in zip(T, Q, strict=True)))
    recording = open_recording(write(tmp_path, {"runs": runs, "log": log}))
    assert [c.path for c in recording.channels] == ["runs(1).x", "runs(2).x", "log.t", "log.x"]
    np.testing.assert_array_equal(values(recording, "runs(2).x"), Q)
    np.testing.assert_array_equal(values(recording, "log.x"), Q)


def test_names_and_units_beside_an_array_are_those_of_its_columns(tmp_path: Path) -> None:
    cells = [np.array([names], dtype=object) for names in (["time", "force"], ["s", "kN"])]
    imported = {"data": np.column_stack([T, F]), "colheaders": cells[0], "units": cells[1]}
    recording = open_recording(write(tmp_path, {"A": imported}))
    assert [(c.name, c.unit, c.path) for c in recording.channels] == [
        ("time", "s", "A.data(:,1)"), ("force", "kN", "A.data(:,2)"),
    ]  # fmt: skip


def test_a_unit_beside_one_array_is_its_own(tmp_path: Path) -> None:
    content = {"p": {"time": T, "values": Q, "unit": "bar"}, "two": {"a": T, "b": Q, "unit": "bar", "b_unit": "V"}}
    recording = open_recording(write(tmp_path, content))
    assert [(c.path, c.unit) for c in recording.channels] == [
        ("p.time", ""), ("p.values", "bar"), ("two.a", ""), ("two.b", "V"),
    ]  # fmt: skip


def test_cells_of_vectors_and_of_texts(tmp_path: Path) -> None:
    cell = np.empty((1, 3), dtype=object)
    cell[0, :] = [T, Q, "text"]
    words = np.array([["low", "high", "low"]], dtype=object)
    recording = open_recording(write(tmp_path, {"c": cell, "words": words}))
    assert [(c.path, c.kind, c.rows) for c in recording.channels] == [
        ("c{1}", "number", ROWS), ("c{2}", "number", ROWS), ("words", "text", 3),
    ]  # fmt: skip
    np.testing.assert_array_equal(values(recording, "c{2}"), Q)


# --- tools ------------------------------------------------------------------------------------------------------------


def controldesk(**changed: Any) -> dict[str, Any]:
    x = structs(
        {"Name": "Model Root/CurrentTime", "Data": T, "Unit": "s"},
        {"Name": "", "Data": 1e3 * T[::2], "Unit": "ms"},
    )
    y = structs(
        {"Name": "Model Root/Plant/Torque{In1}", "Data": F, "Unit": "Nm", "XIndex": 1},
        {"Name": "Model Root/Plant/Speed", "Data": Q[::2], "Unit": "rpm", "XIndex": 2},
    )
    capture = {"SamplingPeriod": 0.01, "DateTime": "2024-05-06T07:08:09"}
    return {"rec": {"X": x, "Y": y, "Description": "a run", "Capture": capture} | changed}


def test_controldesk(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, controldesk()))
    assert [(c.name, c.unit, c.raster, c.kind) for c in recording.channels] == [
        ("Model Root/CurrentTime", "s", "rec.X(1).Data", "time"),
        ("time", "s", "rec.X(2).Data", "time"),
        ("Model Root/Plant/Torque{In1}", "Nm", "rec.X(1).Data", "number"),
        ("Model Root/Plant/Speed", "rpm", "rec.X(2).Data", "number"),
    ]
    fast, slow, torque, speed = recording.read(recording.channels)
    assert slow.time is not None
    assert speed.time is not None
    np.testing.assert_array_equal(torque.values, F)
    np.testing.assert_array_equal(fast.values, T)
    np.testing.assert_allclose(slow.values, T[::2], rtol=1e-12)
    np.testing.assert_allclose(speed.time, T[::2], rtol=1e-12)
    assert recording.channels[3].rate_hz == pytest.approx(50.0)
    assert recording.start == "2024-05-06T07:08:09"
    assert "rec: Description is a run" in recording.notes
    assert "rec: Capture.SamplingPeriod is 0.01" in recording.notes


def test_rasters_of_controldesk_are_joined_by_a_map(tmp_path: Path) -> None:
    toml = tmp_path / "map.toml"
    toml.write_text(
        '[file]\nresample_hz = 100.0\n[columns]\ntime_s = { from = "Model Root/CurrentTime" }\n'
        'torque_nm = { from = "Model Root/Plant/Torque{In1}" }\nspeed_rad_s = { from = "Model Root/Plant/Speed" }\n'
    )
    run = load_map(str(toml)).read(write(tmp_path, controldesk()))
    np.testing.assert_allclose(run["torque_nm"], F[: len(run["time_s"])], atol=1e-12)
    np.testing.assert_allclose(run["speed_rad_s"][::2], Q[::2] * 2 * np.pi / 60, atol=1e-12)


def test_a_signal_of_controldesk_without_raster_is_told(tmp_path: Path) -> None:
    y = structs({"Name": "a", "Data": F, "Unit": "", "XIndex": 9})
    recording = open_recording(write(tmp_path, controldesk(Y=y)))
    assert "rec.Y names none of the 2 rasters: by its length that of rec.X(1).Data" in recording.notes


@pytest.mark.parametrize("with_time", [True, False])
def test_a_simulink_structure(tmp_path: Path, with_time: bool) -> None:
    signals = structs(
        {"values": np.column_stack([Q, F]), "dimensions": 2, "label": "axis", "blockName": "m/Scope"},
        {"values": T.reshape(1, 1, -1), "dimensions": [1, 1], "label": "", "blockName": "m/Scope"},
        {"values": T > 0.3, "dimensions": 1, "label": "on", "blockName": "m/Scope"},
    )
    scope = {"time": column(T) if with_time else np.zeros((0, 0)), "signals": signals, "blockName": "m/Scope"}
    recording = open_recording(write(tmp_path, {"ScopeData": scope}))
    wanted = ["axis(1)", "axis(2)", "ScopeData.signals(2)", "on"]
    assert [c.name for c in recording.channels] == (["time"] if with_time else []) + wanted
    assert {c.raster for c in recording.channels} == {"ScopeData.time" if with_time else "60 rows"}
    np.testing.assert_array_equal(values(recording, "ScopeData.signals(1).values(:,2)"), F)
    np.testing.assert_array_equal(values(recording, "ScopeData.signals(2)"), T)
    assert choose_channel(tmp_path, recording.channels, "on").kind == "status"


# --- objects, and level 7.3 ---------------------------------------------------------------------------------------------


def opaque(class_name: str, **properties: Any) -> MatlabOpaque:
    return MatlabOpaque(properties, class_name)


def timeseries(name: str, data: np.ndarray, unit: str = "", even: bool = False) -> MatlabOpaque:
    """As MATLAB R2023 saves one. even: times as start and increment."""
    none, time_last = np.zeros((0, 0)), data.ndim > 2
    info = opaque(
        "tsdata.timemetadata", Units="seconds", StartDate="", Length=np.array([[float(ROWS)]]),
        Time_=none if even else column(T), Increment_=np.array([[0.01]]) if even else none,
        Start_=np.array([[0.0]]) if even else none,
    )  # fmt: skip
    return opaque(
        "timeseries", Name=name, Data_=data, IsTimeFirst_=np.array([[not time_last]]), TimeInfo=info,
        DataInfo=opaque("tsdata.datametadata", Units=unit),
    )  # fmt: skip


def dataset(*elements: MatlabOpaque) -> MatlabOpaque:
    cell = np.empty((1, len(elements)), dtype=object)
    cell[0, :] = elements
    saved = structs({"Version": np.array([[2.0]]), "Elements": cell})
    storage = MatlabOpaque({"any": saved}, "Simulink.SimulationData.Storage.RamDatasetStorage")
    inside = structs({"Name": "", "Version": np.array([[3.0]]), "Storage": storage})
    return MatlabOpaque({"any": inside}, "Simulink.SimulationData.Dataset")


def logged(name: str, inside: Any) -> MatlabOpaque:
    path = opaque("Simulink.SimulationData.BlockPath", Path=np.array([["model/Plant"]], dtype=object))
    return opaque("Simulink.SimulationData.Signal", Name=name, BlockPath=path, Values=inside)


def objects() -> dict[str, Any]:
    bus = structs({"v": timeseries("", column(F), "m/s"), "p": timeseries("", column(Q), "Pa")})
    logs = dataset(
        timeseries("a", np.column_stack([Q, F])),
        timeseries("b", Q.reshape(1, 1, -1), "rad/s", even=True),
        logged("torque", timeseries("inside", column(F), "Nm")),
        logged("bus", bus),
    )
    table = pd.DataFrame({"q": Q, "gear": np.arange(ROWS) // 20})
    dates = pd.DataFrame(
        {"q": Q}, index=pd.DatetimeIndex(np.datetime64("2024-05-06T07:08:09") + 10 * np.arange(ROWS) * 1000)
    )
    output = opaque("Simulink.SimulationOutput", Data=structs({"tout": column(T), "y": timeseries("y", column(F))}))
    return {
        "speed": timeseries("n", column(Q), "rpm"), "logsout": logs, "out": output, "tab": table, "dated": dates,
        "plain": column(T), "flag": column(T) > 0.3, "z": 1j * column(T), "names": np.array([["a", "b"]], dtype=object),
        "nested": structs({"x": column(Q), "k": np.array([[2.0]]), "unit": "bar"}),
        "many": structs({"x": column(Q)}, {"x": column(F)}), "matrix": np.column_stack([Q, F]), "wide": np.vstack([T, Q, F]),
        "unknown": opaque("Their.Class", text="no numbers"),
    }  # fmt: skip


OBJECTS: dict[str, tuple[str, str, str, np.ndarray]] = {  # path -> name, unit, kind, values
    "speed.Time": ("Time", "s", "time", T),
    "speed.Data": ("n", "rpm", "number", Q),
    "logsout{1}.Data(:,2)": ("a(2)", "", "number", F),
    "logsout{2}.Data": ("b", "rad/s", "number", Q),
    "logsout{2}.Time": ("Time", "s", "time", T),
    "logsout{3}.Values.Data": ("torque", "Nm", "number", F),
    "logsout{4}.Values.v.Data": ("v", "m/s", "number", F),
    "out.tout": ("tout", "", "number", T),
    "out.y.Data": ("y", "", "number", F),
    "tab.q": ("q", "", "number", Q),
    "tab.gear": ("gear", "", "number", np.arange(ROWS) // 20),
    "plain": ("plain", "", "number", T),
    "flag": ("flag", "", "status", T > 0.3),
    "nested.x": ("x", "bar", "number", Q),
    "many(2).x": ("x", "", "number", F),
    "matrix(:,2)": ("b", "", "number", F),  # by `names`, which stands beside it
    "wide(3,:)": ("wide(3)", "", "number", F),
}


@pytest.fixture(scope="module", params=["v7", "v7.3"])
def with_objects(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    file = tmp_path_factory.mktemp("objects") / "recording.mat"
    matio.save_to_mat(file, objects(), version=request.param)
    return open_recording(file)


def test_objects_of_simulink_and_tables_are_read(with_objects: Recording) -> None:
    by_path = {c.path: c for c in with_objects.channels}
    chosen = [by_path[path] for path in OBJECTS]
    for signal, (name, unit, kind, wanted) in zip(with_objects.read(chosen), OBJECTS.values(), strict=True):
        assert (signal.channel.name, signal.channel.unit, signal.channel.kind) == (name, unit, kind), (
            signal.channel.path
        )
        np.testing.assert_allclose(signal.values, wanted, rtol=1e-12, err_msg=signal.channel.path)
    (signal,) = with_objects.read([by_path["logsout{2}.Data"]])
    assert signal.time is not None
    np.testing.assert_allclose(signal.time, T, rtol=1e-12)
    assert by_path["logsout{3}.Values.Data"].comment == "model/Plant"
    assert with_objects.numbers["nested.k"] == 2.0


def test_the_rows_of_a_timetable_have_times(with_objects: Recording) -> None:
    channel = choose_channel(Path("x"), with_objects.channels, "dated.q")
    (signal,) = with_objects.read([channel])
    np.testing.assert_array_equal(signal.values, Q)
    assert signal.time is not None
    assert signal.time[0] == 0.0
    assert with_objects.start == "2024-05-06T07:08:09"


def test_objects_that_cannot_be_read_are_told_with_what_to_save(with_objects: Recording) -> None:
    told = with_objects.notes[-1]
    assert "unknown (an object of the class Their.Class: save its numbers as vectors or a structure)" in told
    assert "z (complex numbers: save real(...) and imag(...))" in told


# --- the reader and scipy.io --------------------------------------------------------------------------------------------


@pytest.mark.needs("scipy's files")
@pytest.mark.parametrize("file", needs.SCIPY_FILES, ids=lambda file: file.stem)
def test_all_values_are_those_that_scipy_reads(file: Path) -> None:
    head = file.read_bytes()[:4096]
    try:
        wanted = loadmat(file)
    except NotImplementedError:  # 7.3
        return
    with BinaryFile(file) as binary:
        variables = read_level5(binary) if is_level5(head) else read_level4(binary)
        assert is_level5(head) or is_level4(head)
        assert set(variables) == {name for name in wanted if not name.startswith("__")}
        for name, value in variables.items():
            check_equal(value, wanted[name])


def check_equal(value: Any, wanted: Any) -> None:
    if isinstance(value, Numbers):
        if not value.size or value.imaginary:
            assert value.imaginary == np.iscomplexobj(wanted)
            return
        assert value.shape == wanted.shape
        for axis in (0, len(value.shape) - 1):
            lines = [
                Line(axis, fixed)
                for fixed in product(*(range(1 if i == axis else n) for i, n in enumerate(value.shape)))
            ]
            for line, numbers in zip(lines, value.read(lines), strict=True):
                index = tuple(slice(None) if i == axis else n for i, n in enumerate(line.fixed))
                np.testing.assert_array_equal(numbers, wanted[index].astype(float))
    elif isinstance(value, Text):
        assert [row.rstrip() for row in value.rows] == [str(text).rstrip() for text in wanted.ravel()]
    elif isinstance(value, Struct):
        assert tuple(value.fields) == (wanted.dtype.names or ())
        for number, element in enumerate(wanted.ravel(order="F")):
            for name, inside in value.element(number).items():
                check_equal(inside, element[name])
    elif isinstance(value, Cell):
        for inside, element in zip(value.items, wanted.ravel(order="F"), strict=True):
            check_equal(inside, element)


# --- what is no MATLAB file, or a damaged one ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "head",
    [
        b"time,torque\n0,1\n", b"\x00" * 200, b"MDF     4.10    ", b"TDSm" + bytes(100), b"PAR1" + bytes(60),
        b"LOGG" + bytes(140), b"(1.0) can0 100#00\n", b"t\tx\n0\t1\n", b"\xff\xfet\x00,\x00x\x00",
        struct.pack("<5i", 0, 3, 1, 0, 2) + b"\x01\x00",
        struct.pack("<5i", 2000, 3, 1, 0, 2) + b"a\x00", struct.pack("<5i", 0, -3, 1, 0, 2) + b"a\x00",
    ],
)  # fmt: skip
def test_a_file_of_another_format_is_not_taken_for_level_4(head: bytes) -> None:
    assert not is_level4(head)
    assert not is_level5(head)


def element(kind: int, data: bytes, order: str = "<") -> bytes:
    return struct.pack(order + "II", kind, len(data)) + data + bytes(-len(data) % 8)


def array(kind: int, shape: Sequence[int], name: bytes, content: bytes, order: str = "<") -> bytes:
    """An array of level 5 as bytes, its tag included."""
    flags, sizes = struct.pack(order + "II", kind, 0), struct.pack(f"{order}{len(shape)}i", *shape)
    return element(14, element(6, flags, order) + element(5, sizes, order) + element(1, name, order) + content, order)


def level5(*elements: bytes, order: str = "<") -> bytes:
    version = b"\x00\x01IM" if order == "<" else b"\x01\x00MI"
    return b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + version + b"".join(elements)


def nested_cells(depth: int) -> bytes:
    inside = array(6, (1, 1), b"", element(9, struct.pack("<d", 1.0)))
    heads, size = [], len(inside)
    for level in range(depth):
        name = element(1, b"a" if level == depth - 1 else b"")
        head = element(6, struct.pack("<II", 1, 0)) + element(5, struct.pack("<ii", 1, 1)) + name
        size += len(head)
        heads.append(struct.pack("<II", 14, size) + head)
        size += 8
    return b"".join(reversed(heads)) + inside


def bomb() -> bytes:
    """A file of 3 MB that inflates to 3 GiB: a cell of an array of zeros, and of one behind it."""
    rows, columns, step = 1 << 16, 3 << 14, 1 << 24
    size = rows * columns
    flags = element(6, struct.pack("<II", 9, 0)) + element(5, struct.pack("<ii", rows, columns)) + element(1, b"")
    zeros = struct.pack("<II", 14, len(flags) + 8 + size) + flags + struct.pack("<II", 2, size)
    behind = array(6, (1, 1), b"", element(9, struct.pack("<d", 1.0)))
    cell = element(6, struct.pack("<II", 1, 0)) + element(5, struct.pack("<ii", 1, 2)) + element(1, b"c")
    packer = zlib.compressobj(9)
    packed = packer.compress(struct.pack("<II", 14, len(cell) + len(zeros) + size + len(behind)) + cell + zeros)
    packed += packer.flush(zlib.Z_FULL_FLUSH)
    block = packer.compress(bytes(step)) + packer.flush(zlib.Z_FULL_FLUSH)
    packed += block * (size // step) + packer.compress(behind) + packer.flush()
    return level5(struct.pack("<II", 15, len(packed)) + packed)


DAMAGED: dict[str, Callable[[], bytes]] = {
    "head only": lambda: level5(),
    "cut in a tag": lambda: level5(b"\x0e\x00\x00\x00"),
    "cut in an array": lambda: level5(array(6, (1, 60), b"t", element(9, T.tobytes()))[:-40]),
    "more numbers than bytes": lambda: level5(array(6, (50000, 50000), b"t", element(9, T.tobytes()))),
    "negative shape": lambda: level5(array(6, (-1, 60), b"t", element(9, T.tobytes()))),
    "2^62 cells": lambda: level5(array(1, (2**31 - 1, 2**31 - 1), b"c", b"")),
    "2^31 structures without fields": lambda: level5(array(2, (2**31 - 1, 1), b"s", element(5, b"\1\0\0\0") + element(1, b""))),
    "unknown class": lambda: level5(array(99, (1, 1), b"x", b"")),
    "cells in cells 100000 deep": lambda: level5(nested_cells(100_000)),
    "many cells": lambda: level5(array(1, (500_000, 1), b"c", struct.pack("<II", 14, 0) * 500_000)),
    "level 4 with huge shape": lambda: struct.pack("<5i", 0, 2**31 - 1, 2**31 - 1, 0, 2) + b"a\x00",
    "7.3 cut after its first bytes": lambda: b"MATLAB 7.3 MAT-file".ljust(600),
}  # fmt: skip


@pytest.mark.parametrize("kind", DAMAGED)
def test_a_damaged_file_is_refused_in_one_sentence(tmp_path: Path, kind: str) -> None:
    file = tmp_path / "recording.mat"
    file.write_bytes(DAMAGED[kind]())
    begin, before = time.monotonic(), peak()
    with pytest.raises(InputError, match=str(file)) as refused:
        open_recording(file)
    assert "\n" not in str(refused.value)
    assert time.monotonic() - begin < MOST_SECONDS
    assert peak() - before < MOST_MEMORY


def test_a_zip_bomb_takes_neither_memory_nor_time(tmp_path: Path) -> None:
    file = tmp_path / "recording.mat"
    file.write_bytes(bomb())
    before, begin = peak(), time.process_time()
    with pytest.raises(InputError, match="inflates to more than 1 GiB; save fewer variables in one file"):
        open_recording(file)
    assert time.process_time() - begin < MOST_SECONDS
    assert peak() - before < MOST_MEMORY


def peak() -> float:
    """Most memory that this process has had, in bytes."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def test_a_changed_byte_in_a_deflated_array_is_told(tmp_path: Path) -> None:
    file = write(tmp_path, {"t": np.random.default_rng(1).normal(size=5000)}, do_compression=True)
    raw = bytearray(file.read_bytes())
    raw[len(raw) // 2] ^= 1
    file.write_bytes(raw)
    with pytest.raises(InputError, match="damaged"):
        values(open_recording(file), "t")


SEEDS: dict[str, Callable[[Path], None]] = {
    "vectors": lambda file: savemat(file, {"t": T, "y": np.column_stack([Q, F]), "k": 2.0, "s": {"a": Q, "n": "x"}}),
    "deflated": lambda file: savemat(file, {"t": T, "s": {"a": {"b": Q}}, "c": np.array([T, "x"], object)}, do_compression=1),
    "level 4": lambda file: savemat(file, {"t": T, "y": np.column_stack([Q, F]), "n": "text"}, format="4"),
    "controldesk": lambda file: savemat(file, controldesk()),
    "objects": lambda file: matio.save_to_mat(file, objects(), version="v7", do_compression=False),
}  # fmt: skip


@pytest.mark.parametrize("seed", SEEDS)
def test_mutated_files_are_read_or_refused_in_one_sentence(tmp_path: Path, seed: str) -> None:
    original = tmp_path / "seed.mat"
    SEEDS[seed](original)
    raw, chance, before = original.read_bytes(), random.Random(seed), peak()
    sentences: list[str] = []
    for number in range(60):
        file = tmp_path / f"{number}.mat"
        file.write_bytes(mutated(raw, chance))
        begin = time.monotonic()
        try:
            recording = open_recording(file)
            recording.read(recording.channels)
        except InputError as refused:
            sentences.append(str(refused))
        assert time.monotonic() - begin < MOST_SECONDS
    assert peak() - before < MOST_MEMORY
    assert sentences
    assert not any("\n" in sentence for sentence in sentences)


def mutated(raw: bytes, chance: random.Random) -> bytes:
    """A file with a few changes: cut, bytes changed, numbers made huge, a piece lost or doubled."""
    data = bytearray(raw)
    kind, at = chance.randrange(5), chance.randrange(len(raw))
    piece = slice(at, at + chance.randrange(1, 200))
    if kind == 0:
        return bytes(data[:at])
    if kind == 1:
        for _ in range(10):
            data[chance.randrange(len(data))] = chance.randrange(256)
    elif kind == 2:
        at &= ~3
        data[at : at + 4] = chance.choice([b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", bytes(4), b"\x00\x00\x00\x40"])
    elif kind == 3:
        del data[piece]
    else:
        data[at:at] = data[piece]
    return bytes(data)


def test_content_decides_not_the_name(tmp_path: Path) -> None:
    file = write(tmp_path, {"t": T})
    os.rename(file, tmp_path / "recording.csv")
    assert recognise(tmp_path / "recording.csv").name == "MATLAB"
