"""Time axes of a foreign recording: which time belongs to which column, and its unit."""

import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from math import floor, inf, isclose, isfinite, log10
from pathlib import Path

import numpy as np

from clutch_hil.recordings.channel import Channel, Recording, Signal, is_time_name, simplify_unit
from clutch_hil.recordings.foreign_column import ForeignColumn, Reading, choose_unit, convert_signal, is_held
from clutch_hil.recordings.rasters import TimedColumn
from clutch_hil.recordings.stated_rate import StatedRate, list_stated_rates
from protocols.errors import InputError
from protocols.files.units import to_si

EPOCH_S = 1e8  # s, three years: a time axis with a later beginning counts from a date, not from the start
# s; Julian days are 2.1e11 s, MATLAB's days since the year 0 are 6e10 s, ms since 1970 are above 9e11
_LATEST_S = 3e11
_DAY = 86400.0  # s
# Ranges of days: from 1982 to 2050 in Excel and as modified Julian days (MJD), about these years in MATLAB and as Julian days
_DAYS = ((3e4, 7e4), (7.2e5, 7.5e5), (2.44e6, 2.48e6))
# Names of a column that counts rows
_ROWS = re.compile(
    r"(sample|index|row|no\.?|nr\.?|point|scan|record|zeile|messpunkt|#)([\s_]*(no|nr|number|index)\.?)?", re.IGNORECASE
)
_MOST_TOLD = 3  # largest number of rates in a note
_COARSE = 1.5  # largest error factor of the mean rate of times in whole seconds, in a recording of some seconds
_PARTS_OF_DAYS = re.compile(r"time_ms", re.IGNORECASE)  # WinCC's name of a time in 1e-6 of these days
_FEWEST_DAYS = 10  # least rows for a decision
_FIRST_HOUR = 10000.0  # 1 o'clock as hhmmss: seconds of a recording rarely begin so late
_STEPS = (1e-30, 1e30)  # s, range of steps from which rates can be computed
_LONG_STEP = 1.0  # s; no rig records torque at less than 1 Hz
_TIME_UNITS = ("s", "ms", "us", "ns", "min")  # units in which loggers count time
# Multiples of its span after which a recording hardly ever begins: an oscilloscope begins near its trigger
_LATE_SPANS = 100.0
_SHORT_STEP = 2e-5  # s; no rig records torque at more than 50 kHz. As days it is 2 s
# s, of slow loggers; as days no usual rate. Those of half an hour and an hour are 48 and 24 Hz, as cameras have
_SLOW_STEPS, _SAME_STEP = (2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0, 1200.0), 1e-3
_USUAL_DIGITS = (1.0, 2.0, 2.5, 4.0, 5.0, 8.0)  # of the steps of loggers
_SLOWER_STEPS = (1800.0, 3600.0)


def count_rows(signals: Mapping[str, Signal], rate: float) -> Signal:
    """Return a time signal that counts rows at `rate` [Hz], for the raster of the first signal."""
    first = next(iter(signals.values()), Signal(Channel("", 0, ""), np.zeros(0)))
    rows = len(first.values)
    return Signal(Channel("row", 0, "row", "s", first.channel.raster, rows), np.arange(rows) / rate)


def check_rate(path: Path, recording: Recording, channels: Sequence[Channel], source: ForeignColumn) -> list[str]:
    """Return notes on the times that a file states, where a map counts the rows of `channels` at a rate.

    Raises InputError where the file states only other rates, and the map does not override it. Measured times may be coarse,
    such as those in whole seconds: they must differ by a large factor.
    """
    rasters, rate = {channel.raster for channel in channels}, source.rate_hz
    clocks = [c for c in recording.channels if c.raster in rasters and (c.kind == "time" or is_time_name(c.name))]
    notes = [f"{clock.path!r}, which are times by the file, are not used" for clock in clocks[:1]]
    measured = [StatedRate(c.path, f"{c.rate_hz:g} Hz", [c.rate_hz]) for c in channels if isfinite(c.rate_hz)]
    stated = list_stated_rates(recording.numbers, channels)
    if others := [str(one) for one in measured + stated if not one.agrees(rate)]:
        doubt = f"by the file the rate is another one: {', '.join(others[:_MOST_TOLD])}"
        denied = bool(stated) or any(not 1.0 / _COARSE < one.rates[0] / rate < _COARSE for one in measured)
        if source.trust_file and denied and len(others) == len(measured + stated):
            raise InputError(
                f"recording {path}: time_s is the number of the row over {rate:g} Hz by the map; {doubt}; set that rate, or"
                " unit_from = 'map' beside rate_hz where the file is wrong"
            )
        notes.append(doubt)
    return notes


def add_times(
    reading: Reading,
    signals: Mapping[str, Signal],
    times: Mapping[str, Signal],
    columns: Mapping[str, np.ndarray],
    notes: list[str],
) -> tuple[list[TimedColumn], str]:
    """Return all columns except time_s, each with its time [s], and the time of day of time 0.

    times: time channels in the groups of columns. notes: a sentence on each step is appended. Raises InputError for a column
    without a time, or with another number of rows.
    """
    path, recording, skip_rows = reading.path, reading.recording, reading.skip_rows
    clock, axis, start = signals["time_s"].channel, columns["time_s"], recording.start
    origin = 0.0
    if len(axis) and EPOCH_S < axis[0] < inf:
        _check_epoch(path, signals["time_s"].channel, axis[0])
        start = _format_time_of_day(axis[0]) or start
        notes.append(f"time_s begins at {axis[0]:.6f} s{f', {start}' if start else ''}; counted from there")
        origin = signals["time_s"].values[skip_rows]
        axis = convert_signal(reading, "time_s", signals["time_s"], [], origin)
        whole, source = signals["time_s"].whole, reading.sources["time_s"]
        if (
            whole is not None and not source.missing and not source.wraps_at
        ):  # subtract the first one before float64 loses the last digits
            since = np.array(whole - whole[skip_rows], float)
            axis = convert_signal(reading, "time_s", Signal(signals["time_s"].channel, since), [])
    trusted = reading.sources["time_s"].trust_file and not reading.sources["time_s"].rate_hz
    if trusted and clock.kind == "number" and not simplify_unit(clock.unit) and len(axis) > 1:
        _check_unit(reading, clock, axis, notes)
    numbers = signals["time_s"].values[skip_rows:]
    if trusted and clock.kind == "number" and _looks_like_hhmmss(numbers):
        raise InputError(
            f"recording {path}: {clock.path!r} for time_s begins at {numbers[0]:.12g} and has no seconds from 60 to 99: it is"
            " hhmmss, perhaps, as NMEA writes it; set time_format = '%H%M%S' in [file] for text, write seconds in other"
            " formats, or set unit_from = 'map' where these are seconds"
        )
    in_seconds = {simplify_unit(clock.unit), reading.sources["time_s"].unit} <= {"", "s"}
    if trusted and clock.kind == "number" and in_seconds and _looks_like_one_minute(numbers):
        notes.append(
            f"time_s begins at {numbers[0]:.12g} s: {clock.path!r} is a time of day as hhmmss, perhaps; its steps are right, as"
            " they are within a minute"
        )
    if clock.kind == "number" and _looks_like_days(axis):
        doubt = (
            f"time_s begins at {axis[0]:.6g} s with steps of {1e6 * np.median(np.diff(axis)):.3g} us: {clock.path!r} counts"
            " days of a spreadsheet, perhaps; set unit = 'd' then"
        )
        if trusted and not simplify_unit(clock.unit):
            raise InputError(f"recording {path}: {doubt}, or unit_from = 'map' where they are seconds")
        notes.append(doubt)
    if clock.number and not clock.unit and _ROWS.fullmatch(clock.name) and np.all(np.diff(axis) == 1.0):
        notes.append(
            f"time_s rises by 1 in each row: {clock.path!r} counts rows, perhaps; set time_s = {{ rate_hz = ... }} then"
        )
    timed = []
    for name, values in columns.items():
        if name == "time_s":
            continue
        signal = signals[name]
        if own := times.get(name):
            begin = origin * _count_seconds(reading, clock) / _count_seconds(reading, own.channel)
            time = convert_signal(reading, "time_s", own, [], begin)
            notes.append(f"{name}: at the times of {own.channel.path!r}, which is next to it")
        elif signal.channel.raster == clock.raster:
            time = axis
        elif clock.kind == "time" and signal.time is not None:
            time = convert_signal(reading, "time_s", Signal(clock, signal.time), [], origin)
        else:
            raise InputError(_describe_strangers(reading, signal, name, clock))
        if len(time) != len(values):
            raise InputError(
                f"recording {path}: {signal.channel.path!r} for {name} has {len(values)} rows, its time has {len(time)}"
            )
        timed.append(TimedColumn(name, time, values, is_held(reading.sources[name], signal, name)))
    if start:
        notes.append(f"recorded at {start}, by the file")
    return timed, start


def _count_seconds(reading: Reading, clock: Channel) -> float:
    """Return the unit of a time axis in seconds."""
    return to_si(1.0, choose_unit(reading.path, "time_s", reading.sources["time_s"], clock, []))


def _describe_strangers(reading: Reading, signal: Signal, name: str, clock: Channel) -> str:
    """Return the error text for a signal that does not share its rows with time_s."""
    own = [c.path for c in reading.recording.channels if c.kind == "time" and c.raster == signal.channel.raster]
    remedy = f"; take time_s from {own[0]!r}" if own else ", and no time axis of its own"
    return (
        f"recording {reading.path}: {signal.channel.path!r} for {name} has {len(signal.values)} rows on the raster"
        f" {signal.channel.raster!r}, time_s has {clock.rows} on {clock.raster!r}{remedy}"
    )


def _check_unit(reading: Reading, clock: Channel, axis: np.ndarray, notes: list[str]) -> None:
    """Check the map's unit of a time axis (n,) [s] for which the file states none.

    Raises InputError where a rate that the file states fits only in another unit, or shows that the axis counts rows. Whole
    numbers with steps of a second and more, which may be ms, are noted.
    """
    step = float(np.median(np.diff(axis))) if np.isfinite(axis).all() else 0.0
    unit = reading.sources["time_s"].unit
    if not _STEPS[0] < step < _STEPS[1]:
        return  # reported elsewhere
    values = 1e-6 * axis / to_si(1.0, unit)
    if _PARTS_OF_DAYS.fullmatch(clock.name) and _DAYS[0][0] < values[0] <= values[-1] < _DAYS[0][1]:
        raise InputError(
            f"recording {reading.path}: {clock.path!r} for time_s begins at {1e6 * values[0]:.10g}, as millionths of days of a"
            f" spreadsheet do (WinCC), in {unit} by the map; set unit_from = 'map', and unit = 'ud' for these"
        )
    beside = [channel for channel in reading.recording.channels if channel.raster == clock.raster]
    rates = list_stated_rates(reading.recording.numbers, beside)
    if any(stated.agrees(1.0 / step) for stated in rates):
        return
    seconds = step / to_si(1.0, unit)  # step of the file's numbers
    for stated in rates:
        if other := next((u for u in _TIME_UNITS if stated.agrees(1.0 / (seconds * to_si(1.0, u)))), ""):
            raise InputError(
                f"recording {reading.path}: {clock.path!r} for time_s rises by {seconds:g} a row, in {unit} by the map,"
                f" and by the file {stated}; set unit = {other!r}, or unit_from = 'map' where the file is wrong"
            )
    counts = axis / to_si(1.0, unit)
    if rates and np.allclose(np.diff(counts), 1.0, rtol=0.0, atol=1e-6):
        raise InputError(
            f"recording {reading.path}: {clock.path!r} for time_s rises by 1 a row, in {unit} by the map, and by the file"
            f" {rates[0]}: it counts rows, perhaps; set time_s = {{ rate_hz = {rates[0].rates[0]:g} }}, or"
            " unit_from = 'map' where the file is wrong"
        )
    whole = np.all(axis == np.rint(axis)) and not _ROWS.fullmatch(clock.name)
    if unit == "s" and step >= _LONG_STEP and whole:
        notes.append(
            f"time_s rises by {step:g} s a row in whole numbers, and the file states no unit of {clock.path!r}: it counts ms or"
            " us, perhaps; set unit then"
        )


def _check_epoch(path: Path, clock: Channel, first: float) -> None:
    """Raise InputError for a time that is so large in s that its unit must be ms, us or ns."""
    if first > _LATEST_S:
        remedy = "set unit and unit_from = 'map'" if clock.unit else "set unit"
        raise InputError(
            f"recording {path}: {clock.path!r} for time_s begins at {first:.6g} s, which no clock shows; if it counts ms, us or"
            f" ns since 1970, {remedy}"
        )


def _looks_like_hhmmss(numbers: np.ndarray) -> bool:
    """Return whether numbers (n,) are times of day as 115959.5, perhaps: they miss those from 60 to 99 before each hundred."""
    if len(numbers) < _FEWEST_DAYS or not np.isfinite(numbers).all() or not 0.0 <= numbers[0] < numbers[-1] < 240000.0:
        return False
    steps = np.diff(numbers)
    passing = np.diff(numbers // 100.0) > 0.0
    small = np.median(steps) < 20.0 and np.any(passing) and np.all(steps[passing] > 40.0)
    return bool(small and np.all(numbers % 100.0 < 60.0) and np.all(numbers // 100.0 % 100.0 < 60.0))


def _looks_like_one_minute(numbers: np.ndarray) -> bool:
    """Return whether numbers (n,) are times of day as 115930.5, perhaps, all of them within a minute."""
    if not len(numbers) or not np.isfinite(numbers).all() or not _FIRST_HOUR <= numbers[0] < numbers[-1] < 240000.0:
        return False
    return bool(
        numbers[0] // 100.0 == numbers[-1] // 100.0
        and numbers[0] // 100.0 % 100.0 < 60.0
        and numbers[-1] % 100.0 < 60.0
    )


def _looks_like_days(time: np.ndarray) -> bool:
    """Return whether a time (n,) [s] may be in days: since a date, or the fraction of a day with which Excel stores a time."""
    if len(time) < _FEWEST_DAYS or not np.isfinite(time).all():
        return False
    span, step = time[-1] - time[0], float(np.median(np.diff(time)))
    dated = any(low < time[0] <= time[-1] < high for low, high in _DAYS)
    steps = _SLOW_STEPS + (_SLOWER_STEPS if dated else ())
    slow = any(isclose(_DAY * step, usual, rel_tol=_SAME_STEP) for usual in steps)
    if time[0] == 0.0 and 0.0 < step < _SHORT_STEP:  # durations, which pandas writes so into a spreadsheet
        return _is_usual(_DAY * step) and not _is_usual(step)
    in_a_day = 0.0 < time[0] < 1.0 and (slow or time[0] > _LATE_SPANS * span)
    if not in_a_day and not dated:
        return False
    return slow or bool(span < 1.0 and 0.0 < step < _SHORT_STEP)


def _is_usual(step: float) -> bool:
    """Return whether a step [s] is one that loggers have: 1, 2, 2.5, 4, 5 or 8 times a power of ten."""
    digit = step / 10.0 ** floor(log10(step))
    return any(isclose(digit, usual, rel_tol=_SAME_STEP) for usual in (*_USUAL_DIGITS, 10.0))


def _format_time_of_day(epoch: float) -> str:
    """Format seconds since 1970 as ISO 8601; "" where this is no date in the past, as for days of a spreadsheet."""
    if not 0.0 < epoch < datetime.now(UTC).timestamp() + _DAY:
        return ""
    return datetime.fromtimestamp(epoch, UTC).isoformat()
