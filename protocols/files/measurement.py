"""Measurement: a run as ASAM MF4 (MDF 4.1), as measurement and calibration tools read it.

One channel group at the run's rate with time_s as its master channel; unit and comment (the meaning) with every channel;
the run's metadata as common properties of the file's header, each value as JSON.
"""

import contextlib
import gc
import io
import json
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from xml.etree import ElementTree

import numpy as np

from protocols.errors import InputError
from protocols.files.output_file import whole_file
from protocols.files.run import Run, parse_json

if TYPE_CHECKING:
    from asammdf import Signal

_TIME = "time_s"
_VERSION = "4.10"  # every reader of MDF 4 knows it
_MASTER = 2  # MDF: type of a master channel
_SECONDS = 1  # MDF: synchronisation type of a master channel that is time in seconds
_COMPRESSION: Final = 2  # MDF: transposed, then deflated; files are a third smaller than with deflation alone
_MAGIC = b"MDF "  # first bytes of a file
_START = ("time_zero", "recorded_at")  # metadata with the time of day, ISO 8601; time_zero is that of time_s = 0


def write_mf4(run: Run, path: Path) -> None:
    """Write a run to `path`; the file appears only when it is complete. Raises InputError."""
    from asammdf import MDF, Signal

    time = run[_TIME]
    signals = [
        Signal(run[name], time, unit=unit, name=name, comment=meaning, master_metadata=(_TIME, _SECONDS))
        for name, unit, meaning in run.describe_columns()
        if name != _TIME
    ]
    with whole_file(path) as part, part.open("wb+") as file, MDF(version=_VERSION) as mdf:
        mdf.append(signals, acq_name="run", comment="one row a sample", common_timebase=True)
        mdf.groups[0].channels[0].comment = run.meanings.get(_TIME, "")
        mdf.header.comment = _header(run.metadata)
        if key := next((key for key in _START if key in run.metadata), None):
            mdf.header.start_time = _time_of_day(key, run.metadata[key])
        mdf.save(file, compression=_COMPRESSION)


def read_mf4(path: Path) -> Run:
    """Read the numeric channels of a file, which must share one raster. Raises InputError.

    Values are physical. Samples that the file marks as invalid become not-a-number.
    """
    header, master, signals = _read(path)
    if not signals:
        raise InputError(f"run {path} has no channels with numbers over time")
    time = signals[0].timestamps
    columns, units, meanings = {_TIME: time}, {_TIME: "s"}, {_TIME: master}
    for signal in signals:
        if not np.array_equal(signal.timestamps, time):
            raise InputError(
                f"run {path} has the channels {signals[0].name} and {signal.name} on different rasters; a run needs one"
            )
        if signal.name in columns:
            raise InputError(f"run {path} has the channel {signal.name} twice")
        columns[signal.name] = _values(signal)
        units[signal.name], meanings[signal.name] = signal.unit, signal.comment
    properties = ElementTree.fromstring(header).iterfind("common_properties/e")
    metadata = {entry.attrib["name"]: parse_json(entry.text or "") for entry in properties}
    return Run(columns, metadata, units, meanings)


def _read(path: Path) -> tuple[str, str, list["Signal"]]:
    """Header as XML, comment of the first master channel, channels with numbers."""
    from asammdf import MDF

    # asammdf prints errors about a damaged file, also when its objects are collected
    with contextlib.redirect_stderr(io.StringIO()):
        try:
            with path.open("rb") as file:
                if not file.read(8).startswith(_MAGIC):
                    raise InputError(f"run {path} cannot be read: it is no MDF file")
            with MDF(path) as mdf:
                signals = [
                    signal
                    for signal in mdf.iter_channels(copy_master=False)
                    if signal.samples.ndim == 1 and signal.samples.dtype.kind in "fiub" and len(signal.timestamps)
                ]
                channels = mdf.groups[signals[0].group_index].channels if signals else []
                masters = [channel.comment for channel in channels if channel.channel_type == _MASTER]
                return mdf.header.comment, (masters or [""])[0], signals
        except InputError:
            raise
        except Exception as error:  # asammdf raises many kinds
            reason = " ".join(str(error).split())
        gc.collect()
    raise InputError(f"run {path} cannot be read: {reason}")


def _values(signal: "Signal") -> np.ndarray:
    values = signal.samples.astype(float)
    if signal.invalidation_bits is not None:
        values[np.asarray(signal.invalidation_bits, bool)] = np.nan
    return values


def _time_of_day(key: str, text: Any) -> datetime:
    """The time of day in the metadata `key`. Raises InputError when `text` is none."""
    try:
        return datetime.fromisoformat(text)
    except (TypeError, ValueError):
        raise InputError(f"metadata {key} is {text!r}; allowed is a time as in ISO 8601") from None


def _header(metadata: Mapping[str, Any]) -> str:
    root = ElementTree.Element("HDcomment")
    ElementTree.SubElement(root, "TX").text = "clutch-hil run"
    properties = ElementTree.SubElement(root, "common_properties")
    for name, value in metadata.items():
        if not name.isprintable():
            raise InputError(f"metadata {name!r} cannot be written as MF4; allowed is a name of printable characters")
        ElementTree.SubElement(properties, "e", name=name).text = json.dumps(value)
    return ElementTree.tostring(root, encoding="unicode")
