"""MATLAB files of every level: what is inside becomes channels with the right names, units, times and numbers, or is told."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from clutch_hil.recordings.channel import choose_channel
from clutch_hil.recordings.format import open_recording, recognise
from clutch_hil.recordings.import_map import load_map
from protocols.errors import InputError
from tests.clutch_hil.recordings.matlab_files import (
    ROWS,
    F,
    Q,
    T,
    make_array,
    make_column,
    make_controldesk,
    make_element,
    make_level5,
    make_structs,
    read_values,
    write,
)


@pytest.mark.parametrize("options", [{}, {"do_compression": True}, {"format": "4"}], ids=["5", "5 deflated", "4"])
def test_vectors_matrices_and_single_numbers(tmp_path: Path, options: dict[str, Any]) -> None:
    content = {"t": T, "q": make_column(Q), "y": np.column_stack([Q, F]), "gain": 3.5, "remark": "hello"}
    recording = open_recording(write(tmp_path, content, **options))
    assert [c.path for c in recording.channels] == ["t", "q", "y(:,1)", "y(:,2)"]
    assert [c.name for c in recording.channels] == ["t", "q", "y(1)", "y(2)"]
    assert {c.raster for c in recording.channels} == {"60 rows"}
    assert recording.numbers == {"gain": 3.5}
    for path, wanted in (("t", T), ("q", Q), ("y(:,1)", Q), ("y(2)", F)):
        np.testing.assert_array_equal(read_values(recording, path), wanted)


def test_a_matrix_of_to_file_is_read_by_its_rows(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, {"ans": np.vstack([T, Q, F])}))
    assert [c.path for c in recording.channels] == ["ans(1,:)", "ans(2,:)", "ans(3,:)"]
    np.testing.assert_array_equal(read_values(recording, "ans(2)"), Q)


def test_the_rows_of_a_matrix_are_those_of_the_vectors_beside_it(tmp_path: Path) -> None:
    wide = np.arange(5 * 70.0).reshape(5, 70)
    recording = open_recording(write(tmp_path, {"t": T[:5], "y": wide}))
    assert choose_channel(tmp_path, recording.channels, "y(70)").path == "y(:,70)"
    np.testing.assert_array_equal(read_values(recording, "y(70)"), wide[:, 69])


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4"])
def test_numbers_of_every_type(tmp_path: Path, kind: str) -> None:
    stored = (100.0 * Q).astype(kind)
    recording = open_recording(write(tmp_path, {"t": T, "q": stored}))
    np.testing.assert_array_equal(read_values(recording, "q"), stored.astype(float))
    assert choose_channel(tmp_path, recording.channels, "q").kind == "number"


def test_truth_values_are_a_status(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, {"t": T, "on": T > 0.3}))
    assert [c.kind for c in recording.channels] == ["number", "status"]
    np.testing.assert_array_equal(read_values(recording, "on"), T > 0.3)


def test_numbers_above_2_to_the_53_are_told(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, {"t": T, "ns": 1_700_000_000_000_000_001 + np.arange(ROWS)}))
    read_values(recording, "ns")
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
    file.write_bytes(
        make_level5(make_array(6, (1, ROWS), b"q", make_element(9, Q.astype(">f8").tobytes(), ">"), ">"), order=">")
    )
    np.testing.assert_array_equal(read_values(open_recording(file), "q"), Q)


def test_structures_have_dotted_paths_and_short_names(tmp_path: Path) -> None:
    content = {"run": {"t": T, "left": {"f": F, "k": 2.0}, "right": {"f": Q}}}
    recording = open_recording(write(tmp_path, content))
    assert [c.path for c in recording.channels] == ["run.t", "run.left.f", "run.right.f"]
    assert recording.numbers == {"run.left.k": 2.0}
    np.testing.assert_array_equal(read_values(recording, "t"), T)
    np.testing.assert_array_equal(read_values(recording, "run.right.f"), Q)
    with pytest.raises(InputError, match=r"has 2 columns 'f'; select one by `from`: 'run.left.f', 'run.right.f'"):
        read_values(recording, "f")


def test_a_structure_array_of_vectors_and_one_of_single_numbers(tmp_path: Path) -> None:
    runs = make_structs({"x": T}, {"x": Q})
    log = make_structs(*({"t": t, "x": q} for t, q in zip(T, Q, strict=True)))
    recording = open_recording(write(tmp_path, {"runs": runs, "log": log}))
    assert [c.path for c in recording.channels] == ["runs(1).x", "runs(2).x", "log.t", "log.x"]
    np.testing.assert_array_equal(read_values(recording, "runs(2).x"), Q)
    np.testing.assert_array_equal(read_values(recording, "log.x"), Q)


def test_names_and_units_beside_an_array_are_those_of_its_columns(tmp_path: Path) -> None:
    cells = [np.array([names], dtype=object) for names in (["time", "force"], ["s", "kN"])]
    imported = {"data": np.column_stack([T, F]), "colheaders": cells[0], "units": cells[1]}
    recording = open_recording(write(tmp_path, {"A": imported}))
    assert [(c.name, c.unit, c.path) for c in recording.channels] == [
        ("time", "s", "A.data(:,1)"), ("force", "kN", "A.data(:,2)"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("names", "units"),
    [
        ("time,force", "ms,kN"),
        ("time; force", "ms; kN"),
        ("time|force", "ms kN"),
        (["time ", "force"], ["ms", "kN"]),
        (["time\0  ", "force\0 "], ["ms\0", "kN"]),  # as Dymola ends them
        ("a text, with more commas, than columns", "ms kN"),
    ],
)
def test_names_and_units_may_be_one_text_or_a_matrix_of_characters(tmp_path: Path, names: Any, units: Any) -> None:
    file = tmp_path / "labels.mat"
    savemat(file, {"data": np.column_stack([T, F]), "labels": np.array(names), "units": np.array(units)})
    channels = open_recording(file).channels
    known = ["time", "force"] if len(names) < 20 else ["data(1)", "data(2)"]
    assert [(channel.name, channel.unit) for channel in channels] == list(zip(known, ["ms", "kN"], strict=True))


@pytest.mark.parametrize("shape", [(12, 30), (30, 12), (200, 3), (3, 200)])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("label", ["names", "units"])
def test_names_or_units_tell_which_axis_has_the_columns(
    tmp_path: Path, shape: tuple[int, int], axis: int, label: str
) -> None:
    data = np.arange(shape[0] * shape[1], dtype=float).reshape(shape)
    texts = np.array(
        ["V" if label == "units" else f"channel {number}" for number in range(shape[1 - axis])], dtype=object
    )
    file = tmp_path / "labels.mat"
    savemat(file, {"data": data, label: texts})
    recording = open_recording(file)
    assert [channel.rows for channel in recording.channels] == shape[1 - axis] * [shape[axis]]
    if label == "names":
        np.testing.assert_array_equal(read_values(recording, "channel 1"), data.take(1, 1 - axis))


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
    np.testing.assert_array_equal(read_values(recording, "c{2}"), Q)


def test_controldesk(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, make_controldesk()))
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
    run = load_map(str(toml)).read(write(tmp_path, make_controldesk()))
    np.testing.assert_allclose(run["torque_nm"], F[: len(run["time_s"])], atol=1e-12)
    np.testing.assert_allclose(run["speed_rad_s"][::2], Q[::2] * 2 * np.pi / 60, atol=1e-12)


def test_a_signal_of_controldesk_without_raster_is_told(tmp_path: Path) -> None:
    y = make_structs({"Name": "a", "Data": F, "Unit": "", "XIndex": 9})
    recording = open_recording(write(tmp_path, make_controldesk(Y=y)))
    assert "rec.Y names none of the 2 rasters: by its length that of rec.X(1).Data" in recording.notes


@pytest.mark.parametrize("with_time", [True, False])
def test_a_simulink_structure(tmp_path: Path, with_time: bool) -> None:
    signals = make_structs(
        {"values": np.column_stack([Q, F]), "dimensions": 2, "label": "axis", "blockName": "m/Scope"},
        {"values": T.reshape(1, 1, -1), "dimensions": [1, 1], "label": "", "blockName": "m/Scope"},
        {"values": T > 0.3, "dimensions": 1, "label": "on", "blockName": "m/Scope"},
    )
    scope = {"time": make_column(T) if with_time else np.zeros((0, 0)), "signals": signals, "blockName": "m/Scope"}
    recording = open_recording(write(tmp_path, {"ScopeData": scope}))
    wanted = ["axis(1)", "axis(2)", "ScopeData.signals(2)", "on"]
    assert [c.name for c in recording.channels] == (["time"] if with_time else []) + wanted
    assert {c.raster for c in recording.channels} == {"ScopeData.time" if with_time else "60 rows"}
    np.testing.assert_array_equal(read_values(recording, "ScopeData.signals(1).values(:,2)"), F)
    np.testing.assert_array_equal(read_values(recording, "ScopeData.signals(2)"), T)
    assert choose_channel(tmp_path, recording.channels, "on").kind == "status"


def test_content_decides_not_the_name(tmp_path: Path) -> None:
    file = write(tmp_path, {"t": T})
    os.rename(file, tmp_path / "recording.csv")
    assert recognise(tmp_path / "recording.csv").name == "MATLAB"
