"""Recordings of dSPACE ControlDesk: a structure with X, one element a raster, and Y, one element a signal.

X(r).Name, .Data, .Unit are times; Y(k).Name, .Data, .Unit values, whose times are X(Y(k).XIndex).
Source: dSPACE ControlDesk Measurement and Recording, "Structure of MAT files"; older ones lack XIndex and have one X.
"""

from clutch_hil.recordings.matlab.layouts import About, Layout, TimeAxis, Walk
from clutch_hil.recordings.matlab.texts import list_remarks, to_text
from clutch_hil.recordings.matlab.value import Numbers, Struct, Value
from clutch_hil.recordings.stated_date import read_date
from protocols.errors import InputError
from protocols.files.units import have_same_quantity, to_si

_MOST_REMARKS = 20


class ControlDesk(Layout):
    def add(self, walk: Walk, value: Value, path: str, about: About, depth: int) -> bool:
        fields = value.read_element(0) if isinstance(value, Struct) and value.size == 1 else {}
        x, y = fields.get("X"), fields.get("Y")
        if not (
            isinstance(x, Struct) and isinstance(y, Struct) and "Data" in x.fields and {"Name", "Data"} <= set(y.fields)
        ):
            return False
        axes = [self._add_time(walk, x, r, f"{path}.X" if x.size == 1 else f"{path}.X({r + 1})") for r in range(x.size)]
        for k in range(y.size):
            self._add_signal(walk, y, k, f"{path}.Y" if y.size == 1 else f"{path}.Y({k + 1})", axes)
        for name, inside in fields.items():
            if name not in ("X", "Y"):
                for label, text in list(list_remarks(inside, name))[:_MOST_REMARKS]:
                    walk.found.notes.append(f"{path}: {label} is {text}")
                    walk.found.starts += filter(None, [read_date(text)])
        return True

    def _add_time(self, walk: Walk, x: Struct, number: int, path: str) -> TimeAxis | None:
        one = x.read_element(number)
        data, unit = one.get("Data"), to_text(one.get("Unit"))
        if not isinstance(data, Numbers):
            return None
        name = to_text(one.get("Name")) or "time"
        try:
            is_time = not unit or have_same_quantity(unit, "s")
        except InputError:
            is_time = False
        if not is_time:  # a raster over an angle, or what is measured over it
            walk.add(data, f"{path}.Data", About(name, unit))
            return None
        if not unit:
            walk.found.notes.append(f"{path} has no unit: taken as seconds, as ControlDesk writes them")
        return walk.add_time(data, f"{path}.Data", name, to_si(1.0, unit) if unit else 1.0)

    def _add_signal(self, walk: Walk, y: Struct, number: int, path: str, axes: list[TimeAxis | None]) -> None:
        one = y.read_element(number)
        data, index = one.get("Data"), one.get("XIndex")
        if not isinstance(data, Numbers):
            walk.found.left_out[path] = "a signal without numbers"
            return
        raster = index.scalar if isinstance(index, Numbers) else None
        if len(axes) == 1:
            time = axes[0]
        elif raster is not None and raster == int(raster) and 1 <= raster <= len(axes):
            time = axes[int(raster) - 1]
        else:
            fitting = [axis for axis in axes if axis is not None and axis.rows == data.size]
            time = fitting[0] if len(fitting) == 1 else None
            walk.found.notes.append(
                f"{path} names none of the {len(axes)} rasters: "
                + (f"by its length that of {time.path}" if time else "it has no time")
            )
        name = to_text(one.get("Name")) or path
        comment = to_text(one.get("Path")) or to_text(one.get("Description"))
        walk.add(data, f"{path}.Data", About(name, to_text(one.get("Unit")), comment, time))
