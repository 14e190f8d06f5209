"""Layouts: what the variables of a MATLAB file mean, as columns with names, units and time axes.

A column's path is the MATLAB expression that gives its numbers (`rec.Y(2).Data`, `y(:,1)`, `logsout{3}.Values.Data`). Its name
is what the file calls it (`Model Root/Plant/Torque{In1}`), else the last part of the path. Arrays without a time axis share
their rows with all that have as many.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import prod

import numpy as np

from clutch_hil.recordings.matlab.objects import Object
from clutch_hil.recordings.matlab.texts import read_texts, to_text
from clutch_hil.recordings.matlab.value import Cell, Gathered, LeftOut, Line, Numbers, Struct, Text, Value
from clutch_hil.recordings.stated_scaling import describe_scaling
from clutch_hil.recordings.stated_unit import list_unit_keys
from clutch_hil.recordings.unit_in_name import is_unit
from protocols.errors import InputError

MOST_COLUMNS = 10_000  # of one array: more are no channels, but a picture or a table lying on its side
_MOST_FOUND = 100_000  # columns and single numbers of a file
_MOST_VISITS = 400_000  # values that are looked at: objects can refer to each other in circles
_MOST_DEPTH = 40
_NAMES = re.compile(r"(?i).*(name|label|header|channel|signal|title|^var).*")  # fields with names of columns
_UNITS = re.compile(r"(?i)(.*_)?(units?|einheit(en)?|eu)")  # and with their units
_LISTS = re.compile(r"(?i).*(names|labels|headers?|channels|signals)")  # those that can be a list in one text
_MARKS = (",", ";", "\t", "|")  # between names or units in one text
_TIMES = re.compile(r"(?i)t|time|zeit|tout")  # fields that hold times where one other holds values


@dataclass(frozen=True)
class TimeAxis:
    """Times (rows,) [s] of a raster: (number - first) * factor. first: 0, or that of the first sample of a date.

    is_beside: whether the columns that have as many rows share them, as beside a date in a table. has_events: whether rows of
    one time are those before and after an event of a simulation, of which the last one counts.
    """

    path: str
    numbers: Numbers
    line: Line
    factor: float = 1.0
    first: float = 0.0
    is_beside: bool = False
    has_events: bool = False

    @property
    def rows(self) -> int:
        return self.numbers.shape[self.line.axis]


@dataclass(frozen=True)
class Column:
    """Where the numbers of a channel are. labels: where each number has a name; texts: in place of numbers."""

    name: str
    path: str
    numbers: Numbers
    line: Line
    unit: str = ""
    time: TimeAxis | None = None
    is_time: bool = False
    is_status: bool = False
    texts: Sequence[str] = ()
    comment: str = ""
    scaling: str = ""

    @property
    def rows(self) -> int:
        return self.numbers.shape[self.line.axis]

    @property
    def raster(self) -> str:
        return f"{self.rows} rows" if self.time is None or self.time.is_beside else self.time.path


@dataclass
class Found:
    """What the variables of a file hold. left_out: path -> what it is. starts: times of day of time 0."""

    columns: list[Column] = field(default_factory=list)
    numbers: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)
    starts: list[str] = field(default_factory=list)

    @property
    def start(self) -> str:
        """The time of day of time 0, "" where the file tells none, or several."""
        return self.starts[0] if len({*self.starts}) == 1 else ""


@dataclass(frozen=True)
class About:
    """What is known of a value from where it stands. names, units: of its columns, where there is one for each.

    is_label: whether the name counts more than one inside the value. lengths: of the vectors beside it. scaling: factors and
    offsets beside whole numbers, which are not applied. named_units: of values inside, by their name.
    """

    name: str
    unit: str = ""
    comment: str = ""
    time: TimeAxis | None = None
    names: Sequence[str] = ()
    units: Sequence[str] = ()
    lengths: frozenset[int] = frozenset()
    time_last: bool = False
    is_status: bool = False
    is_label: bool = False
    scaling: str = ""
    named_units: Mapping[str, str] = field(default_factory=dict)


class Walk:
    """Walks through values and collects what is found. name: of the file. layouts: of tools; the first that fits counts."""

    def __init__(self, name: str, layouts: Sequence["Layout"]) -> None:
        self.found, self._name, self._layouts, self._visits = Found(), name, layouts, 0

    def walk_fields(self, fields: Mapping[str, Value], path: str, depth: int, about: About | None = None) -> None:
        """Values that stand beside each other. path: of the whole, "" for the file."""
        listed = {name: texts for name, value in fields.items() if len(texts := _list_labels(name, value)) > 1}
        names = [texts for name, texts in listed.items() if _NAMES.fullmatch(name) and not _UNITS.fullmatch(name)]
        units = [texts for name, texts in listed.items() if _UNITS.fullmatch(name)]
        lengths = frozenset(v.size for v in fields.values() if isinstance(v, Numbers) and 1 < v.size == max(v.shape))
        single = _find_single_unit(fields)
        scaled = _find_single_scaling(fields)
        headers = _read_headers(fields)
        named = dict(about.named_units) if about else {}
        named |= _read_named_units(fields)
        single = {name: unit for name, unit in named.items() if isinstance(fields.get(name), Numbers)} | single
        for name, value in fields.items():
            if name in listed and any(listed[name] is texts for texts in (*names, *units)):
                continue
            time = about.time if about else None
            label, unit = headers.get(name, (name, ""))
            own = About(label, unit or single.get(name, ""), lengths=lengths, time=time, scaling=scaled.get(name, ""))
            own = replace(own, named_units=named)
            if isinstance(value, Numbers | Cell):
                count = value.shape if isinstance(value, Numbers) else (len(value.items),)
                own = replace(own, names=_choose_list(names, count), units=_choose_list(units, count))
            self.walk(value, f"{path}.{name}" if path else name, own, depth)

    def walk(self, value: Value, path: str, about: About, depth: int) -> None:
        self._visits += 1
        if self._visits > _MOST_VISITS or len(self.found.columns) + len(self.found.numbers) > _MOST_FOUND:
            raise InputError(f"{self._name} has more than {_MOST_FOUND} columns and numbers; save fewer variables")
        if depth > _MOST_DEPTH:
            self.found.left_out[path] = f"nested more than {_MOST_DEPTH} levels deep"
        elif isinstance(value, Numbers):
            self.add(value, path, about)
        elif isinstance(value, LeftOut):
            self.found.left_out[path] = value.what
        elif texts := read_texts(value):
            if len(texts) > 1 and not isinstance(value, Text):  # a char matrix is one text in several lines
                nothing = Numbers((len(texts), 1), "f", Gathered(np.full(len(texts), np.nan)))
                self._append(Column(about.name, path, nothing, Line(0, (0, 0)), texts=texts))
        elif any(layout.add(self, value, path, about, depth) for layout in self._layouts):
            pass
        elif isinstance(value, Struct):
            self._walk_struct(value, path, about, depth)
        elif isinstance(value, Cell):
            self._walk_cell(value, path, about, depth)
        elif isinstance(value, Object):
            self._walk_object(value, path, about, depth)

    def _walk_struct(self, value: Struct, path: str, about: About, depth: int) -> None:
        if value.size == 1:
            self.walk_fields(value.read_element(0), path, depth + 1, about)
            return
        units = self._list_units(value)
        for name, values in value.fields.items():  # an array of single numbers is a column
            scalars = [v.scalar if isinstance(v, Numbers) else None for v in values]
            if scalars and all(scalar is not None for scalar in scalars):
                shape = (len(scalars), 1)
                numbers = Numbers(shape, "f", Gathered(np.array(scalars, float)))
                self.add(numbers, f"{path}.{name}", About(name))
            else:
                for number, one in enumerate(values, 1):
                    label, unit = units[number - 1].get(name, ("", "")) if units else ("", "")
                    self.walk(one, f"{path}({number}).{name}", About(label or name, unit), depth + 1)

    @staticmethod
    def _list_units(value: Struct) -> list[dict[str, tuple[str, str]]]:
        """For each element of an array of structures, by field: name and unit that stand beside its numbers."""
        if not any(map(_UNITS.fullmatch, value.fields)):
            return []
        units = []
        for number in range(value.size):
            fields = value.read_element(number)
            names = [text for name, one in fields.items() if _NAMES.fullmatch(name) and (text := to_text(one))]
            label = names[0] if len(names) == 1 else ""
            units.append({name: (label, unit) for name, unit in _find_single_unit(fields).items()})
        return units

    def _walk_cell(self, value: Cell, path: str, about: About, depth: int) -> None:
        for number, item in enumerate(value.items, 1):
            name = about.names[number - 1] if about.names else f"{about.name}{{{number}}}"
            unit = about.units[number - 1] if about.units else about.unit
            self.walk(item, f"{path}{{{number}}}", About(name, unit, time=about.time), depth + 1)

    def _walk_object(self, value: Object, path: str, about: About, depth: int) -> None:
        before = len(self.found.columns)
        if len(value.numbers) > 1:
            for number in range(len(value.numbers)):
                self.walk_fields(value.read_element(number), f"{path}({number + 1})", depth + 1)
        else:
            self.walk_fields(value.fields, path, depth + 1, about)
        if len(self.found.columns) == before and depth <= 1:
            self.found.left_out[path] = (
                f"an object of the class {value.class_name or 'unknown'}: save its numbers as vectors or a structure"
            )

    def add(self, numbers: Numbers, path: str, about: About) -> None:
        """Columns of an array of numbers, or the single number."""
        if not numbers.size:
            return
        if numbers.imaginary:
            self.found.left_out[path] = "complex numbers: save real(...) and imag(...)"
            return
        if numbers.size == 1 and (about.time is None or about.time.rows != 1):
            if (scalar := numbers.scalar) is not None:
                self.found.numbers[path] = scalar
            return
        axis = _find_row_axis(numbers.shape, about)
        if axis is None:
            rows = "" if about.time is None else f", none of which is {about.time.rows} long as its time"
            sizes = " x ".join(map(str, numbers.shape))
            self.found.left_out[path] = f"an array of {sizes} numbers{rows}"
            return
        others = [range(size if i != axis else 1) for i, size in enumerate(numbers.shape)]
        count = prod(map(len, others))
        if count > MOST_COLUMNS:
            self.found.left_out[path] = f"an array of {count} columns"
            return
        for number, fixed in enumerate(product(*(reversed(others)))):
            fixed = fixed[::-1]  # the first index counts fastest
            inside = [str(i + 1) for i, size in zip(fixed, others, strict=True) if len(size) > 1]
            indices = ",".join(":" if i == axis else str(n + 1) for i, n in enumerate(fixed))
            name = f"{about.name}({','.join(inside)})" if inside else about.name
            column = Column(
                about.names[number] if len(about.names) == count > 1 else name,
                f"{path}({indices})" if count > 1 else path,
                numbers,
                Line(axis, fixed),
                about.units[number] if len(about.units) == count > 1 else about.unit,
                about.time,
                is_status=about.is_status or numbers.kind == "b",
                comment=about.comment,
                scaling=about.scaling,
            )
            self._append(column)

    def add_time(
        self, numbers: Numbers, path: str, name: str, factor: float = 1.0, first: float = 0.0, is_beside: bool = False
    ) -> TimeAxis | None:
        """A time axis, which is a column as well; None for what cannot be one."""
        if numbers.size != max(numbers.shape, default=0) or not numbers.size:
            return None
        axis = int(np.argmax(numbers.shape))
        line = Line(axis, (0,) * len(numbers.shape))
        time = TimeAxis(path, replace(numbers, imaginary=False), line, factor, first, is_beside)
        self._append(Column(name, path, numbers, line, "s", time, is_time=True))
        return time

    def _append(self, column: Column) -> None:
        self.found.columns.append(column)


class Layout(ABC):
    """How a tool lays out its recordings."""

    @abstractmethod
    def add(self, walk: Walk, value: Value, path: str, about: About, depth: int) -> bool:
        """Add the columns of `value` to `walk`; False where it has another layout."""


def _find_row_axis(shape: tuple[int, ...], about: About) -> int | None:
    """Axis of the rows of an array; None where it has none."""
    long = [axis for axis, size in enumerate(shape) if size > 1]
    if about.time is not None:
        fitting = [axis for axis, size in enumerate(shape) if size == about.time.rows]
        if not fitting:
            return None
        return fitting[-1] if about.time_last or (len(shape) > 2 and fitting[0] != 0) else fitting[0]
    if len(long) == 1:
        return long[0]
    if len(long) != 2 or (len(shape) > 2 and long != [0, 1]):
        return None
    fitting = [axis for axis in long if shape[axis] in about.lengths]
    if len(fitting) == 1:
        return fitting[0]
    named = [axis for axis in long if shape[axis] in (len(about.names), len(about.units))]
    if len(named) == 1:  # a name or a unit for each column
        return next(axis for axis in long if axis != named[0])
    return long[0] if shape[long[0]] >= shape[long[1]] else long[1]


def _list_labels(name: str, value: Value) -> list[str]:
    """The texts of a field; one text of names or units, `time, torque`, is parted, units also at blanks."""
    texts = read_texts(value)
    if len(texts) == 1 and (_LISTS.fullmatch(name) or _UNITS.fullmatch(name)):
        mark = next((mark for mark in _MARKS if mark in texts[0]), "")
        parts = [part.strip() for part in texts[0].split(mark)] if mark else texts[0].split()
        if mark or (_UNITS.fullmatch(name) and all(map(is_unit, parts))):
            return parts
    return texts


def _choose_list(lists: Sequence[Sequence[str]], shape: Sequence[int]) -> Sequence[str]:
    """The one list of texts that is as long as an axis of `shape`; empty where none or several are."""
    fitting = [texts for texts in lists if len(texts) in shape]
    return fitting[0] if len(fitting) == 1 else ()


def _find_single_unit(fields: Mapping[str, Value]) -> dict[str, str]:
    """Units that stand beside arrays: `x_unit` beside `x`; `unit` beside the one array that holds no times."""
    units = {n: to_text(v) for n, v in fields.items() if _UNITS.fullmatch(n) and to_text(v)}
    arrays = [name for name, value in fields.items() if isinstance(value, Numbers) and value.size > 1]
    beside = {
        array: unit for array in arrays for name, unit in units.items() if name.lower().startswith(array.lower() + "_")
    }
    valued = [name for name in arrays if not _TIMES.fullmatch(name)]
    alone = [unit for name, unit in units.items() if "_" not in name]
    if len(valued) == 1 and len(alone) == 1:
        beside.setdefault(valued[0], alone[0])
    return beside


def _read_named_units(fields: Mapping[str, Value]) -> dict[str, str]:
    """Units by the name of what they are of, in a structure `units` beside it."""
    inside = [v for name, v in fields.items() if _UNITS.fullmatch(name) and isinstance(v, Struct) and v.size == 1]
    return {name: unit for one in inside[:1] for name, text in one.read_element(0).items() if (unit := to_text(text))}


def _read_headers(fields: Mapping[str, Value]) -> dict[str, tuple[str, str]]:
    """Name and unit of `Channel_2_Data` by the structure `Channel_2_Header` beside it, as HBM catman saves them."""
    headers = {}
    for name, header in fields.items():
        data = f"{name.removesuffix('_Header')}_Data"
        if name.endswith("_Header") and data in fields and isinstance(header, Struct) and header.size == 1:
            inside = header.read_element(0)
            units = [text for key in list_unit_keys(inside) if (text := to_text(inside[key]))]
            label = to_text(inside.get("SignalName")) or to_text(inside.get("Name")) or data
            headers[data] = (label, units[0] if units else "")
    return headers


def _find_single_scaling(fields: Mapping[str, Value]) -> dict[str, str]:
    """Factors and offsets beside the one array that holds no times, where it is one of whole numbers."""
    arrays = [name for name, value in fields.items() if isinstance(value, Numbers) and value.size > 1]
    valued = [name for name in arrays if not _TIMES.fullmatch(name)]
    if len(valued) != 1 or fields[valued[0]].kind not in "iu":
        return {}
    numbers = ((name, value.scalar) for name, value in fields.items() if isinstance(value, Numbers))
    return {valued[0]: scaling} if (scaling := describe_scaling(numbers)) else {}
