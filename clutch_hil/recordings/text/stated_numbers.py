"""Numbers above the rows of a text file: single ones with a name, such as a sampling rate, and factors of columns."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from math import isfinite

from clutch_hil.recordings.stated_rate import is_rate_name, split_value
from clutch_hil.recordings.stated_scaling import describe_scaling, is_scaling
from clutch_hil.recordings.text.cells import Cells
from clutch_hil.recordings.text.lines import Line, split

_MOST_REMARKS = 20  # lines in which numbers are looked for
_LONGEST_REMARK = 200  # characters of one in which a number is looked for
_NEAREST = 4  # lines above the rows in which numbers can stand beside the names
# A name and its value; an oscilloscope writes `Sample Interval,Analog:1E-05`
_REMARK = re.compile(
    r"\s*(?P<key>[^:=;\t]{1,80}?)\s*(?:[:=;,\t]\s*){1,2}(?:[A-Za-z]\w{0,20}:\s*(?=[0-9.+-]))?(?P<value>\S.*?)[\s;,]*"
)
_DIGITS = r"[0-9.]+(?:[eE][+-]?[0-9]+)?"
# Other rates and periods: `"Sample Rate","100.000","Hz"` of MoTeC, `Sample period 10 ms`, `10 msec/sample` of Biopac
_PARTED = re.compile(
    rf'[\s"]*(?P<key>[^"=;,\t]{{1,80}})"?[;,\t]"?(?P<value>{_DIGITS})"?[;,\t]"?(?P<unit>[A-Za-zµ/]{{1,8}})[\s";,]*'
)
_SPACED = re.compile(r"\s*(?P<key>[^\d:=;,\t]{2,80}?)\s+(?P<value>[0-9.]+)\s*(?P<unit>[A-Za-zµ/]{1,8})\W*")
_OF_A_SAMPLE = re.compile(r"\s*(?P<value>[0-9.]+)\s*(?P<unit>[munµ]?s(ec)?)\s*/\s*(?P<key>sample)\W*", re.IGNORECASE)
# A rate alone in its line, `100 Hz`; and one in a sentence, `sampled at 100 Hz`, `one sample every 10 ms`
_ALONE = re.compile(rf"\W*(?P<value>{_DIGITS})\s*(?P<unit>[kKM]?(?:Hz|SPS|S(?:a|amples)?/s(?:ec)?))\W*")
_SENTENCE = re.compile(
    rf".*\bsampl(?:es?|ed|ing)\s+(?:at|with|every)\s+(?P<value>{_DIGITS})\s*(?P<unit>[A-Za-zµ/]{{1,9}})\W*",
    re.IGNORECASE,
)
_ENTRY = re.compile(
    r"(?P<key>[A-Za-z]\w*)\s*=\s*(?P<value>[^\sA-Za-z]+(?:[eE][^\sA-Za-z]+)?)s?"
)  # in a cell, of seconds perhaps


def list_scalings(
    rows: Mapping[int, Sequence[str]], others: Iterable[Sequence[str]], width: int, paired: bool, cells: Cells
) -> list[str]:
    """Factors and offsets of each column, of lines with such a label before their numbers, or before each of them.

    rows: lines with as many cells as a row. others: those of all lines, in which the label may be one more cell.
    """
    lines = [row for row in rows.values() if len(row) == width > 1 and is_scaling(row[0])]
    labelled = [(row[0], row) for row in lines if all(map(cells.is_number, row[1 :: 1 + paired]))]
    longer = [row for row in others if len(row) == width + 1 > 2 and is_scaling(row[0])]
    labelled += [(row[0], row[1:]) for row in longer if all(map(cells.is_number, row[1:]))]
    return [
        describe_scaling((label, cells.read_number(row[n])) for label, row in labelled if cells.is_number(row[n]))
        for n in (range(width) if labelled else ())
    ]


def list_pairs(rows: Mapping[int, Sequence[str]], cells: Cells) -> dict[str, float]:
    """Numbers that all columns have in common, as `SampleTime[ms],10,SampleTime[ms],10`."""
    common = [row for row in rows.values() if row and set(row[::2]) == {row[0]} and len({*row[1::2]}) == 1]
    return {row[0]: cells.read_number(row[1]) for row in common if cells.is_number(row[1])}


def list_rates_beside(rows: Iterable[Sequence[str]], cells: Cells) -> dict[str, float]:
    """Rates that stand with their names in the first two cells of rows, as Tektronix has its settings beside the first ones."""
    pairs = [row[:2] for row in rows if len(row) > 2 and is_rate_name(row[0]) and cells.is_number(row[1])]
    return {name: cells.read_number(value) for name, value in pairs}


def list_common(rows: Iterable[Sequence[str]], cells: Cells) -> dict[str, float]:
    """Numbers that all columns have in common, in lines above the rows, as `Delta_X,0.01,0.01` of LabVIEW."""
    common = [(row[0], {*row[1:]} - {""}) for row in rows if len(row) > 2 and row[0] and not cells.is_number(row[0])]
    return {name: cells.read_number(*one) for name, one in common if len(one) == 1 and all(map(cells.is_number, one))}


def list_numbers(lines: Sequence[Line], cells: Cells) -> dict[str, float]:
    """Numbers of lines such as `Sample rate [Hz]: 100`, and of lines of JSON, `{"dt": 0.01}`."""
    numbers: dict[str, float] = {}
    for line in lines[:_MOST_REMARKS]:
        text = line.text[:_LONGEST_REMARK]
        if line.text.lstrip().startswith("{"):
            numbers |= _list_members(line.text)
        for other in filter(None, (pattern.fullmatch(text) for pattern in (_PARTED, _SPACED, _OF_A_SAMPLE))):
            key = "sample interval" if other["key"] == "sample" else other["key"]
            if rate := split_value(key, f"{other['value']} {other['unit']}"):
                numbers[rate[0]] = rate[1]
        if bare := _ALONE.fullmatch(text) or _SENTENCE.fullmatch(text):
            key = "sample interval" if bare["unit"][-1] in "sc" and "/" not in bare["unit"] else "sample rate"
            if rate := split_value(key, f"{bare['value']} {bare['unit']}"):
                numbers.setdefault(*rate)
        match = _REMARK.fullmatch(text)
        if match and cells.is_number(value := match["value"].strip('"')):
            numbers[match["key"].strip(' "')] = cells.read_number(value)
        elif match and (rate := split_value(match["key"].strip(' "'), match["value"].strip('"'))):
            numbers[rate[0]] = rate[1]
    return {name: number for name, number in numbers.items() if isfinite(number)}


def _list_members(text: str) -> dict[str, float]:
    """Numbers of an object of JSON in one line, by name; none where it is no such object."""
    try:
        members = json.loads(text, parse_int=float)
    except (ValueError, RecursionError):
        return {}
    return {name: value for name, value in members.items() if isinstance(value, float) and isfinite(value)}


def take_numbers_beside(
    above: Sequence[Line], width: int, delimiter: str, cells: Cells
) -> tuple[dict[str, float], dict[int, list[str]]]:
    """Numbers to the right of names and units, where the rows have no cells; and the `width` other cells of these lines.

    Rigol writes `X,CH1,Start,Increment` above `Sequence,Volt,-0.006,1E-05`, or `CH1,t0 = -0.006,tInc = 1E-05`.
    """
    numbers: dict[str, float] = {}
    others: dict[int, list[str]] = {}
    first = max(len(above) - _NEAREST, 0)
    lines = [split(line.text, delimiter) for line in above[first:]]
    for n, row in enumerate(lines):
        names, values = row[width:], lines[n + 1][width:] if n + 1 < len(lines) else []
        taken = [n]
        if entries := list(filter(None, map(_ENTRY.fullmatch, names))):
            names, values = [one["key"] for one in entries], [one["value"] for one in entries]
        else:
            taken.append(n + 1)
        named = [(name, value) for name, value in zip(names, values, strict=False) if name or value]
        if named and all(name and not cells.is_number(name) and cells.is_number(value) for name, value in named):
            numbers |= {name: cells.read_number(value) for name, value in named}
            others |= {first + k: [" ".join(cell.split()) for cell in lines[k][:width]] for k in taken}
    return numbers, others
