"""Measurement: a run as ASAM MF4 (MDF 4.1), as measurement and calibration tools read it.

One channel group at the run's rate with time_s as its master channel; unit and comment (the meaning) with every channel;
the run's metadata as common properties of the file's header, each value as JSON.
"""

import json
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from protocols.errors import InputError
from protocols.files.bounds import check_rows
from protocols.files.mdf.conversions import TEXT
from protocols.files.mdf.file import MdfFile
from protocols.files.mdf.groups import MdfChannel, MdfGroup
from protocols.files.output_file import whole_file
from protocols.files.run import Run, parse_json

_TIME = "time_s"
_VERSION = "4.10"  # every reader of MDF 4 knows it
_SECONDS = 1  # MDF: synchronisation type of a master channel that is time in seconds
_COMPRESSION: Final = 2  # MDF: transposed, then deflated; files are a third smaller than with deflation alone
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
        mdf.header.comment = _format_header(run.metadata)
        if key := next((key for key in _START if key in run.metadata), None):
            mdf.header.start_time = _parse_time_of_day(key, run.metadata[key])
        mdf.save(file, compression=_COMPRESSION)


def read_mf4(path: Path) -> Run:
    """Read the channels of a file that hold numbers over time, which must share one raster. Raises InputError.

    Values are physical. Samples that the file marks as invalid become NaN.
    """
    file = MdfFile(path)
    clocks = [(clock, group.channels) for group in file.groups if (clock := _find_clock(group))]
    channels = [(clock, one) for clock, those in clocks for one in those if _is_number(one)]
    if not channels:
        raise InputError(f"run {path} has no channels with numbers over time")
    check_rows(f"run {path} has", max(group.rows for group in file.groups), len(channels) + 1)
    values = file.read([one for pair in channels for one in pair])
    clock, first = channels[0]
    columns, units, meanings = {_TIME: values[clock]}, {_TIME: "s"}, {_TIME: clock.comment}
    for own_clock, one in channels:
        if not np.array_equal(values[own_clock], values[clock]):
            raise InputError(
                f"run {path} has the channels {first.name} and {one.name} on different rasters; a run needs one"
            )
        if one.name in columns:
            raise InputError(f"run {path} has the channel {one.name} twice")
        columns[one.name], units[one.name], meanings[one.name] = values[one], one.unit, one.comment
    return Run(columns, _read_metadata(path, file.header), units, meanings)


def _find_clock(group: MdfGroup) -> MdfChannel | None:
    """Return the master channel of a group with rows, if it is time in seconds; else None."""
    master = group.master
    return master if group.rows and master and master.master == "time" and master.unit in ("s", "") else None


def _is_number(channel: MdfChannel) -> bool:
    return channel.kind != TEXT and not channel.master


def _read_metadata(path: Path, header: str) -> dict[str, Any]:
    """Return the metadata in the comment of a file's header, which is XML in our files and most others."""
    try:
        properties = ElementTree.fromstring(header).iterfind("common_properties/e")
        return {entry.attrib["name"]: parse_json(entry.text or "") for entry in properties}
    except (ElementTree.ParseError, KeyError, ValueError):
        return {}


def _parse_time_of_day(key: str, text: Any) -> datetime:
    """Return the time of day in the metadata `key`. Raises InputError if `text` is not a time."""
    try:
        return datetime.fromisoformat(text)
    except (TypeError, ValueError):
        raise InputError(f"metadata {key} is {text!r}; allowed is a time as in ISO 8601") from None


def _format_header(metadata: Mapping[str, Any]) -> str:
    root = ElementTree.Element("HDcomment")
    ElementTree.SubElement(root, "TX").text = "clutch-hil run"
    properties = ElementTree.SubElement(root, "common_properties")
    for name, value in metadata.items():
        if not name.isprintable():
            raise InputError(f"metadata {name!r} cannot be written as MF4; allowed is a name of printable characters")
        ElementTree.SubElement(properties, "e", name=name).text = json.dumps(value)
    return ElementTree.tostring(root, encoding="unicode")
