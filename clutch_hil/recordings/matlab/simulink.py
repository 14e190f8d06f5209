"""What Simulink logs: the structure with time, timeseries, Dataset with its signals, SimulationOutput. Times are seconds.

Source: MathWorks, Simulink, "Data Format for Logged Simulation Data"; what is inside objects: files from 2023, 2024.
"""

from collections.abc import Mapping

import numpy as np

from clutch_hil.recordings.matlab.layouts import About, Layout, Walk
from clutch_hil.recordings.matlab.objects import Object
from clutch_hil.recordings.matlab.texts import read_texts, to_text
from clutch_hil.recordings.matlab.value import Cell, Gathered, Numbers, Struct, Value
from clutch_hil.recordings.stated_date import read_date
from clutch_hil.recordings.stated_unit import list_unit_keys
from protocols.files.bounds import check_rows

# Units of a timeseries' times, in s
_TIME_UNITS = {
    "": 1.0, "nanoseconds": 1e-9, "microseconds": 1e-6, "milliseconds": 1e-3, "seconds": 1.0, "minutes": 60.0, "hours": 3600.0,
    "days": 86400.0, "weeks": 604800.0,
}  # fmt: skip


class StructureWithTime(Layout):
    """time, and signals(k) with values, label and blockName; also without time (`Structure`)."""

    def add(self, walk: Walk, value: Value, path: str, about: About, depth: int) -> bool:
        fields = value.read_element(0) if isinstance(value, Struct) and value.size == 1 else {}
        signals, time = fields.get("signals"), fields.get("time")
        if not (isinstance(signals, Struct) and "values" in signals.fields):
            return False
        axis = walk.add_time(time, f"{path}.time", "time") if isinstance(time, Numbers) else None
        for k in range(signals.size):
            one, here = signals.read_element(k), f"{path}.signals" if signals.size == 1 else f"{path}.signals({k + 1})"
            label = to_text(one.get("label")) or (about.name if signals.size == 1 else here)
            block = to_text(one.get("blockName")) or to_text(fields.get("blockName")) or to_text(one.get("title"))
            names = read_texts(one.get("label"))
            units = next((texts for key in list_unit_keys(one) if any(texts := read_texts(one[key]))), [])
            unit, many = (units[0], []) if len(units) == 1 else ("", units)
            walk.walk(one.get("values"), f"{here}.values", About(label, unit, block, axis, names, many), depth + 1)
        return True


class Timeseries(Layout):
    """An object of the class timeseries, or the structure of it: Data, Time or TimeInfo, DataInfo.Units."""

    def add(self, walk: Walk, value: Value, path: str, about: About, depth: int) -> bool:
        is_object = isinstance(value, Object) and len(value.numbers) == 1
        fields = (
            value.fields
            if is_object
            else value.read_element(0)
            if isinstance(value, Struct) and value.size == 1
            else {}
        )
        data = _find_first_array(fields, "Data_", "Data")
        info = _list_fields(fields.get("TimeInfo"))
        if data is None or not ("TimeInfo" in fields or (is_object and "Time" in fields)):
            return False
        units = to_text(info.get("Units"))
        name = to_text(fields.get("Name"))
        name = about.name if name in ("", "unnamed") else name
        factor = _TIME_UNITS.get(units)
        axis = None
        if factor is None:
            walk.found.notes.append(f"{path}: its times are in {units!r}, which is unknown; they are left out")
        else:
            times = (
                _find_first_array(fields, "Time", "Time_")
                or _find_first_array(info, "Time_", "Time")
                or _make_even_times(walk, path, info, data)
            )
            axis = walk.add_time(times, f"{path}.Time", "Time", factor) if times is not None else None
        if date := to_text(info.get("StartDate")):
            walk.found.notes.append(f"{path}: time 0 is {date}")
            walk.found.starts += filter(None, [read_date(date)])
        first = fields.get("IsTimeFirst_", fields.get("IsTimeFirst"))
        unit = _list_fields(fields.get("DataInfo")).get("Units")
        unit_text = to_text(unit) or to_text(_list_fields(unit).get("Name")) or about.unit
        time_last = isinstance(first, Numbers) and first.scalar == 0.0
        name = about.name if about.is_label else name
        walk.add(data, f"{path}.Data", About(name, unit_text, about.comment, axis, time_last=time_last))
        return True


class Dataset(Layout):
    """Simulink.SimulationData.Dataset: elements that are signals, timeseries, ..., each with a name."""

    def add(self, walk: Walk, value: Value, path: str, about: About, depth: int) -> bool:
        if not isinstance(value, Object) or value.class_name != "Simulink.SimulationData.Dataset":
            return False
        fields = value.fields
        elements = _list_fields(fields.get("Storage")).get("Elements", fields.get("Elements"))
        if not isinstance(elements, Cell):
            return False
        for k, item in enumerate(elements.items, 1):
            walk.walk(item, f"{path}{{{k}}}", About(f"{about.name}{{{k}}}"), depth + 1)
        return True


class Signal(Layout):
    """An element of a Dataset, such as Simulink.SimulationData.Signal: Name, BlockPath, Values."""

    def add(self, walk: Walk, value: Value, path: str, about: About, depth: int) -> bool:
        fields = value.fields if isinstance(value, Object) and len(value.numbers) == 1 else {}
        if not {"Name", "Values"} <= set(fields):
            return False
        block = " / ".join(read_texts(_list_fields(fields.get("BlockPath")).get("Path")))
        name = (
            to_text(fields.get("Name"))
            or to_text(fields.get("PropagatedName"))
            or block.rpartition("/")[2]
            or about.name
        )
        inside = fields["Values"]
        if isinstance(inside, Struct):  # a bus: a structure of timeseries, at any depth
            walk.walk(inside, f"{path}.Values", About(name), depth + 1)
        else:
            walk.walk(inside, f"{path}.Values", About(name, "", block, is_label=True), depth + 1)
        return True


class SimulationOutput(Layout):
    """What sim returns: everything logged, by name. What it says about the model is left out."""

    def add(self, walk: Walk, value: Value, path: str, about: About, depth: int) -> bool:
        if not isinstance(value, Object) or value.class_name != "Simulink.SimulationOutput":
            return False
        data = value.fields.get("Data")
        fields = data.read_element(0) if isinstance(data, Struct) and data.size == 1 else {}
        if not fields:
            fields = {name: one for name, one in value.fields.items() if "Metadata" not in name}
        walk.walk_fields(fields, path, depth + 1)
        return True


def _list_fields(value: Value) -> Mapping[str, Value]:
    if isinstance(value, Struct) and value.size:
        return value.read_element(0)
    return value.fields if isinstance(value, Object) else {}


def _find_first_array(fields: Mapping[str, Value], *names: str) -> Numbers | None:
    return next((v for name in names if isinstance(v := fields.get(name), Numbers) and v.size), None)


def _make_even_times(walk: Walk, path: str, info: Mapping[str, Value], data: Numbers) -> Numbers | None:
    """Times that are stored as start, increment and length."""

    def read_number(*names: str) -> float | None:
        array = _find_first_array(info, *names)
        return array.scalar if array is not None else None

    start, step, rows = read_number("Start_", "Start"), read_number("Increment_", "Increment"), read_number("Length")
    if step is None or rows not in data.shape:  # the length is that of data that are there
        return None
    check_rows(f"{path} has", rows, 1)
    times = (start or 0.0) + step * np.arange(int(rows))
    return Numbers((len(times), 1), "f", Gathered(times))
