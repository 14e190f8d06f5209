"""MATLAB files for tests: written by scipy.io and mat-io, which share no code with the reader, or byte by byte."""

import resource
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matio.utils import MatlabOpaque
from scipy.io import savemat

from clutch_hil.recordings.channel import Recording, choose_channel

ROWS = 60
T = 0.01 * np.arange(ROWS)
Q, F = np.sin(T), np.cos(3.0 * T)
MOST_MEMORY = 200e6  # bytes that a refused file may take: the reader's own buffers are far smaller
MOST_SECONDS = 20.0


def write(tmp_path: Path, content: dict[str, Any], **options: Any) -> Path:
    file = tmp_path / "recording.mat"
    savemat(file, content, **options)
    return file


def read_values(recording: Recording, wanted: str) -> np.ndarray:
    channel = choose_channel(Path("recording.mat"), recording.channels, wanted)
    (signal,) = recording.read([channel])
    return signal.values


def make_structs(*elements: dict[str, Any]) -> np.ndarray:
    """A structure array, as savemat and mat-io take it."""
    array = np.empty((1, len(elements)), dtype=[(name, object) for name in elements[0]])
    for k, element in enumerate(elements):
        for name, value in element.items():
            array[0, k][name] = value
    return array


def make_column(values: np.ndarray) -> np.ndarray:
    return np.asarray(values, float).reshape(-1, 1)


def make_controldesk(**changed: Any) -> dict[str, Any]:
    x = make_structs(
        {"Name": "Model Root/CurrentTime", "Data": T, "Unit": "s"},
        {"Name": "", "Data": 1e3 * T[::2], "Unit": "ms"},
    )
    y = make_structs(
        {"Name": "Model Root/Plant/Torque{In1}", "Data": F, "Unit": "Nm", "XIndex": 1},
        {"Name": "Model Root/Plant/Speed", "Data": Q[::2], "Unit": "rpm", "XIndex": 2},
    )
    capture = {"SamplingPeriod": 0.01, "DateTime": "2024-05-06T07:08:09"}
    return {"rec": {"X": x, "Y": y, "Description": "a run", "Capture": capture} | changed}


def make_opaque(class_name: str, **properties: Any) -> MatlabOpaque:
    return MatlabOpaque(properties, class_name)


def make_timeseries(name: str, data: np.ndarray, unit: str = "", even: bool = False) -> MatlabOpaque:
    """As MATLAB R2023 saves one. even: times as start and increment."""
    none, time_last = np.zeros((0, 0)), data.ndim > 2
    info = make_opaque(
        "tsdata.timemetadata", Units="seconds", StartDate="", Length=np.array([[float(ROWS)]]),
        Time_=none if even else make_column(T), Increment_=np.array([[0.01]]) if even else none,
        Start_=np.array([[0.0]]) if even else none,
    )  # fmt: skip
    return make_opaque(
        "timeseries", Name=name, Data_=data, IsTimeFirst_=np.array([[not time_last]]), TimeInfo=info,
        DataInfo=make_opaque("tsdata.datametadata", Units=unit),
    )  # fmt: skip


def make_dataset(*elements: MatlabOpaque) -> MatlabOpaque:
    cell = np.empty((1, len(elements)), dtype=object)
    cell[0, :] = elements
    saved = make_structs({"Version": np.array([[2.0]]), "Elements": cell})
    storage = MatlabOpaque({"any": saved}, "Simulink.SimulationData.Storage.RamDatasetStorage")
    inside = make_structs({"Name": "", "Version": np.array([[3.0]]), "Storage": storage})
    return MatlabOpaque({"any": inside}, "Simulink.SimulationData.Dataset")


def make_logged(name: str, inside: Any) -> MatlabOpaque:
    path = make_opaque("Simulink.SimulationData.BlockPath", Path=np.array([["model/Plant"]], dtype=object))
    return make_opaque("Simulink.SimulationData.Signal", Name=name, BlockPath=path, Values=inside)


def make_objects() -> dict[str, Any]:
    bus = make_structs(
        {"v": make_timeseries("", make_column(F), "m/s"), "p": make_timeseries("", make_column(Q), "Pa")}
    )
    logs = make_dataset(
        make_timeseries("a", np.column_stack([Q, F])),
        make_timeseries("b", Q.reshape(1, 1, -1), "rad/s", even=True),
        make_logged("torque", make_timeseries("inside", make_column(F), "Nm")),
        make_logged("bus", bus),
    )
    table = pd.DataFrame({"q": Q, "gear": np.arange(ROWS) // 20})
    dates = pd.DataFrame(
        {"q": Q}, index=pd.DatetimeIndex(np.datetime64("2024-05-06T07:08:09") + 10 * np.arange(ROWS) * 1000)
    )
    output = make_opaque(
        "Simulink.SimulationOutput",
        Data=make_structs({"tout": make_column(T), "y": make_timeseries("y", make_column(F))}),
    )
    return {
        "speed": make_timeseries("n", make_column(Q), "rpm"), "logsout": logs, "out": output, "tab": table, "dated": dates,
        "plain": make_column(T), "flag": make_column(T) > 0.3, "z": 1j * make_column(T),
        "names": np.array([["a", "b"]], dtype=object),
        "nested": make_structs({"x": make_column(Q), "k": np.array([[2.0]]), "unit": "bar"}),
        "many": make_structs({"x": make_column(Q)}, {"x": make_column(F)}), "matrix": np.column_stack([Q, F]),
        "wide": np.vstack([T, Q, F]),
        "unknown": make_opaque("Their.Class", text="no numbers"),
    }  # fmt: skip


def make_element(kind: int, data: bytes, order: str = "<") -> bytes:
    return struct.pack(order + "II", kind, len(data)) + data + bytes(-len(data) % 8)


def make_array(kind: int, shape: Sequence[int], name: bytes, content: bytes, order: str = "<") -> bytes:
    """An array of level 5 as bytes, its tag included."""
    flags, sizes = struct.pack(order + "II", kind, 0), struct.pack(f"{order}{len(shape)}i", *shape)
    return make_element(
        14,
        make_element(6, flags, order) + make_element(5, sizes, order) + make_element(1, name, order) + content,
        order,
    )


def make_level5(*elements: bytes, order: str = "<") -> bytes:
    version = b"\x00\x01IM" if order == "<" else b"\x01\x00MI"
    return b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + version + b"".join(elements)


def measure_peak() -> float:
    """Most memory that this process has had, in bytes."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
