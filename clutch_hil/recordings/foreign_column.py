"""ForeignColumn: source of a run's column in a foreign file, and the conversion of its values."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import isclose, isnan, nan, tau
from pathlib import Path

import numpy as np

from clutch_hil.recordings.channel import Channel, Recording, Signal, says_absolute, simplify_unit
from clutch_hil.recordings.column_formula import ColumnFormula
from clutch_hil.recordings.stated_scaling import describe_scaling_beside
from clutch_hil.recordings.unit_in_name import hint_unit
from clutch_hil.recordings.unknown_unit import says_more
from clutch_hil.recordings.wrapping import find_range, unwrap
from protocols.errors import InputError, format_count
from protocols.files.toml_table import TomlTable
from protocols.files.units import contradict, from_si, have_same_quantity, to_si

_KEYS = (
    "from", "number", "unit", "unit_from", "scale", "scale_by", "offset", "hold", "wraps_at", "missing", "rate_hz", "constant",
    "formula", "states",
)  # fmt: skip
_MOST_HZ = 1e9  # Hz, largest rate of rows: more than any recorder of a rig
_LARGEST = 1e100  # of a number in a map: results computed from it stay finite
# Of a number in a file, in its unit: above any whole number of 64 bits, such as ns since 1970, and below those that tools
# write where there is no value: 1e20, 9.97e36, 9.9e37 and 3.4e38
_LARGEST_IN_FILE = 2e19
_SAME_NUMBER = 1e-6  # relative tolerance of equal numbers, for a file with 32-bit numbers
_AIR_PA = 101325.0  # Pa, the standard atmosphere (ISO 2533)
_WORK = re.compile(r"(?<![A-Za-z])([kMm]?(J|Wh|cal|eV)|[kMm]?W\W?s|BTU)(?![A-Za-z])|joule")  # units of work (energy)
_FEW_STATES = 32  # largest number of different integers in a column without unit that counts as a status
# Units of a speed of rotation, one of which replaces 1/min, 1/s or Hz of a file, in words
_TURNS = {"rpm": "turns a minute", "rps": "turns a second", "krpm": "thousands of turns a minute"}
# End of a column's name -> its unit (docs/rig.md, "Signals of a recorded run")
UNITS = {
    "s": "s", "v": "V", "rad": "rad", "rad_s": "rad/s", "bar": "bar", "degc": "degC", "nm": "Nm", "n": "N", "m": "m",
    "m_s": "m/s", "a": "A", "w": "W", "hz": "Hz", "1": "1",
}  # fmt: skip


@dataclass(frozen=True)
class ForeignColumn:
    """Source of a run's column in a foreign file, from an entry of an import map.

    column: name, or number from 1; 0 if not read from the file. unit: "" where the file's own unit applies. trust_file: whether
    a unit in the file takes precedence over `unit`. scale: factor. scale_by: name of a number in the file, a further factor; ""
    for none. offset: added after the factors; None where the map has none. hold: whether the value is held between samples;
    None: decided by content. wraps_at: range after which the values start again at 0, in the file's unit; 0 for never. missing:
    numbers that mark a missing value. states: words of the file with the numbers that they stand for. Not read from the file
    are: a time that counts rows at `rate_hz`, 0 for none; a `constant` in the unit of the run's column, NaN for none; a
    `formula` of other columns.
    """

    column: str | int
    unit: str = ""
    trust_file: bool = True
    scale: float = 1.0
    scale_by: str = ""
    offset: float | None = None
    hold: bool | None = None
    wraps_at: float = 0.0
    missing: tuple[float, ...] = ()
    states: tuple[tuple[str, float], ...] = ()
    rate_hz: float = 0.0
    constant: float = nan
    formula: ColumnFormula | None = None

    @property
    def is_read(self) -> bool:
        """Whether the column is read from the file."""
        return not self.rate_hz and isnan(self.constant) and not self.formula


@dataclass(frozen=True)
class Reading:
    """An open recording with the map's entries: the source of each column of the run, and the number of first rows to leave
    out."""

    path: Path
    recording: Recording
    sources: Mapping[str, ForeignColumn]
    skip_rows: int


def find_unit(column: str) -> str:
    """Return the unit of a run's column from the end of its name. Raises InputError."""
    words = column.split("_")
    for end in ("_".join(words[-2:]), words[-1]):
        if end in UNITS and len(words) > 1:
            return UNITS[end]
    raise InputError(
        f"column {column!r} does not end with a unit; allowed endings are {', '.join('_' + end for end in UNITS)}"
    )


def read_column(column: str, columns: TomlTable) -> ForeignColumn:
    """Read the source of the run's `column` from its entry in [columns] of a map. Raises InputError."""
    find_unit(column)
    entry = columns.read_subtable(column, _KEYS)
    if "rate_hz" in entry:
        return _read_rate(column, entry)
    if "constant" in entry:
        return _read_constant(column, entry)
    if "formula" in entry:
        return _read_formula(column, entry)
    if ("from" in entry) == ("number" in entry):
        raise InputError(f"{column} needs either `from`, a name, or `number`, counted from 1")
    unit, source = entry.get("unit", str, ""), entry.get("unit_from", str, "file")
    _check_source(column, source)
    if source == "map" and not unit:
        raise InputError(f"{column} has unit_from = 'map' and no unit")
    if unit and not have_same_quantity(unit, find_unit(column)):
        raise InputError(f"{column} is given in {unit!r}, which cannot be converted into {find_unit(column)!r}")
    if not (scale := entry.get("scale", float, 1.0)):
        raise InputError(f"{column}.scale is 0; allowed is any other number")
    wraps_at = entry.get("wraps_at", float, 0.0)
    if not 0.0 <= wraps_at <= _LARGEST:
        raise InputError(f"{column}.wraps_at is {wraps_at:g}; allowed is above 0, in the file's unit")
    return ForeignColumn(
        entry.get("from", str) if "from" in entry else entry.get("number", int),
        unit,
        source == "file",
        scale,
        entry.get("scale_by", str, ""),
        entry.get("offset", float, None),
        entry.get("hold", bool, None),
        wraps_at,
        entry.get_numbers("missing"),
        _read_states(column, entry),
    )


def _read_states(column: str, entry: TomlTable) -> tuple[tuple[str, float], ...]:
    """Read the numbers that words of the file stand for. Words are compared without regard to case."""
    table = entry.read_subtable("states")
    states = {word: table.get(word, float) for word in table}
    lower = [word.strip().lower() for word in states]
    if column == "time_s" and states:
        raise InputError("time_s has states; they are allowed only for other columns")
    if twice := next((word for word in lower if lower.count(word) > 1), ""):
        raise InputError(f"{column}.states has {twice!r} more than once; words are compared without regard to case")
    return tuple(states.items())


def _check_source(column: str, source: str) -> None:
    if source not in ("file", "map"):
        raise InputError(f"{column}.unit_from is {source!r}; allowed are file and map")


def _read_rate(column: str, entry: TomlTable) -> ForeignColumn:
    """Read a time that counts rows at a rate."""
    rate, source = entry.get("rate_hz", float), entry.get("unit_from", str, "file")
    if column != "time_s" or not {*entry} <= {"rate_hz", "unit_from"}:
        raise InputError(f"{column} has rate_hz; it is allowed only as the single entry of time_s")
    _check_source(column, source)
    if not 0.0 < rate <= _MOST_HZ:
        raise InputError(f"time_s.rate_hz is {rate:g}; allowed is above 0, up to {_MOST_HZ:g}")
    return ForeignColumn(0, "s", source == "file", rate_hz=rate)


def _read_constant(column: str, entry: TomlTable) -> ForeignColumn:
    """Read a constant column, which is not in the file."""
    value = entry.get("constant", float)
    if column == "time_s" or list(entry) != ["constant"]:
        raise InputError(f"{column} has constant; it is allowed only as the single entry of a column other than time_s")
    if not abs(value) <= _LARGEST:
        raise InputError(f"{column}.constant is {value:g}; allowed is a number up to {_LARGEST:g}")
    return ForeignColumn(0, constant=value)


def _read_formula(column: str, entry: TomlTable) -> ForeignColumn:
    """Read a column that is computed from others."""
    if column == "time_s" or list(entry) != ["formula"]:
        raise InputError(f"{column} has formula; it is allowed only as the single entry of a column other than time_s")
    return ForeignColumn(0, formula=ColumnFormula(column, entry.get("formula", str)))


def can_become(unit: str, wanted: str) -> bool:
    """Return whether `unit` can be converted to `wanted`; units of work such as J are not torques. Raises InputError."""
    return have_same_quantity(unit, wanted) and not (wanted == "Nm" and _WORK.search(unit))


def convert_signal(reading: Reading, name: str, signal: Signal, notes: list[str], origin: float = 0.0) -> np.ndarray:
    """Convert a signal to values (n,) in the unit of the run's column `name`. origin: subtracted first, in the file's unit.

    notes: a sentence on each conversion is appended. Raises InputError for text, a unit of another quantity, an absolute
    pressure without an offset, whole numbers with a stated scaling that the map does not decide on, and a number that is too
    large.
    """
    path, source, channel = reading.path, reading.sources[name], signal.channel
    if channel.kind == "text":
        cells = f", {channel.comment}" if channel.comment.startswith("such as") else ""
        remedy = "; set time_format in [file] where these are times" if cells else ""
        if name != "time_s":
            remedy = "; set states = { WORD = NUMBER, ... } for it in the map where its words stand for numbers"
        raise InputError(
            f"recording {path}: column {channel.name!r} for {name} holds text{cells}; allowed are numbers{remedy}"
        )
    if channel.states:
        raise InputError(f"recording {path}: column {channel.name!r} for {name} holds no words; states are for words")
    if source.states:
        notes.append(f"{channel.name}: by the map {', '.join(f'{word} is {one:g}' for word, one in source.states)}")
    unit = choose_unit(path, name, source, channel, notes)
    if (source.scale, source.scale_by, source.offset) == (1.0, "", None):
        beside = describe_scaling_beside(channel.name, reading.recording.numbers)
        if scaling := ", ".join(filter(None, (channel.scaling, beside))):
            _check_scaling(path, name, signal, scaling, notes)
    scale = source.scale
    if source.scale_by:
        factor = reading.recording.numbers.get(source.scale_by)
        if factor is None:
            raise InputError(f"recording {path} has no number {source.scale_by!r} to scale {name} by")
        scale *= factor
    offset = source.offset or 0.0
    if source.offset is None and find_unit(name) == "bar" and is_absolute(channel):
        own = f" (in {channel.unit})" if channel.unit else ""
        raise InputError(
            f"recording {path}: {channel.path!r} for {name} says that it is absolute{own}, and a run has the one above the"
            f" air; set offset = {offset_air(unit):.5g} for it, which is in {unit}, or 0.0 where it is not absolute"
        )
    one, zero = (from_si(to_si(value, unit), find_unit(name)) for value in (1.0, 0.0))
    values = signal.values[reading.skip_rows :]
    for missing in source.missing:
        absent = np.isclose(values, missing, rtol=_SAME_NUMBER, atol=0.0)
        values = np.where(absent, nan, values)
        notes.append(
            f"{channel.name}: {format_count(np.count_nonzero(absent), 'sample')} of {missing:g}, which is no value"
        )
    if len(huge := np.flatnonzero(np.isfinite(values) & (np.abs(values) > _LARGEST_IN_FILE))):
        row = int(huge[0])
        raise InputError(
            f"recording {path}: {channel.path!r} for {name} is {values[row]:.4g} in row {row + reading.skip_rows}; allowed is"
            f" up to {_LARGEST_IN_FILE:g}; where it stands for no value, set missing = {float(values[row])!r} for {name} in the"
            " map"
        )
    if source.wraps_at:
        values, turns = unwrap(values, source.wraps_at)
        notes.append(
            f"{channel.name}: began anew {format_count(turns, 'time')} after {source.wraps_at:g}, which is undone"
        )
    elif channel.kind == "number" and name != "time_s" and (found := find_range(values))[0]:
        notes.append(
            f"{channel.name}: jumps by about {found[0]} in row {found[1] + reading.skip_rows}, as a counter that begins anew,"
            f" or a number below 0 that was stored without its sign; set wraps_at = {found[0]} then"
        )
    if origin:  # first of all: a time since 1970 in us or ns would lose digits as seconds
        values = values - origin
    if (one, zero, scale, offset) == (1.0, 0.0, 1.0, 0.0):
        return values
    return (one - zero) * (scale * values.astype(float) + offset) + zero  # with 32 bits a small unit could overflow


def _check_scaling(path: Path, name: str, signal: Signal, scaling: str, notes: list[str]) -> None:
    """Raise InputError for whole numbers for which the file states a `scaling`; for other numbers add a note."""
    channel, values = signal.channel, signal.values[np.isfinite(signal.values)]
    if np.all(values == np.rint(values)):
        raise InputError(
            f"recording {path}: {channel.path!r} for {name} has whole numbers, and the file states {scaling} of it,"
            " which is not applied; set scale and offset for it, or offset = 0.0 where its numbers are values already"
        )
    notes.append(f"{channel.name}: the file states {scaling}, which is not applied")


def is_absolute(channel: Channel) -> bool:
    """Return whether name or unit mark a pressure as absolute."""
    return says_absolute(channel.name, channel.unit)


def offset_air(unit: str) -> float:
    """Return the offset that converts an absolute pressure in `unit` to one relative to the atmosphere."""
    return -from_si(_AIR_PA, unit)


def choose_unit(path: Path, name: str, source: ForeignColumn, channel: Channel, notes: list[str]) -> str:
    """Return the unit of a foreign column: the file's where it states one, else the map's.

    Raises InputError for a missing or unknown unit, and for a unit of another quantity.
    """
    written = simplify_unit(channel.unit)
    if not written or not source.trust_file:
        if (
            not source.unit and channel.kind == "status" and find_unit(name) == "1"
        ):  # true and false, or names of states
            return "1"
        if not source.unit:
            raise InputError(f"recording {path} states no unit of {channel.name!r} for {name}; set `unit` in the map")
        if not written:
            _check_hint(path, name, source, channel)
        return source.unit
    try:
        fits = can_become(written, find_unit(name))
    except InputError:
        if not source.unit:
            raise InputError(
                f"recording {path}: {channel.name!r} for {name} has the unknown unit {channel.unit!r}; set `unit` in the map"
            ) from None
        if says_more(channel.unit, source.unit):
            raise InputError(
                f"recording {path}: {channel.name!r} for {name} is in {channel.unit!r} by the file, which is unknown, and in"
                f" {source.unit} by the map; set unit_from = 'map', and scale and offset where its numbers need them"
                f"{', or rate_hz where it counts rows' if name == 'time_s' else ''}"
            ) from None
        notes.append(
            f"{channel.name}: the file's unit {channel.unit!r} is unknown; the map's unit {source.unit} is used"
        )
        return source.unit
    if (
        not fits and find_unit(name) == "rad/s" and have_same_quantity(written, "Hz")
    ):  # 1/min may be a rotational speed in the notation of DIN and ISO
        turns = f"{channel.name}: the file's unit {channel.unit!r} counts turns"
        if source.unit and isclose(to_si(1.0, source.unit), tau * to_si(1.0, written)):
            notes.append(f"{turns}, by the map")
            return source.unit
        same = next((one for one in _TURNS if isclose(to_si(1.0, one), tau * to_si(1.0, written))), "")
        remedy = f"unit = {same!r}" if same else "unit, unit_from = 'map' and scale"
        raise InputError(
            f"recording {path}: {turns}, or something else; set {remedy} where these are {_TURNS.get(same, 'turns')}"
        )
    if not fits:
        raise InputError(
            f"recording {path}: {channel.name!r} for {name} is in {channel.unit!r}, which cannot be converted into"
            f" {find_unit(name)!r}; where a factor makes it so, or the file is wrong, set unit = {find_unit(name)!r},"
            f" unit_from = 'map' and scale, in {find_unit(name)} per {channel.unit}"
        )
    if source.unit and (to_si(1.0, written), to_si(0.0, written)) != (to_si(1.0, source.unit), to_si(0.0, source.unit)):
        notes.append(f"{channel.name}: the file says {channel.unit}, the map {source.unit}; the file's unit is used")
    return written


def _check_hint(path: Path, name: str, source: ForeignColumn, channel: Channel) -> None:
    """Raise InputError where the end of a channel's name is a unit that contradicts the map's, of the same quantity."""
    _, unit_of_name = hint_unit(channel.name)
    scaled = source.scale != 1.0 or source.scale_by  # the map may convert by its factor
    unit = simplify_unit(unit_of_name)
    if not unit_of_name or scaled or not source.trust_file or not have_same_quantity(unit, source.unit):
        return
    if contradict(unit, source.unit):
        raise InputError(
            f"recording {path}: {channel.name!r} for {name} is in {unit_of_name} by its name, and in {source.unit} by the map;"
            f" set unit = {unit_of_name!r}, or unit_from = 'map' where the name is wrong"
        )


def is_held(source: ForeignColumn, signal: Signal, name: str) -> bool:
    """Return whether a column holds its value between samples: according to the map, to the file, or to its content."""
    if source.hold is not None:
        return source.hold
    if signal.channel.kind == "status":
        return True
    values = signal.values[np.isfinite(signal.values)]
    unit = simplify_unit(signal.channel.unit) if source.trust_file else source.unit
    if find_unit(name) != "1" or unit not in ("", "1") or not len(values):
        return False
    return bool(np.all(values == np.rint(values))) and len(np.unique(values)) <= _FEW_STATES
