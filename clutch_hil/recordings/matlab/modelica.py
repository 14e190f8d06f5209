"""Results of Modelica tools (Dymola, OpenModelica, JModelica): a MATLAB file of level 4 with the variables of a simulation.

`name` and `description` have a text for each variable, `dataInfo` says in which table and column its values are, negative for
minus them. Table 1 has what is constant, table 2 the courses, whose first column is time. In `binTrans` all are transposed.
Source: Dymola User Manual, "Simulation result files"; OpenModelica, simulation_result_mat4.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from clutch_hil.recordings.matlab.layouts import Column, Found, TimeAxis
from clutch_hil.recordings.matlab.value import Line, Numbers, Text, Value
from protocols.errors import InputError
from protocols.files.units import have_same_quantity, to_si

_CONSTANT, _COURSES = 1, 2  # tables
_UNIT = re.compile(
    r".*\[([^\[\]|:]*)[^\[\]]*\]", re.DOTALL
)  # the last brackets: `flange angle [rad|deg]`, of it the unit of the numbers


def add_trajectory(inventory: Found, variables: Mapping[str, Value]) -> bool:
    """Add the variables of a simulation to `inventory`; False where the file is none of a Modelica tool."""
    kind, names = variables.get("Aclass"), variables.get("name")
    info, courses = variables.get("dataInfo"), variables.get(f"data_{_COURSES}")
    if not (
        isinstance(kind, Text)
        and isinstance(names, Text)
        and isinstance(info, Numbers)
        and isinstance(courses, Numbers)
    ):
        return False
    if str(kind) != "Atrajectory" or len(info.shape) != 2 or len(courses.shape) != 2:
        return False
    flat = any("binTrans" in row for row in kind.rows)
    listed = _list_texts(names, flat)
    described = variables.get("description")
    about = _list_texts(described, flat) if isinstance(described, Text) else []
    if (
        info.shape[_find_axis(flat)] != len(listed)
        or info.shape[1 - _find_axis(flat)] < 2
        or not listed
        or not courses.size
    ):
        return False
    tables, places = (np.nan_to_num(part).astype(int) for part in info.read([_make_line(flat, k) for k in (0, 1)]))
    units = [_find_unit(text) for text in about] if len(about) == len(listed) else [""] * len(listed)
    time = _add_time(inventory, listed, units, courses, flat)
    constants = _read_constants(variables.get(f"data_{_CONSTANT}"), flat)
    owners = {int(p): name for name, t, p in zip(listed, tables, places, strict=True) if t == _COURSES and p > 0}
    for name, unit, table, place in zip(listed, units, tables, places, strict=True):
        if table == _CONSTANT and 0 < abs(place) <= len(constants):
            inventory.numbers[name] = float(np.sign(place) * constants[abs(place) - 1])
        elif table == _COURSES and 0 < place <= courses.shape[1 - _find_axis(flat)]:
            inventory.columns.append(Column(name, name, courses, _make_line(flat, place - 1), unit, time))
        elif table == _COURSES and place < 0:
            inventory.left_out[name] = f"minus {owners.get(-int(place), 'another one')}: take that with scale = -1"
    return True


def _add_time(inventory: Found, names: Sequence[str], units: Sequence[str], courses: Numbers, flat: bool) -> TimeAxis:
    """The first column of the courses, as a time axis whose rows at one time are instants before and after an event."""
    try:
        factor = to_si(1.0, units[0]) if units[0] and have_same_quantity(units[0], "s") else 1.0
    except InputError:
        factor = 1.0
    line = _make_line(flat, 0)
    time = TimeAxis(names[0], courses, line, factor, has_events=True)
    inventory.columns.append(Column(names[0], names[0], courses, line, "s", time, is_time=True))
    return time


def _read_constants(table: Value | None, flat: bool) -> np.ndarray:
    """The first value of each column of the table of constants."""
    if not isinstance(table, Numbers) or len(table.shape) != 2:
        return np.empty(0)
    return table.read([Line(1 - _find_axis(flat), (0, 0))])[0]


def _list_texts(texts: Text, flat: bool) -> list[str]:
    """The text of each variable."""
    rows = list(map("".join, zip(*texts.rows, strict=False))) if flat else texts.rows
    return [row.strip(" \0") for row in rows]


def _find_axis(flat: bool) -> int:
    """The axis of the rows of a table."""
    return 1 if flat else 0


def _make_line(flat: bool, number: int) -> Line:
    """The column of a table or of `dataInfo`, by its number from 0."""
    return Line(1, (int(number), 0)) if flat else Line(0, (0, int(number)))


def _find_unit(description: str) -> str:
    match = _UNIT.fullmatch(description)
    return match[1].strip() if match else ""
