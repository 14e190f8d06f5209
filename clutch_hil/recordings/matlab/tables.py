"""Classes of MATLAB that hold columns or times: table, timetable, duration, datetime, categorical.

Source: what they save of themselves, "Field Contents" of mat-io (github.com/foreverallama/matio).
"""

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from clutch_hil.recordings.matlab.layouts import About, Layout, TimeAxis, Walk
from clutch_hil.recordings.matlab.objects import Object
from clutch_hil.recordings.matlab.texts import read_texts, to_text
from clutch_hil.recordings.matlab.value import Cell, Gathered, Line, Numbers, Struct, Translated, Value
from clutch_hil.recordings.state_names import value_states
from protocols.files.bounds import check_rows

_MILLISECONDS = 1e-3  # s: in which durations and dates are stored


class Table(Layout):
    """Columns with names and units; a timetable's rows have times."""

    def add(self, walk: Walk, value: Value, path: str, about: About, depth: int) -> bool:
        if not isinstance(value, Object) or value.class_name not in ("table", "timetable"):
            return False
        fields = value.fields
        props = fields.get("props")
        more = props.read_element(0) if isinstance(props, Struct) and props.size else {}
        data = fields.get("data")
        names = read_texts(fields.get("varNames", fields.get("varnames")))
        units = read_texts(fields.get("varUnits", more.get("VariableUnits")))
        if not isinstance(data, Cell) or len(names) != len(data.items):
            return False
        time = None
        if value.class_name == "timetable":
            label = (read_texts(fields.get("dimNames")) or ["Time"])[0]
            time = self._add_row_times(walk, fields, f"{path}.{label}", label)
        for k, (name, column) in enumerate(zip(names, data.items, strict=True)):
            unit = units[k] if len(units) == len(names) else ""
            walk.walk(column, f"{path}.{name}", About(name, unit, time=time), depth + 1)
        return True

    def _add_row_times(self, walk: Walk, fields: Mapping[str, Value], path: str, label: str) -> TimeAxis | None:
        times = fields.get("rowTimes")
        if isinstance(times, Object):
            return add_times(walk, times, path, label)
        regular = times.read_element(0) if isinstance(times, Struct) and times.size == 1 else {}
        origin, step, rate, rows = (
            _read_scalar(regular.get(n)) for n in ("origin", "stepSize", "sampleRate", "numRows")
        )
        rows = rows if rows is not None else _read_scalar(fields.get("numRows"))
        if rate:
            step = 1.0 / rate
        if step is None or rows is None or not 0 < rows == int(rows):
            walk.found.left_out[path] = (
                "times of rows that are stored in an unknown way: save the table with seconds(...) as a column"
            )
            return None
        check_rows(f"{path} has", rows, 1)
        seconds = (origin or 0.0) + step * np.arange(int(rows))
        return walk.add_time(Numbers((len(seconds), 1), "f", Gathered(seconds)), path, label)


class Times(Layout):
    """An object of the class duration or datetime."""

    def add(self, walk: Walk, value: Value, path: str, about: About, depth: int) -> bool:
        if not isinstance(value, Object) or value.class_name not in ("duration", "datetime"):
            return False
        numbers = _read_stored(value)
        if numbers is not None and numbers.size > 1:
            add_times(walk, value, path, about.name, is_beside=True)
        return True


class Categorical(Layout):
    """A status: numbers from 1 with names, or those that the names say."""

    def add(self, walk: Walk, value: Value, path: str, about: About, depth: int) -> bool:
        if not isinstance(value, Object) or value.class_name != "categorical":
            return False
        codes, names = value.fields.get("codes"), read_texts(value.fields.get("categoryNames"))
        if isinstance(codes, Numbers):
            listed = ", ".join(f"{number} = {name}" for number, name in enumerate(names[:20], 1))
            if (values := value_states(names)) is not None:
                codes, listed = replace(codes, kind="f", block=Translated(codes.block, values), small=None), ""
            walk.add(codes, path, About(about.name, "", listed, about.time, is_status=True))
        return True


def add_times(walk: Walk, value: Object, path: str, name: str, is_beside: bool = False) -> TimeAxis | None:
    """The time axis of an object of the class duration or datetime; dates are counted from the first."""
    numbers = _read_stored(value)
    if numbers is not None and not numbers.size:
        return None
    if numbers is None or numbers.size != max(numbers.shape):
        walk.found.left_out[path] = f"an object of the class {value.class_name} with more than one column"
        return None
    if value.class_name == "duration":
        return walk.add_time(numbers, path, name, _MILLISECONDS, 0.0, is_beside)
    axis = int(np.argmax(numbers.shape))
    (milliseconds,) = numbers.read([Line(axis, (0,) * len(numbers.shape))])
    first = float(milliseconds[0])
    try:
        date = datetime.fromtimestamp(_MILLISECONDS * first, UTC)
    except (OverflowError, ValueError, OSError):
        walk.found.left_out[path] = "dates that are none"
        return None
    start = (
        date if to_text(value.fields.get("tz")) else date.replace(tzinfo=None)
    ).isoformat()  # a zone: stored as UTC
    walk.found.starts.append(start)
    walk.found.notes.append(f"{path} is counted from {start}")
    return walk.add_time(numbers, path, name, _MILLISECONDS, first, is_beside)


def _read_stored(value: Value) -> Numbers | None:
    stored = value.fields.get("millis" if value.class_name == "duration" else "data")
    return stored if isinstance(stored, Numbers) else None


def _read_scalar(value: Value) -> float | None:
    """A single number, or a duration of one in s."""
    if isinstance(value, Object) and value.class_name == "duration":
        number = _read_scalar(value.fields.get("millis"))
        return None if number is None else _MILLISECONDS * number
    return value.scalar if isinstance(value, Numbers) else None
