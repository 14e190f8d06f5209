"""Which lines above the rows of a text file have the names of the columns, and which their units."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from clutch_hil.recordings.channel import is_time_name
from clutch_hil.recordings.stated_rate import split_value
from clutch_hil.recordings.text.cells import Cells
from clutch_hil.recordings.text.clock import find_time_format
from clutch_hil.recordings.text.footer import STATISTIC
from clutch_hil.recordings.text.group_names import name_by_groups
from clutch_hil.recordings.text.heading_rows import HeadingRows
from clutch_hil.recordings.text.lines import Line, split
from clutch_hil.recordings.text.number_types import are_types
from clutch_hil.recordings.unit_in_name import is_unit, split_unit, strip_brackets
from clutch_hil.recordings.unknown_unit import names_unit
from protocols.errors import InputError

_SEARCHED = 4  # lines above the first row in which names and units are looked for
_LONGEST_UNIT = 16  # characters of one that is not known
_JUDGED_UNITS = 30  # cells that tell a line of units: an unknown unit costs a millisecond
MOST_REMARKS = 20  # lines above the names that are kept
_NUMBER = re.compile(r"[+-]?[0-9.,]*[0-9](?:[eE][+-]?[0-9]+)?")  # no unit, but for 1
# `SR=100 Hz` below the names of catman, `,#voltbase=5000000(uV)` of Hantek
_ENTRY = re.compile(r"[,;\s]*#?\w+\s*=\s*\S")
# Before the units of a line
_LABEL = re.compile(r"(.*[\W_]|[vy])?(units?|einheit(en)?|unités?)([\W_]+label)?\W*", re.IGNORECASE)
_AXIS_LABEL = re.compile(r"(h|x|horizontal)[\W_]*units?([\W_]+label)?\W*", re.IGNORECASE)  # before the unit of time
LABELLED = re.compile(r"(units?|einheit(en)?|unités?)\s*[:=]\s*(?P<unit>\S.*)", re.IGNORECASE)  # `units: s, Nm, rpm`
_SECTION = re.compile(r"\[[^\[\]]*(head|name|channel|column)[^\[\]]*\]", re.IGNORECASE)  # above a list of names
_NAME_LABEL = re.compile(r"((trace|signal|channel|kanal)[ _]?)?names?:?", re.IGNORECASE)  # before the names of a line


@dataclass(frozen=True)
class HeadingLines:
    """Indices of the lines with the `names`, the `units` and the `groups` of names; None where there is no such line.

    row: names by column, "" for one without; also those under groups. paired: each column of values has its own times.
    """

    names: int | None
    units: int | None
    groups: int | None
    row: Sequence[str]
    paired: bool

    @property
    def used(self) -> list[int]:
        """Indices of all of them."""
        return [number for number in (self.names, self.units, self.groups) if number is not None]


def find_heading_lines(
    path: Path,
    above: Sequence[Line],
    heading: HeadingRows,
    widths: tuple[int, int],
    delimiter: str,
    cells: Cells,
    options: Mapping[str, Any],
) -> HeadingLines:
    """Find the lines of names and units; arguments of `headings.find_headings`, and the cells `heading` of the lines.

    Cells of paired columns are changed: see `_part_pairs`. Raises InputError where there are other names than columns.
    """
    rows, width, top = heading.cells, widths[1], len(above)
    names = units = None
    sought = options.get("header", True) and "units_row" not in options
    paired = _part_pairs(rows) if sought else None
    found = paired or (_find_above_numbers(rows, heading.with_numbers, top) if sought else None)
    if found:
        names, units = found
    elif options.get("units_row"):
        units = _find_line(path, above, rows, options["units_row"], width)
    elif sought:
        units = _find_units(rows, top, cells)
    if options.get("header", True) and not found:
        names = _find_names(above, rows, units, cells, widths[0])
        if names is None:
            labelled_names = _find_labelled_names(rows, widths[0], cells)
            numbered = None if units is None else _find_numbered_names(rows, units, cells)
            names = numbered if labelled_names is None else labelled_names
        if names is None and "units_row" not in options:
            names, units = units, None  # names such as t, m and V, which could be units
        if names is None and options.get("header") and top and rows[top - 1]:
            names = top - 1  # names that look like values
        if names is None and units is None:
            _check_widths(path, above, width, delimiter, cells)
    if names is None and options.get("header", True) and (listed := _find_listed_names(above, widths[0], cells)):
        first, row = listed
        return HeadingLines(first, units, None, [*row, *[""] * (width - len(row))], False)
    if names is None:
        return HeadingLines(None, units, None, [""] * width, False)
    if not paired and (grouped := _find_groups(above, rows, names, units, cells)):
        return HeadingLines(names, units, *grouped, False)
    return HeadingLines(names, units, None, rows[names], paired is not None)


def _find_units(rows: Mapping[int, Sequence[str]], top: int, cells: Cells) -> int | None:
    """The line with the units, None if there is none."""
    plain = [n for n in _list_nearest(top, rows, cells) if not are_types(rows[n])]
    possible = [n for known in (is_unit, names_unit) for n in plain if _are_units(rows[n], known)]
    named = [n for n in possible if not is_time_name(rows[n][0])]  # t, M, n are rather names, below their units
    if named or possible:
        return (named or possible)[0]
    labelled = (n for n in range(top - 1, max(top - 1 - MOST_REMARKS, -1), -1) if is_label(rows[n][:1]))
    return next((n for n in labelled if _are_units(rows[n])), None)  # `Y_Unit_Label` of LabVIEW, further above


def _list_nearest(top: int, rows: Mapping[int, Sequence[str]], cells: Cells) -> Sequence[int]:
    """Numbers of the lines in which names and units can be, the nearest to the rows first.

    Lines of statistics between them and the rows, as `Min;0.5;1.5`, do not count.
    """
    within = range(top - 1, max(top - 1 - MOST_REMARKS, -1), -1)
    return [n for n in within if not _are_statistics(rows[n], cells)][:_SEARCHED]


def _are_statistics(row: Sequence[str], cells: Cells) -> bool:
    """Whether a line has the name of a statistic and then a number in each column."""
    return len(row) > 1 and bool(STATISTIC.fullmatch(row[0])) and all(map(cells.is_number, row[1:]))


def is_label(cells: Sequence[str]) -> bool:
    """Whether the first cell of a line says that its others are units."""
    return bool(cells) and bool(_LABEL.fullmatch(cells[0]))


def _find_names(
    above: Sequence[Line], rows: Mapping[int, list[str]], units: int | None, cells: Cells, width: int
) -> int | None:
    """Which line has the names: one above the units, else below them.

    Of lines that stand together it is the one at the units, without these the first; or one with more different names, where
    that one has gaps or no time: `Clutch;;Motor` over `torque;pressure;speed` names groups, `;SN 12;SN 13` below them sensors.
    """
    near = [n for n in _list_nearest(len(above), rows, cells) if n != units and are_names(rows[n], cells, width)]
    if any(not are_types(rows[n]) for n in near):
        near = [n for n in near if not are_types(rows[n])]
    if any(not above[n].comment for n in near):  # a comment has the names only where nothing else has
        near = [n for n in near if not above[n].comment]
    if not near:
        return None
    timed = [n for n in near if any(is_time_name(split_unit(cell)[0]) for cell in rows[n])]
    if units is not None and not any(n < units for n in near):
        return timed[0] if timed else near[-1]
    if units is not None and is_label(rows[units][:1]) and timed and timed[0] > units:
        return timed[0]  # `Vertical Units,V` of an oscilloscope, and then `TIME,CH1`
    near = [n for n in near if units is None or n < units]
    together = near[:1]
    for n in near[1:]:
        last = together[-1]
        if width > 2 and n == last - 1 and above[n].number == above[last].number - 1 and not above[n].comment:
            together.append(n)  # two lines of two cells are rather remarks
    usual = together[-1] if units is None else together[0]
    for n in (usual, *together):  # the names of all columns, a time among them, and no units
        if n in timed and all(rows[n][:width]) and (n == usual or not any(map(is_unit, rows[n]))):
            return n
    return max([usual, *reversed(together)], key=lambda n: len(set(rows[n]) - {""}))


def _find_groups(
    above: Sequence[Line], rows: Mapping[int, Sequence[str]], names: int, units: int | None, cells: Cells
) -> tuple[int, list[str]] | None:
    """The line beside that of the names which has their groups, or the names of these groups; and the names by both."""
    for other in (names - 1, names + 1):
        row = rows.get(other, [])
        if other == units or not row or are_types(row) or any(map(cells.is_number, row)):
            continue
        upper, lower = sorted((names, other))
        if above[lower].number - above[upper].number > 1 or above[upper].comment != above[lower].comment:
            continue
        if other > names and (
            len(set(rows[names]) - {""}) == len(row)  # the names differ, so the line below has remarks
            or any(below and is_time_name(split_unit(name)[0]) for name, below in zip(rows[names], row, strict=True))
        ):
            continue
        if (named := name_by_groups(rows[upper], rows[lower])) and not any(map(_is_time, named)):
            return other, named
    return None


def _find_above_numbers(
    rows: Mapping[int, Sequence[str]], others: Collection[int], top: int
) -> tuple[int, int | None] | None:
    """The last lines above the rows, of names and units, where these have numbers beside them: see `take_numbers_beside`."""
    if top - 1 not in others or top - 2 not in others:
        return None
    return top - 2, top - 1 if any(map(is_unit, rows[top - 1])) else None


def _find_numbered_names(rows: Mapping[int, Sequence[str]], units: int, cells: Cells) -> int | None:
    """The line above the units, where it is a name and then the numbers of channels, as `x-axis,1,2` of Keysight."""
    row = rows.get(units - 1, [])
    named = len(row) > 1 and row[0] and not cells.is_number(row[0]) and len(set(row)) == len(row)
    return units - 1 if named and all(cell.isdigit() for cell in row[1:]) else None


def _find_labelled_names(rows: Mapping[int, Sequence[str]], width: int, cells: Cells) -> int | None:
    """The line that says of itself that it has names, `TraceName,torque,speed` of Yokogawa, wherever it stands."""
    for n, row in rows.items():
        if row and _NAME_LABEL.fullmatch(row[0]) and len({*row[1:]} - {""}) == width - 1:
            return None if any(map(cells.is_number, row)) else n
    return None


def _find_listed_names(above: Sequence[Line], width: int, cells: Cells) -> tuple[int, list[str]] | None:
    """The first line of a list of names, one a line below a section such as `[header]` of VBOX, and the names; one a column."""
    sections = [n for n, line in enumerate(above) if line.text.lstrip().startswith("[")] + [len(above)]
    for start, end in pairwise(sections):
        names = [" ".join(line.text.split()) for line in above[start + 1 : end]]
        if _SECTION.fullmatch(above[start].text.strip()) and len(names) == width > 1 and len(set(names)) == width:
            return None if any(map(cells.is_number, names)) else (start + 1, names)
    return None


def _part_pairs(rows: dict[int, list[str]]) -> tuple[int, int | None] | None:
    """The lines of names and units, where each cell has a label before it: `Name,torque,Name,speed` of TwinCAT. None elsewhere.

    The columns below the labels are the times of those beside them, and are called so: their cells in the lines are changed.
    """
    paired = {row[0]: n for n, row in rows.items() if row and len(row) % 2 == 0 and set(row[::2]) == {row[0]}}
    if "Name" not in paired or not any(label.startswith("SampleTime") for label in paired):
        return None
    names, units = paired["Name"], paired.get("Unit")
    rows[names][::2] = ["time"] * (len(rows[names]) // 2)
    if units is not None:
        rows[units][::2] = [""] * (len(rows[units]) // 2)
        units = units if any(rows[units]) else None
    return names, units


def are_names(row: Sequence[str], cells: Cells, width: int) -> bool:
    """Whether the first `width` cells of a line can be names of columns."""
    row = row[:width]
    return (
        2 * sum(map(bool, row)) > width
        and not _AXIS_LABEL.fullmatch(row[0])
        and not split_value(row[0], row[-1])
        and not any(cells.is_number(cell) or _is_time(cell) for cell in row)
        and not all(_ENTRY.match(cell) for cell in row if cell)
    )


def _is_time(cell: str) -> bool:
    """Whether a cell is a time; a name such as PT1H, of a pressure, could also be a duration."""
    written = find_time_format([cell])
    return written is not None and not written.is_duration


def _find_line(path: Path, above: Sequence[Line], rows: Mapping[int, Sequence[str]], wanted: int, width: int) -> int:
    """The line `wanted` as the import map counts it. Raises InputError where it has no units."""
    for number, line in enumerate(above):
        if line.number == wanted and rows[number]:
            return number
    nearest = range(max(len(above) - _SEARCHED, 0), len(above))
    lines = ", ".join(str(above[number].number) for number in nearest) or "none"
    raise InputError(
        f"recording {path}: units_row is {wanted}, which is not a line of {width} cells above the rows; such lines are {lines}"
    )


def _check_widths(path: Path, above: Sequence[Line], width: int, delimiter: str, cells: Cells) -> None:
    """Raise InputError where the line above the rows is a list of names, but of other columns.

    One with numbers or times is none, as with which the log of a terminal begins: `PuTTY log 2022.12.05`, or the rest of a row.
    """
    if not above or above[-1].comment:
        return
    row = split(above[-1].text, delimiter)
    if any(cells.is_number(cell) or _is_time(cell) or is_unit(cells.split_unit(cell)[1] or "?") for cell in row):
        return
    count = sum(map(bool, row))
    if len(row) != width and 2 * count >= width and count > 1:
        raise InputError(
            f"recording {path}: line {above[-1].number} has {count} names, rows have {width} cells: set delimiter or decimal"
            " in [file], or header = false, and select columns by number"
        )


def _are_units(row: Sequence[str], known_as: Callable[[str], bool] = is_unit) -> bool:
    """Whether the cells are units: more known ones than others, and these short; behind a label one, of half of the columns.

    known_as: whether a cell is a known unit.
    """
    if is_label(row[:1]) and 2 * sum(map(bool, row[1:])) < len(row):
        return False
    if row and _AXIS_LABEL.fullmatch(row[0]):
        return False
    given = [cell for cell in (row[1:] if is_label(row[:1]) else row) if cell and cell not in ("-", "--")][
        :_JUDGED_UNITS
    ]
    units = [cell for cell in given if known_as(strip_brackets(cell)) or LABELLED.fullmatch(cell)]
    if len(units) < len(given):  # the number of a channel before its name and unit is none
        units = [cell for cell in units if not cell.isdigit()]
    known = sum(cell == "1" or not _NUMBER.fullmatch(cell) for cell in units)
    return (
        known > 0
        and (is_label(row[:1]) or 2 * known > len(given))
        and all(len(cell) <= _LONGEST_UNIT for cell in given)
    )
