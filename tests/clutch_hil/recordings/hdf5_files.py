"""HDF5 files for tests: one as loggers write it, and others that a test fills."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from clutch_hil.recordings.channel import Recording, choose_channel

ROWS = 50


T = 0.01 * np.arange(ROWS)


Q = np.sin(T)


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
