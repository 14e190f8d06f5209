"""Headings: names and units of the columns of a text file, and what else stands above its rows."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from clutch_hil.recordings.channel import simplify_unit
from clutch_hil.recordings.text.cells import Cells, show
from clutch_hil.recordings.text.clock import find_time_format
from clutch_hil.recordings.text.heading_lines import LABELLED, MOST_REMARKS, HeadingLines, find_heading_lines, is_label
from clutch_hil.recordings.text.heading_rows import split_rows
from clutch_hil.recordings.text.lines import Line, split
from clutch_hil.recordings.text.stated_numbers import list_common, list_numbers, list_pairs, list_scalings
from clutch_hil.recordings.unit_in_name import is_unit, split_unit, strip_brackets
from protocols.files.units import contradict

_MOST_LISTED = 2000  # lines above the names that may list channels: as many as are looked at


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
    column of dates before one of times of day, -1 for none. Raises InputError where there are other names than columns,
    or other rows above.
    """
    heading = split_rows(path, above, widths, delimiter, cells, counted, date)
    lines = find_heading_lines(path, above, heading, widths, delimiter, cells, options)
    rows, width = heading.cells, widths[1]
    units_row = [""] * width if lines.units is None else rows[lines.units]
    names, texts, units = _split_units(lines.row, units_row)
    notes = _describe_lines(above, lines, widths[0])
    notes += [_describe_conflict(*part) for part in zip(names, texts, units, strict=True) if _contradicts(*part[1:])]
    others = [line for number, line in enumerate(above) if number not in lines.used]
    others_split = [split(line.text, delimiter) for line in others]
    listed = _find_listed_units(names, units, _list_remarks(above, lines), delimiter)
    if any(row[0] == "X_Dimension" and "Time" in row for row in others_split if row):  # LabVIEW's .lvm
        listed["X_Value"] = "s"
    stated = list_pairs(rows, cells) if lines.paired else list_common(others_split, cells)
    return Headings(
        names,
        texts,
        [own or listed.get(name, "") for name, own in zip(names, units, strict=True)],
        list_numbers(others, cells) | stated | heading.beside,
        notes,
        int(lines.units is not None),
        _list_firsts(above, lines.used, delimiter, cells),
        list_scalings(rows, others_split, width, lines.paired, cells),
    )


def _list_remarks(above: Sequence[Line], lines: HeadingLines) -> Sequence[Line]:
    """The lines above those of names and units; all of them if there are none."""
    return above[: min(lines.used, default=len(above))]


def _describe_lines(above: Sequence[Line], lines: HeadingLines, width: int) -> list[str]:
    """Notes on what the lines above the rows were taken for. width: columns without the empty ones at the end."""
    notes = [f"names in line {above[lines.names].number}"] if lines.names is not None else []
    notes += [f"units in line {above[lines.units].number}"] if lines.units is not None else []
    if lines.names is None:
        notes.append(f"no names of columns: they are 'column 1' to 'column {width}'")
    if lines.groups is not None:
        notes.append(f"names are under groups, or groups over names, in line {above[lines.groups].number}")
    notes += [
        f"left out line {above[number].number}, {show(above[number].text)}: no row of numbers"
        for number in range(min(lines.used, default=len(above)) + 1, len(above))
        if number not in lines.used
    ]
    if remarks := _list_remarks(above, lines):
        shown = "; ".join(" ".join(line.text.replace("\0", "").split())[:80] for line in remarks[:MOST_REMARKS])
        notes.append(f"above {'the names' if lines.used else 'the rows'}: {shown}")
    return notes


def _list_firsts(above: Sequence[Line], used: Sequence[int], delimiter: str, cells: Cells) -> dict[str, Sequence[str]]:
    """First cells of the last lines above the rows; with all cells of the lines `used` for names and units, else none."""
    firsts: dict[str, Sequence[str]] = {}
    for number in range(max(len(above) - MOST_REMARKS, 0), len(above)):
        row = split(above[number].text, delimiter)
        if row and row[0] and not (cells.is_number(row[0]) or cells.is_missing(row[0]) or find_time_format(row[:1])):
            firsts[row[0]] = row if number in used else ()
    return firsts


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
        unit = unit.strip("\0 ")
        if labelled := LABELLED.fullmatch(unit):  # `units: s, Nm`, and `Units: Nm` in each cell of Simulink
            unit = labelled["unit"]
        elif number == 1 and is_label([unit]):
            unit = ""
        parted.append(strip_brackets(unit) or own)
    return plain, texts, parted
