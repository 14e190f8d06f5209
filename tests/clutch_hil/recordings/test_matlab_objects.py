"""Objects in MATLAB files, level 5 and 7.3: those of Simulink and tables are read, others told with what to save."""

from pathlib import Path

import matio
import numpy as np
import pytest

from clutch_hil.recordings.channel import Recording, choose_channel
from clutch_hil.recordings.format import open_recording
from tests.clutch_hil.recordings.matlab_files import ROWS, F, Q, T, make_objects

OBJECTS: dict[str, tuple[str, str, str, np.ndarray]] = {  # path -> name, unit, kind, values
    "speed.Time": ("Time", "s", "time", T),
    "speed.Data": ("n", "rpm", "number", Q),
    "logsout{1}.Data(:,2)": ("a(2)", "", "number", F),
    "logsout{2}.Data": ("b", "rad/s", "number", Q),
    "logsout{2}.Time": ("Time", "s", "time", T),
    "logsout{3}.Values.Data": ("torque", "Nm", "number", F),
    "logsout{4}.Values.v.Data": ("v", "m/s", "number", F),
    "out.tout": ("tout", "s", "number", T),
    "out.y.Data": ("y", "", "number", F),
    "tab.q": ("q", "", "number", Q),
    "tab.gear": ("gear", "", "number", np.arange(ROWS) // 20),
    "plain": ("plain", "", "number", T),
    "flag": ("flag", "", "status", T > 0.3),
    "nested.x": ("x", "bar", "number", Q),
    "many(2).x": ("x", "", "number", F),
    "matrix(:,2)": ("b", "", "number", F),  # by `names`, which is next to it
    "wide(3,:)": ("wide(3)", "", "number", F),
}


@pytest.fixture(scope="module", params=["v7", "v7.3"])
def with_objects(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    file = tmp_path_factory.mktemp("objects") / "recording.mat"
    matio.save_to_mat(file, make_objects(), version=request.param)
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
    sentence = with_objects.notes[-1]
    assert "unknown (an object of the class Their.Class: save its numbers as vectors or a structure)" in sentence
    assert "z (complex numbers: save real(...) and imag(...))" in sentence
