"""Headings: names and units of the columns of a text file, and what else stands above its rows."""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from clutch_hil.recordings.channel import is_time_name, simplify_unit
from clutch_hil.recordings.stated_rate import split_value
from clutch_hil.recordings.text.cells import Cells, show
from clutch_hil.recordings.text.clock import find_time_format
from clutch_hil.recordings.text.date_names import name_date_and_time
from clutch_hil.recordings.text.footer import STATISTIC
from clutch_hil.recordings.text.group_names import name_by_groups
from clutch_hil.recordings.text.index_name import name_index
from clutch_hil.recordings.text.lines import RUNS, Line, split
from clutch_hil.recordings.text.number_types import are_types
from clutch_hil.recordings.text.stated_numbers import (
    list_common,
    list_numbers,
    list_pairs,
    list_scalings,
    take_numbers_beside,
)
from clutch_hil.recordings.unit_in_name import is_unit, split_unit, strip_brackets
from clutch_hil.recordings.unknown_unit import names_unit
from protocols.errors import InputError
from protocols.files.units import contradict

_SEARCHED = 4  # lines above the first row in which names and units are looked for
_LONGEST_UNIT = 16  # characters of one that is not known
_JUDGED_UNITS = 30  # cells that tell a line of units: an unknown unit costs a millisecond
_FEWEST_ROWS = 10  # lines of numbers in one that follow each other and are a recording: fewer are a table of a preamble
_MOST_LISTED = 2000  # lines above the names that may list channels: as many as are looked at
_MOST_REMARKS = 20  # lines above the names that are kept
_NAMES_APART = re.compile(r"[^\s\[(]+(?:\s?[\[(][^\])\s]*[\])])?")  # `time (s) torque (Nm)`
_NUMBER = re.compile(r"[+-]?[0-9.,]*[0-9](?:[eE][+-]?[0-9]+)?")  # no unit, but for 1
_ENTRY = re.compile(
    r"[,;\s]*#?\w+\s*=\s*\S"
)  # `SR=100 Hz` below the names of catman, `,#voltbase=5000000(uV)` of Hantek
_LABEL = re.compile(
    r"(.*[\W_]|[vy])?(units?|einheit(en)?|unités?)([\W_]+label)?\W*", re.IGNORECASE
)  # before the units of a line
_AXIS_LABEL = re.compile(r"(h|x|horizontal)[\W_]*units?([\W_]+label)?\W*", re.IGNORECASE)  # before the unit of time
_LABELLED = re.compile(r"(units?|einheit(en)?|unités?)\s*[:=]\s*(?P<unit>\S.*)", re.IGNORECASE)  # `units: s, Nm, rpm`
_NAME_LABEL = re.compile(r"((trace|signal|channel|kanal)[ _]?)?names?:?", re.IGNORECASE)  # before the names of a line
_ROW_NAME = re.compile(
    r"(samples?|index|row|no\.?|(lfd\.?\s*)?nr\.?|n|i|id|count(er)?|point|scan|record|step|zeile|messpunkt|zähler|#)"
    r"([\s_]*(no|nr|number|index)\.?)?",
    re.IGNORECASE,
)  # of a column that counts rows
_UNUSED_NAME = "Comment"  # the last name of LabVIEW's .lvm, for which most rows have no cell


@dataclass(frozen=True)
class Headings:
    """names: without units. texts: as the file writes them, unique. units: "" where none. Each one a column.

    numbers: single numbers with a name, above the names. notes: what was found, a sentence each.

    units_rows: 1 where a row below the names has the units, else 0. firsts: first cells of the lines above the rows, where
    these are words that no row begins with, and whether the whole line must be as it is above to repeat it. scalings: factors
    and offsets of the columns, in lines such as `Factor,1,0.1`; none where there is no such line.
    """

    names: Sequence[str]
    texts: Sequence[str]
    units: Sequence[str]
    numbers: Mapping[str, float] = field(default_factory=dict)
    notes: Sequence[str] = ()
    units_rows: int = 0
    firsts: Mapping[str, Sequence[str]] = field(default_factory=dict)
    scalings: Sequence[str] = ()

    def is_repeated_by(self, row: Sequence[str]) -> bool:
        """Whether a line with these cells repeats one above the rows, as after a restart: names must be the same ones."""
        wanted = self.firsts.get(row[0]) if row else None
        return wanted is not None and (not wanted or list(wanted) == list(row))


def find_headings(
    path: Path,
    above: Sequence[Line],
    widths: tuple[int, int],
    delimiter: str,
    cells: Cells,
    options: Mapping[str, Any],
    counted: bool = False,
    date: int = -1,
) -> Headings:
    """Names and units in the lines `above` the rows. widths: cells of a row, without and with the empty ones at its end.

    options: `header` and `units_row`, where set. counted: whether the first column counts the rows. date: index of a
    column of dates before one of times of day, -1 for none. Raises InputError where there are other names than columns.
    """
    width, top = widths[1], len(above)
    _check_no_rows(path, above, widths[0], delimiter, cells)
    rows = {number: _split_cells(line, widths, delimiter) for number, line in enumerate(above)}
    if date >= 0:
        rows = {n: name_date_and_time(row, above[n], delimiter, widths, date) for n, row in rows.items()}
    rows = name_index(rows, above)
    names = units = None
    filled = widths[0] == width  # else the missing name is that of the empty last column
    if counted and top and filled and (row := _add_name_of_rows(above[-1], width, delimiter)):
        rows[top - 1] = row  # R gives the names of the rows none
    beside, others = take_numbers_beside(above, widths[0], delimiter, cells)
    rows |= {number: [*row, *[""] * (width - len(row))] for number, row in others.items()}
    sought = options.get("header", True) and "units_row" not in options
    paired = _part_pairs(rows) if sought else None
    found = paired or (_find_above_numbers(rows, others, top) if sought else None)
    if found:
        names, units = found
    elif options.get("units_row"):
        units = _find_line(path, above, rows, options["units_row"], width)
    elif sought:
        near = _list_nearest(top, rows, cells)
        plain = [n for n in near if not are_types(rows[n])]
        possible = [n for known in (is_unit, names_unit) for n in plain if _are_units(rows[n], known)]
        named = [n for n in possible if not is_time_name(rows[n][0])]  # t, M, n are rather names, below their units
        units = next(iter(named or possible), None)
        if units is None:  # `Y_Unit_Label` of LabVIEW stands further above the names
            labelled = (n for n in range(top - 1, max(top - 1 - _MOST_REMARKS, -1), -1) if _is_label(rows[n][:1]))
            units = next((n for n in labelled if _are_units(rows[n])), None)
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
            _check_widths(path, above, width, delimiter)
    notes = [f"names in line {above[names].number}"] if names is not None else []
    notes += [f"units in line {above[units].number}"] if units is not None else []
    if names is None:
        notes.append(f"no names of columns: they are 'column 1' to 'column {widths[0]}'")
    used = [number for number in (names, units) if number is not None]
    if names is not None and not paired and (grouped := _find_groups(above, rows, names, units, cells)):
        groups, rows[names] = grouped
        used.append(groups)
        notes.append(f"names are under groups, or groups over names, in line {above[groups].number}")
    remarks = above[: min(used)] if used else above
    for number in range(min(used, default=top) + 1, top):
        if number not in used:
            notes.append(f"left out line {above[number].number}, {show(above[number].text)}: no row of numbers")
    if remarks:
        shown = "; ".join(" ".join(line.text.split())[:80] for line in remarks[:_MOST_REMARKS])
        notes.append(f"above {'the names' if used else 'the rows'}: {shown}")
    parts = _split_units(
        rows[names] if names is not None else [""] * width, rows[units] if units is not None else [""] * width
    )
    notes += [_describe_conflict(*part) for part in zip(*parts, strict=True) if _contradicts(*part[1:])]
    others_above = [line for number, line in enumerate(above) if number not in used]
    others_split = [split(line.text, delimiter) for line in others_above]
    listed = _find_listed_units(parts[0], parts[2], remarks, delimiter)
    if any(row[0] == "X_Dimension" and "Time" in row for row in others_split if row):  # LabVIEW's .lvm
        listed["X_Value"] = "s"
    return Headings(
        *parts[:2],
        [own or listed.get(name, "") for name, own in zip(parts[0], parts[2], strict=True)],
        list_numbers(others_above, cells)
        | (list_pairs(rows, cells) if paired else list_common(others_split, cells))
        | beside,
        notes,
        int(units is not None),
        _list_firsts(above, used, delimiter, cells),
        list_scalings(rows, others_split, width, paired is not None, cells),
    )


def _list_firsts(above: Sequence[Line], used: Sequence[int], delimiter: str, cells: Cells) -> dict[str, Sequence[str]]:
    """First cells of the last lines above the rows; with all cells of the lines `used` for names and units, else none."""
    firsts: dict[str, Sequence[str]] = {}
    for number in range(max(len(above) - _MOST_REMARKS, 0), len(above)):
        row = split(above[number].text, delimiter)
        if row and row[0] and not (cells.is_number(row[0]) or cells.is_missing(row[0]) or find_time_format(row[:1])):
            firsts[row[0]] = row if number in used else ()
    return firsts


def _list_nearest(top: int, rows: Mapping[int, Sequence[str]], cells: Cells) -> Sequence[int]:
    """Numbers of the lines in which names and units can be, the nearest to the rows first.

    Lines of statistics between them and the rows, as `Min;0.5;1.5`, do not count.
    """
    within = range(top - 1, max(top - 1 - _MOST_REMARKS, -1), -1)
    return [n for n in within if not _are_statistics(rows[n], cells)][:_SEARCHED]


def _are_statistics(row: Sequence[str], cells: Cells) -> bool:
    """Whether a line has the name of a statistic and then a number in each column."""
    return len(row) > 1 and bool(STATISTIC.fullmatch(row[0])) and all(map(cells.is_number, row[1:]))


def _is_label(cells: Sequence[str]) -> bool:
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
    if units is not None and _is_label(rows[units][:1]) and timed and timed[0] > units:
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
    rows: Mapping[int, Sequence[str]], others: Mapping[int, Sequence[str]], top: int
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


def _add_name_of_rows(line: Line, width: int, delimiter: str) -> list[str]:
    """The cells of a line that has one too few, as the first column has no name; none for another line."""
    row = [" ".join(cell.split()) for cell in split(line.text, delimiter)]
    return ["", *row] if len(row) == width - 1 and all(row) and not _ROW_NAME.fullmatch(split_unit(row[0])[0]) else []


def are_names(row: Sequence[str], cells: Cells, width: int) -> bool:
    """Whether the cells of a line can be names of columns."""
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


def _check_widths(path: Path, above: Sequence[Line], width: int, delimiter: str) -> None:
    """Raise InputError where the line above the rows is a list of names, but of other columns."""
    if not above or above[-1].comment:
        return
    row = split(above[-1].text, delimiter)
    count = sum(map(bool, row))
    if len(row) != width and 2 * count >= width and count > 1:
        raise InputError(
            f"recording {path}: line {above[-1].number} has {count} names, rows have {width} cells: set delimiter or decimal"
            " in [file], or header = false, and select columns by number"
        )


def _check_no_rows(path: Path, above: Sequence[Line], width: int, delimiter: str, cells: Cells) -> None:
    """Raise InputError where many of the lines above the rows are rows themselves, of a table with other columns."""
    counts = [_count_values(line, delimiter, cells) for line in above]
    for number in range(len(above) - _FEWEST_ROWS + 1):
        if counts[number] > 1 and len(set(counts[number : number + _FEWEST_ROWS])) == 1:
            last = max(n for n, count in enumerate(counts) if count == counts[number])
            raise InputError(
                f"recording {path} has two tables: rows of {counts[number]} cells from line {above[number].number} to"
                f" {above[last].number}, of {width} below; set skip_lines = {above[last].number} in [file] for the second"
                " one, or split the file"
            )


def _count_values(line: Line, delimiter: str, cells: Cells) -> int:
    """How many cells a line has, where all are numbers or times and it is no comment; else 0."""
    row = [] if line.comment else split(line.text, delimiter)
    return len(row) if all(cells.is_number(cell) or find_time_format([cell]) for cell in row) else 0


def _split_cells(line: Line, widths: tuple[int, int], delimiter: str) -> list[str]:
    """The cells of a line above the rows, as many as a row has; empty where it has others."""
    least, width = widths
    row = [" ".join(cell.split()) for cell in split(line.text, delimiter)]
    if delimiter == RUNS and len(row) > 1 and len(marks := {cell[-1:] for cell in row[:-1]} & {",", ";"}) == 1:
        row = [cell.rstrip(*marks) for cell in row] if all(cell[-1:] in marks for cell in row[:-1]) else row
    if len(row) == width + 1 and row[-1] == _UNUSED_NAME:
        del row[-1]
    if least == 1 < width and any(row[1:]):
        return []  # `Vertical Scale,0.5,` above `17,` of GW Instek: a setting
    if len(row) >= least and not any(row[width:]):
        return [*row, *[""] * width][:width]
    for mark in ("\t", ";", ",", "|"):  # names may be parted otherwise than numbers are
        row = split(line.text, mark)
        if len(row) == width and all(row):
            return row
    text = line.text.strip()
    for row in (re.split(r"\s\s+", text), _NAMES_APART.findall(text) if delimiter == RUNS else []):
        if len(row) == width > 1:
            return row
    return []


def _are_units(row: Sequence[str], known_as: Callable[[str], bool] = is_unit) -> bool:
    """Whether the cells are units: more known ones than others, and these short; behind a label one, of half of the columns.

    known_as: whether a cell is a known unit.
    """
    if _is_label(row[:1]) and 2 * sum(map(bool, row[1:])) < len(row):
        return False
    if row and _AXIS_LABEL.fullmatch(row[0]):
        return False
    given = [cell for cell in (row[1:] if _is_label(row[:1]) else row) if cell and cell not in ("-", "--")][
        :_JUDGED_UNITS
    ]
    units = [cell for cell in given if known_as(strip_brackets(cell)) or _LABELLED.fullmatch(cell)]
    if len(units) < len(given):  # the number of a channel before its name and unit is none
        units = [cell for cell in units if not cell.isdigit()]
    known = sum(cell == "1" or not _NUMBER.fullmatch(cell) for cell in units)
    return (
        known > 0
        and (_is_label(row[:1]) or 2 * known > len(given))
        and all(len(cell) <= _LONGEST_UNIT for cell in given)
    )


def _find_listed_units(
    names: Sequence[str], units: Sequence[str], remarks: Sequence[Line], delimiter: str
) -> dict[str, str]:
    """Units of columns without one, by a list of channels above: `2;torque;Nm` has a name and one unit."""
    wanted = {name for name, unit in zip(names, units, strict=True) if not unit}
    units_by_name: dict[str, str] = {}
    for line in remarks[-_MOST_LISTED:]:
        row = [strip_brackets(cell.strip()) for cell in split(line.text, delimiter)]
        own = next((cell for cell in row if cell in wanted), None)
        stated = [cell for cell in row if own and cell != own and not cell.isdigit() and cell and is_unit(cell)]
        if own and len(stated) == 1:
            units_by_name.setdefault(own, stated[0])
    return units_by_name


def _contradicts(text: str, unit: str) -> bool:
    """Whether the unit in brackets in the `text` of a name is another one than the `unit` below it."""
    own = split_unit(text)[1]
    known = own and is_unit(own) and is_unit(unit)
    return bool(known) and contradict(simplify_unit(own), simplify_unit(unit))


def _describe_conflict(name: str, text: str, unit: str) -> str:
    return f"{name}: its unit is {split_unit(text)[1]} by its name, and {unit} by the line of units, which is used"


def _split_units(names: Sequence[str], units: Sequence[str]) -> tuple[list[str], list[str], list[str]]:
    """Names without units, names as written but unique, and units."""
    full = [name.strip("\ufeff\0 ") or f"column {number}" for number, name in enumerate(names, 1)]
    counts = Counter(full)
    plain, texts, parted = [], [], []
    for number, (text, unit) in enumerate(zip(full, units, strict=True), 1):
        name, own = split_unit(text)
        twice = counts[text] > 1
        plain.append(text if twice else name)
        texts.append(f"{text} (column {number})" if twice else text)
        if labelled := _LABELLED.fullmatch(unit):  # `units: s, Nm`, and `Units: Nm` in each cell of Simulink
            unit = labelled["unit"]
        elif number == 1 and _is_label([unit]):
            unit = ""
        parted.append(strip_brackets(unit) or own)
    return plain, texts, parted
