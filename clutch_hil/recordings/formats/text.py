"""Text: comma-separated values and relatives, with whatever delimiter, decimal mark, encoding and lines above the names.

What an import map does not set in [file] is found by content and told in the notes of the recording:

    encoding     "utf-8", "cp1252", "utf-16", ...
    delimiter    one character, or " " for any number of blanks and tabs
    decimal      "." or ","
    thousands    mark between thousands, such as "," or "."; "" for none
    header       whether a line of names stands above the rows
    skip_lines   lines of the file to leave out before anything is looked for
    units_row    line of the file, from 1, that has the units; 0 for none
    time_format  how times are written, in the directives of strptime: "%d.%m.%Y %H:%M:%S.%f"
    missing      further words for no value, separated by commas: "OVER, ---"
    hexadecimal  names of columns whose whole numbers are hexadecimal without being marked by 0x, separated by commas

Blank lines, comments, lines with zero bytes, damaged rows and what follows the rows are left out, and told. A word in a column
of numbers is an error. Memory grows with the columns that are asked for, not with the file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import nan
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa

from clutch_hil.recordings.channel import NO_VALUES, Channel, Recording, Signal, simplify_unit
from clutch_hil.recordings.foreign import describe_foreign
from clutch_hil.recordings.long_table import can_name_signals, make_refusal, names_signals
from clutch_hil.recordings.state_names import name_states
from clutch_hil.recordings.stated_scaling import describe_scaling
from clutch_hil.recordings.text.axes import Axis, find_axes, find_repeated_axes
from clutch_hil.recordings.text.cells import Cells, show
from clutch_hil.recordings.text.clock import Clock
from clutch_hil.recordings.text.column import ColumnReader
from clutch_hil.recordings.text.column_kind import is_date
from clutch_hil.recordings.text.layout import Layout, find_layout
from clutch_hil.recordings.text.lines import TextFile, looks_like_text
from clutch_hil.recordings.text.rows import Rows, read_rows
from clutch_hil.recordings.text.stated_numbers import list_rates_beside
from clutch_hil.recordings.unit_in_name import is_unit
from protocols.errors import InputError
from protocols.files.arrow import from_texts
from protocols.files.bounds import check_rows
from protocols.files.units import contradict, have_same_quantity, to_si

_DAY = 86400.0  # s
_JUDGED_ROWS = 100  # that tell whether dates have a time of day
RASTER = "rows"  # the only one of a text file
# unit of a time axis by its size, where it counts from 1970: from the year 2000 to 2100
_EPOCHS = {"s": (9.4e8, 4.2e9), "ms": (9.4e11, 4.2e12), "us": (9.4e14, 4.2e15), "ns": (9.4e17, 4.2e18)}


class Text:
    """Any text file with rows of numbers."""

    name = "text (CSV and relatives)"
    keys: ClassVar[Mapping[str, type]] = {
        "encoding": str, "delimiter": str, "decimal": str, "thousands": str, "header": bool, "skip_lines": int,
        "units_row": int, "time_format": str, "missing": str, "hexadecimal": str,
    }  # fmt: skip
    order = 2

    def recognises(self, head: bytes, path: Path) -> bool:
        return looks_like_text(head) and not describe_foreign(head)

    def open(self, path: Path, options: Mapping[str, Any]) -> Recording:
        file = TextFile(path, options.get("encoding", ""))
        return TextRecording(file, find_layout(file, options))


class TextRecording:
    """A Recording in a text file. Opening it has read the first lines, and counted all."""

    def __init__(self, file: TextFile, layout: Layout) -> None:
        self._file, self._layout = file, layout
        self.units_rows = layout.headings.units_rows  # of those that `skip_rows` counts
        self.numbers: Mapping[str, float] = {
            **layout.headings.numbers,
            **list_rates_beside(layout.samples[:_JUDGED_ROWS], layout.cells),
        }
        self.notes = list(layout.notes)
        self.start = self._find_start()
        rows = max(layout.last - layout.first + 1, 0)
        channels = self._list_channels(rows)
        self._axes = find_axes(channels, layout.samples, layout.cells)
        self._beside = [] if self._axes else find_repeated_axes(channels, layout.samples, layout.cells)
        self.channels: Sequence[Channel] = self._put_on_axes(channels)

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        axes = {channel.number: self._find_axis(channel.number) for channel in channels if self._axes}
        asked = {*(channel.number for channel in channels), *(axis.number for axis in axes.values())}
        clocks = [number for number in sorted(asked) if self._is_time_of_day(number)]
        date = self._find_date() if clocks else 0
        wanted = sorted({*asked, *([date] if date else [])})
        self._check_beside(sorted(asked))
        self._check_long(asked)
        for number in sorted(asked - {channel.number for channel in channels if channel.states}):
            self._check_doubt(number)
        check_rows(f"recording {self._file.path} has", self._layout.last - self._layout.first + 1, len(wanted))
        named = {channel.number: channel for channel in channels if channel.states}
        columns = {
            number: ColumnReader(self._file.path, named.get(number) or self._make_channel(number), self._layout)
            for number in sorted(asked)
        }
        values = {number: np.empty(max(self._layout.last - self._layout.first + 1, 0)) for number in columns}
        calendar = self._find_clock(date) if date else None
        days = np.empty(max(self._layout.last - self._layout.first + 1, 0) if date else 0)
        rows, count = Rows(), 0
        for table, lines in read_rows(self._file, self._layout, wanted, rows):
            for number, reader in columns.items():
                values[number][count : count + len(table)] = reader.read(
                    table.column(str(number)).combine_chunks(), lines
                )
            if calendar:
                cells = table.column(str(date)).combine_chunks()
                days[count : count + len(table)], _ = calendar.parse(cells, self._layout.cells.find_missing(cells))
            count += len(table)
        if not date:
            self._check_dates([columns[number] for number in clocks])
        for number in clocks if date else ():
            self._count_days(columns[number], values[number][:count], days[:count], date)
        notes = [
            *rows.list_notes(self._file.path, count),
            *(note for reader in columns.values() for note in reader.list_notes(count)),
        ]
        self.notes += [note for note in notes if note not in self.notes]
        signals = []
        for channel in channels:
            own = values[channel.number][:count]
            if channel.states:
                channel = name_states(channel)
            if axis := axes.get(channel.number):
                time = axis.factor * values[axis.number][:count]
                end = int(np.max(np.flatnonzero(np.isfinite(time)), initial=-1)) + 1  # a shorter table ends before
                own = time if channel.kind == "time" else own
                signals.append(Signal(channel, own[:end], time[:end]))
            else:
                signals.append(Signal(channel, own, whole=columns[channel.number].join_whole()))
        return signals

    def _is_time_of_day(self, number: int) -> bool:
        written = self._layout.columns[number - 1].time
        return bool(written and not written.doubt and not written.has_date)

    def _find_date(self) -> int:
        """Number of the first column of dates that are certain, 0 for none."""
        columns = enumerate(self._layout.columns, 1)
        return next((n for n, column in columns if self._is_date(n) and column.time and not column.time.doubt), 0)

    def _check_dates(self, clocks: Sequence[ColumnReader]) -> None:
        """Raise InputError where dates that cannot be read tell that days passed, and a clock did not pass midnight."""
        first, last = self._layout.samples[0], self._layout.samples[-1]
        for number, column in enumerate(self._layout.columns, 1):
            doubtful = column.time is not None and column.time.doubt and self._is_date(number)
            if doubtful and first[number - 1] != last[number - 1] and any(not clock.midnights for clock in clocks):
                self._check_doubt(number)

    def _count_days(self, clock: ColumnReader, seconds: np.ndarray, days: np.ndarray, date: int) -> None:
        """Set times of day (n,) [s] forward to the dates (n,) [s] beside them, where a clock alone misses whole days.

        Dates that are not in every row, or with which time would run back, as they change a row early, are left alone.
        """
        first = clock.find_first()
        if not (np.isfinite(days).all() and np.isfinite(seconds).all()):
            return
        missed = days - _DAY * np.floor((first + seconds) / _DAY)
        if missed.any() and np.all(np.diff(seconds + missed) > 0.0):
            seconds += missed
            self.notes.append(f"{clock.path}: its days are those of {self._make_channel(date).path!r}")

    def _find_axis(self, number: int) -> Axis:
        """The axis of time of a column: the last one before it."""
        return next((axis for axis in reversed(self._axes) if axis.number <= number), self._axes[0])

    def _put_on_axes(self, channels: Sequence[Channel]) -> Sequence[Channel]:
        """The channels, on a raster for each axis of time where there are several."""
        if not self._axes:
            return channels
        by_number = {channel.number: channel for channel in channels}
        first = by_number[self._axes[0].number]
        placed = []
        for channel in channels:
            axis = by_number[self._find_axis(channel.number).number]
            if channel is axis:
                channel = replace(channel, kind="time", unit="s", comment=f"in {channel.unit} in the file")
            if axis is not first:
                channel = replace(channel, rate_hz=nan, start_s=nan, end_s=nan)
            placed.append(replace(channel, raster=axis.path))
        names = ", ".join(repr(by_number[axis.number].path) for axis in self._axes)
        self.notes.append(f"has several axes of time, {names}: each counts for itself and the columns up to the next")
        return placed

    def _make_channel(self, number: int) -> Channel:
        return next(channel for channel in self.channels if channel.number == number)

    def _check_beside(self, wanted: Sequence[int]) -> None:
        """Raise InputError where columns of two tables, each with a time that has no unit, are asked for together."""
        for first, other in self._beside:
            if min(wanted, default=0) < other.number < max(wanted, default=0):
                raise InputError(
                    f"recording {self._file.path}: columns {first.number} and {other.number}, {first.path!r} and"
                    f" {other.path!r}, both rise, and differently, as times of two tables beside each other do; write their"
                    " unit below the names, such as s, or import each table with a map of its own"
                )

    def _check_long(self, asked: set[int]) -> None:
        """Raise InputError where each row has the value of another signal, by a column of words that is not asked for."""
        rows = self._layout.samples[: (len(self._layout.samples) + 1) // 2]  # not the last ones, which may be the same
        for channel in self.channels:
            if channel.kind == "text" and channel.number not in asked and can_name_signals(channel, self.channels):
                words = [row[channel.number - 1] for row in rows]
                if names_signals(words):
                    raise make_refusal(self._file.path, channel, words)

    def _check_doubt(self, number: int) -> None:
        written = self._layout.columns[number - 1].time
        if written and written.doubt:
            cell = next(row[number - 1] for row in self._layout.samples if row[number - 1])
            raise InputError(
                f"recording {self._file.path}: column {number} has times such as {cell!r}, which {written.doubt}"
            )

    def _list_channels(self, rows: int) -> list[Channel]:
        headings, channels = self._layout.headings, []
        for number, column in enumerate(self._layout.columns, 1):
            unit = "s" if column.kind == "time" else column.unit or headings.units[number - 1]
            if column.kind == "number" and not unit:
                unit = self._find_epoch(number)
            self._check_units(headings.texts[number - 1], column.unit, headings.units[number - 1])
            comment = f"{column.time.what}, counted from the first" if column.time else ""
            if column.kind == "text":
                comment = (
                    f"such as {show(next((row[number - 1] for row in self._layout.samples if row[number - 1]), ''))}"
                )
                if column.hexadecimal:
                    comment += f", perhaps hexadecimal: set hexadecimal = {headings.names[number - 1]!r} in [file] then"
                elif self._has_other_mark(number):
                    comment += f", whose decimal mark is not {self._layout.cells.decimal!r} as in other columns"
            elif all(self._layout.cells.is_missing(row[number - 1]) for row in self._layout.samples):
                comment = NO_VALUES
            name, text = headings.names[number - 1], headings.texts[number - 1]
            scaling = headings.scalings[number - 1] if headings.scalings and column.kind == "number" else ""
            channels.append(
                Channel(name, number, text, unit, RASTER, rows, kind=column.kind, comment=comment, scaling=scaling)
            )
        while len(channels) > 1 and self._is_spare(channels[-1]):
            channels.pop()
        if len(channels) == 1 and channels[0].kind == "number":  # what the file states is of it
            channels = [replace(channels[0], scaling=channels[0].scaling or describe_scaling(self.numbers.items()))]
        clocks = [channel for channel in channels if channel.kind == "time"]
        if any(not self._is_date(channel.number) for channel in clocks):  # dates beside times of day are no axis
            channels = [replace(c, kind="text", unit="") if self._is_date(c.number) else c for c in channels]
        return self._with_rate(channels, rows)

    def _check_units(self, name: str, behind: str, above: str) -> None:
        """Note a unit behind the numbers of a column that contradicts the one above them."""
        if behind and above and is_unit(above) and contradict(simplify_unit(behind), simplify_unit(above)):
            self.notes.append(
                f"{name}: its unit is {above} by its name or the line of units, {behind} behind its numbers counts"
            )

    def _has_other_mark(self, number: int) -> bool:
        """Whether the cells of a column are numbers with the other decimal mark."""
        other = Cells("." if self._layout.cells.decimal == "," else ",")
        cells = [row[number - 1] for row in self._layout.samples]
        return all(other.is_number(cell) or other.is_missing(cell) for cell in cells)

    def _choose_cells(self, number: int) -> Cells:
        return self._layout.columns[number - 1].choose_cells(self._layout.cells)

    def _is_spare(self, channel: Channel) -> bool:
        """Whether a column is only a delimiter at the end of each row."""
        number = channel.number - 1
        return channel.name == f"column {channel.number}" and not any(row[number] for row in self._layout.samples)

    def _find_epoch(self, number: int) -> str:
        """The unit of a column whose numbers count from 1970, by their size; "" for seconds, and for other columns."""
        first, last = self._layout.samples[0], self._layout.samples[-1]
        ends = [self._choose_cells(number).read_number(row[number - 1]) for row in (first, last)]
        for unit, (least, most) in _EPOCHS.items():
            if unit != "s" and least < ends[0] < ends[1] < most:
                name = self._layout.headings.texts[number - 1]
                self.notes.append(f"{name}: numbers such as {ends[0]:.0f} count {unit} since 1970")
                return unit
        return ""

    def _with_rate(self, channels: list[Channel], rows: int) -> list[Channel]:
        """The channels with times of the first column that is a time axis, where there is one with a unit."""
        axis = next((c for c in channels if c.kind == "time" and not self._describe_doubt(c)), None) or next(
            (c for c in channels[:1] if c.kind == "number" and _is_time(c.unit)), None
        )
        if not axis:
            return channels
        cells = from_texts([row[axis.number - 1] for row in (self._layout.samples[0], self._layout.samples[-1])])
        if axis.kind == "time":
            (start, end), _ = self._find_clock(axis.number).parse(cells, pa.array([False, False]))
        else:
            values = self._choose_cells(axis.number).parse(cells).values
            start, end = (to_si(value, simplify_unit(axis.unit)) for value in values)
        rate = (rows - 1) / (end - start) if end > start else nan
        return [replace(c, rate_hz=rate, start_s=start, end_s=end) for c in channels]

    def _describe_doubt(self, channel: Channel) -> str:
        written = self._layout.columns[channel.number - 1].time
        return written.doubt if written else ""

    def _find_clock(self, number: int) -> Clock:
        written = self._layout.columns[number - 1].time
        assert written is not None
        return Clock(written)

    def _find_start(self) -> str:
        """Time of day of the first row, by the first column that tells it; a date alone goes before a time of day."""
        date = ""
        for number, column in enumerate(self._layout.columns, 1):
            if column.time and not column.time.doubt:
                clock = self._find_clock(number)
                clock.parse(pa.array([self._layout.samples[0][number - 1]]), pa.array([False]))
                if self._is_date(number):
                    date = date or clock.start.partition("T")[0]
                elif clock.start:
                    return clock.start if "T" in clock.start or not date else f"{date}T{clock.start}"
        return date

    def _is_date(self, number: int) -> bool:
        """Whether a column has dates without a time of day."""
        return is_date(
            self._layout.columns[number - 1], (row[number - 1] for row in self._layout.samples[:_JUDGED_ROWS])
        )


def _is_time(unit: str) -> bool:
    try:
        return have_same_quantity(simplify_unit(unit), "s")
    except InputError:
        return False
