"""Rasters: signals with different rates on one time axis.

Rule            A signal is interpolated linearly between its samples. A status (gear, phase, flag) holds its last value. Before
                the rate is reduced, a signal is low-pass filtered, so that nothing above half the new rate is aliased:
                Butterworth of order 4, forwards and backwards (no delay), at 0.4 of the new rate.
Gaps            A step between two samples of more than `longest_gap_s` ends a piece, and the next sample begins another: a gap
                is never bridged. Where no longest gap was stated, a step of more than ten median steps is an error.
Missing         A sample that is not a number counts as missing where a signal is resampled.
Events          Of single rows at one time, as a simulation has them before and after an event, the last one counts.
References      Oppenheim and Schafer, Discrete-Time Signal Processing, section 4.6 (filter before the rate is reduced);
                Gautier 1997 (forwards and backwards filter before inverse dynamics)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from protocols.errors import InputError, format_count
from protocols.files.bounds import check_rows

_FILTER_ORDER = 4  # usual before inverse dynamics: Gautier 1997
_LEAST_SHARE = (
    1e-6  # of half the rate: a constant of 1 then differs by 5e-5 (measured), below it the filter cannot be computed
)
ANTI_ALIAS_SHARE = 0.4  # share of the new rate: a common margin of a fifth below half of it
_FALLS = 1.01  # ratio of rates: smaller differences are within the tolerance of a sample period
_MOST_PIECES = 1000  # runs from one recording, at most: more indicate a wrong longest_gap_s
_HOUR = 3600.0  # s, by which clocks are set back at the end of summer time
# share of rows at the time of the row before: an event of a simulation has two rows; more are a clock that is too coarse
_MOST_REPEATED = 0.05
_GAP_STEPS = 10.0  # median steps, chosen: ten lost samples in a row are no jitter of a clock


@dataclass(frozen=True)
class TimedColumn:
    """A column (n,) of a run with its own time (n,) [s]. held: whether the value is held between samples."""

    name: str
    time: np.ndarray
    values: np.ndarray
    held: bool = False


@dataclass(frozen=True)
class Sampling:
    """Sampling that an import map asks for. low_pass_hz, resample_hz [Hz]: 0 for none. longest_gap_s [s]: 0 where not stated.

    low_pass_name: name of the low pass in errors.
    """

    low_pass_hz: float = 0.0
    resample_hz: float = 0.0
    longest_gap_s: float = 0.0
    low_pass_name: str = "import map: low_pass_hz"


Columns = Mapping[str, np.ndarray]


def join(file: Path, columns: Sequence[TimedColumn], sampling: Sampling) -> tuple[list[Columns], list[str]]:
    """Return pieces without gaps, each with `time_s` and all columns on it, and a sentence on each processing step.

    Raises InputError with column and row where times do not increase, or jump; where rasters differ and the map does not
    resample; where more rows are asked for than memory allows.
    """
    notes: list[str] = []
    columns = _keep_last_at_each_time(columns, notes)
    for column in columns:
        _check_increasing(file, column)
    if sampling.resample_hz:
        return _resample(file, columns, sampling, notes), notes
    first = columns[0]
    for column in columns[1:]:
        if column.time is not first.time and not np.array_equal(column.time, first.time):
            raise InputError(
                f"recording {file} has {first.name} and {column.name} on different rasters ({_describe_rate(first.time)} and"
                f" {_describe_rate(column.time)}); set resample_hz in [file] to join them"
            )
    pieces: list[Columns] = []
    for part in _find_pieces(file, first, sampling.longest_gap_s, notes):
        piece = {"time_s": first.time[part], **{c.name: c.values[part] for c in columns}}
        if sampling.low_pass_hz:
            rate = (part.stop - part.start - 1) / (first.time[part.stop - 1] - first.time[part.start])
            for column in columns:
                if not column.held:
                    piece[column.name] = filter_low_pass(
                        file, column.name, column.values[part], sampling.low_pass_hz, rate, sampling.low_pass_name
                    )
        pieces.append(piece)
    _note_low_pass(columns, sampling, notes)
    return pieces, notes


def _keep_last_at_each_time(columns: Sequence[TimedColumn], notes: list[str]) -> Sequence[TimedColumn]:
    """Return the columns without single rows at the time of the row after them; a note tells how many these are."""
    kept: dict[int, tuple[np.ndarray, np.ndarray]] = {}  # by the identity of a time: which rows remain, and their times
    for time in (column.time for column in columns):
        repeated = np.flatnonzero((time[1:] == time[:-1]) & np.isfinite(time[1:]))
        if id(time) in kept or not 0 < len(repeated) <= _MOST_REPEATED * len(time):
            continue
        remain = np.ones(len(time), bool)
        remain[repeated] = False
        kept[id(time)] = remain, time[remain]
        rows = format_count(len(repeated), "row")
        text = f"left out {rows} at the time of the row after it, as at an event of a simulation, the first at"
        notes.append(f"{text} {time[repeated[0]]:.6g} s")
    return [
        replace(column, time=kept[id(column.time)][1], values=column.values[kept[id(column.time)][0]])
        if id(column.time) in kept
        else column
        for column in columns
    ]


def _resample(file: Path, columns: Sequence[TimedColumn], sampling: Sampling, notes: list[str]) -> list[Columns]:
    kept = [_remove_missing(file, column, notes) for column in columns]
    spans = [(-np.inf, np.inf)]
    for column in kept:
        parts = _find_pieces(file, column, sampling.longest_gap_s, notes)
        own = [(column.time[part.start], column.time[part.stop - 1]) for part in parts]
        spans = [
            (max(a, c), min(b, d)) for a, b in spans for c, d in own if min(b, d) > max(a, c)
        ]  # spans in which every signal has samples
    check_rows(
        f"recording {file} at {sampling.resample_hz:g} Hz makes",
        sum((end - begin) * sampling.resample_hz + 1.0 for begin, end in spans),
        len(columns) + 1,
    )
    pieces: list[Columns] = []
    for begin, end in spans:
        # 1e-6: includes the last sample in spite of rounding
        rows = int((end - begin) * sampling.resample_hz + 1e-6) + 1
        if rows < 2:
            notes.append(f"left out {begin:.6g} to {end:.6g} s: shorter than two samples")
            continue
        grid = begin + np.arange(rows) / sampling.resample_hz
        pieces.append({"time_s": grid, **{c.name: _resample_to_grid(file, c, grid, sampling) for c in kept}})
    if not pieces:
        longest = max((end - begin for begin, end in spans), default=0.0)
        raise InputError(
            f"recording {file} has no two samples at {sampling.resample_hz:g} Hz: the longest stretch in which all columns have"
            f" samples is {longest:.4g} s"
        )
    _note_low_pass(columns, sampling, notes)
    notes += dict.fromkeys(_describe_resampling(column, sampling) for column in kept)
    if held := [column.name for column in columns if column.held]:
        notes.append(f"held the last value of {', '.join(held)} between samples: a status")
    return pieces


def _resample_to_grid(file: Path, column: TimedColumn, grid: np.ndarray, sampling: Sampling) -> np.ndarray:
    """Return the values (m,) of a column at the times `grid` (m,), which lie within a stretch without gaps."""
    begin = max(int(np.searchsorted(column.time, grid[0], side="right")) - 1, 0)
    end = int(np.searchsorted(column.time, grid[-1], side="left")) + 1
    time, values = column.time[begin:end], column.values[begin:end]
    if column.held:
        return values[np.searchsorted(time, grid, side="right") - 1]
    rate = _compute_rate(column.time)
    limits = [limit for limit in (sampling.low_pass_hz, _choose_anti_alias(rate, sampling)) if limit]
    if limits:
        check_rows(f"recording {file}: {column.name} has", (time[-1] - time[0]) * rate, 1)
        even = time[0] + np.arange(round((time[-1] - time[0]) * rate) + 1) / rate
        if len(even) != len(time) or not np.allclose(even, time, rtol=0.0, atol=1e-6 / rate):
            time, values = even, np.interp(even, time, values)
        values = filter_low_pass(file, column.name, values, min(limits), rate, sampling.low_pass_name)
    return np.interp(grid, time, values)


def _choose_anti_alias(rate: float, sampling: Sampling) -> float:
    """Return the cut-off frequency [Hz] of the anti-aliasing filter; 0 where the rate is not reduced."""
    return ANTI_ALIAS_SHARE * sampling.resample_hz if rate > _FALLS * sampling.resample_hz else 0.0


def filter_low_pass(
    file: Path | str, name: str, values: np.ndarray, limit: float, rate: float, what: str = "low-pass"
) -> np.ndarray:
    """Filter values (n,) at `rate` [Hz] with a low pass at `limit` [Hz], forwards and backwards.

    what: name of the low pass in errors. Raises InputError.
    """
    from scipy.signal import butter, sosfiltfilt  # loading takes half a second of CPU; few recordings are filtered

    if not limit < 0.5 * rate:
        raise InputError(f"{what} is {limit:g} Hz; allowed is below {0.5 * rate:g} Hz for {name} in {file}")
    if limit < (least := 0.5 * _LEAST_SHARE * rate):
        raise InputError(f"{what} is {limit:g} Hz; allowed is {least:g} Hz and more for {name} in {file}")
    low = butter(_FILTER_ORDER, limit / (0.5 * rate), output="sos")
    padding = 3 * (_FILTER_ORDER + 1)  # rows that sosfiltfilt adds at each end
    if len(values) <= padding:
        raise InputError(
            f"recording {file}: {name} has {len(values)} rows in a stretch without gaps; a low pass needs more than {padding}"
        )
    return np.asarray(sosfiltfilt(low, values, padlen=padding))


def _find_pieces(file: Path, column: TimedColumn, longest_gap: float, notes: list[str]) -> list[slice]:
    """Return the rows of a column between its gaps. Raises InputError for a gap where no longest one was stated."""
    time = column.time
    steps = np.diff(time)
    median = float(np.median(steps))
    gaps = np.flatnonzero(steps > (longest_gap or _GAP_STEPS * median))
    if len(gaps) and not longest_gap:
        row = gaps[0]
        summer = "; an hour forward is where summer time begins: write the times in UTC"
        hint = summer if 0.0 <= steps[row] - _HOUR <= _GAP_STEPS * median else ""
        raise InputError(
            f"recording {file}: the time of {column.name} jumps by {steps[row]:.6g} s after row {row}, from {time[row]:.6g} to"
            f" {time[row + 1]:.6g} s, where {median:.4g} s are usual; set longest_gap_s in [file]: shorter gaps are bridged by"
            f" straight lines, at longer ones the recording is cut into runs{hint}"
        )
    if len(gaps) >= _MOST_PIECES:
        raise InputError(
            f"recording {file}: {column.name} has {len(gaps)} gaps of more than longest_gap_s, {longest_gap:g} s; allowed are"
            f" {_MOST_PIECES - 1}"
        )
    ends = [0, *(gaps + 1), len(time)]
    parts = [slice(int(a), int(b)) for a, b in pairwise(ends)]
    whole = [part for part in parts if part.stop - part.start > 1]
    if len(gaps):
        text = f"cut at {len(gaps)} gaps of more than {longest_gap:g} s, the longest {steps[gaps].max():.4g} s"
        if len(whole) < len(parts):
            text += f"; left out {len(parts) - len(whole)} single rows"
        if text not in notes:
            notes.append(text)
    if not whole:
        raise InputError(
            f"recording {file}: every step of {column.name} is longer than longest_gap_s, {longest_gap:g} s"
        )
    return whole


def refuse_empty(file: Path, column: str, numbers: int) -> None:
    """Raise InputError for a column with no numbers, as loggers write one for a sensor that was not there."""
    if not numbers:
        raise InputError(
            f"recording {file}: {column} has no number in any row; if its sensor was not there, leave it out of the map"
            " (docs/identify.md#a-missing-sensor)"
        )


def _remove_missing(file: Path, column: TimedColumn, notes: list[str]) -> TimedColumn:
    finite = np.isfinite(column.values)
    if finite.all():
        return column
    missing = int(np.sum(~finite))
    refuse_empty(file, column.name, len(finite) - missing)
    if len(finite) - missing < 2:
        raise InputError(f"recording {file}: {column.name} has {len(finite) - missing} numbers; at least 2 are needed")
    notes.append(f"{column.name}: {missing} of {len(finite)} samples are not numbers, and count as missing")
    return replace(column, time=column.time[finite], values=column.values[finite])


def _check_increasing(file: Path, column: TimedColumn) -> None:
    time = column.time
    if len(bad := np.flatnonzero(~np.isfinite(time))):
        raise InputError(f"recording {file}: the time of {column.name} is not a number in row {bad[0]}")
    if len(time) < 2:
        raise InputError(f"recording {file}: {column.name} has {len(time)} rows; at least 2 are needed")
    if len(bad := np.flatnonzero(np.diff(time) <= 0.0)):
        row = bad[0] + 1
        step, usual = time[row] - time[row - 1], float(np.median(np.diff(time)))
        if 0.0 <= step + _HOUR <= _GAP_STEPS * abs(usual):
            hint = "an hour back is where summer time ends: split the file there, or write it in UTC"
        elif step == 0.0:
            hint = (
                "where a row is there twice, remove one of them, and set, where the rows are evenly spaced,"
                " time_s = { rate_hz = ... }"
            )
        else:
            hint = (
                "where another recording begins there, split the file; where it begins anew after a range, set wraps_at, and"
                " where the rows are evenly spaced, time_s = { rate_hz = ... }"
            )
        raise InputError(
            f"recording {file}: the time of {column.name} does not increase in row {row}: {time[row]:.9g} s after"
            f" {time[row - 1]:.9g} s; {hint}"
        )


def _compute_rate(time: np.ndarray) -> float:
    return 1.0 / float(np.median(np.diff(time)))


def _describe_rate(time: np.ndarray) -> str:
    return f"{len(time)} rows at {_compute_rate(time):.6g} Hz from {time[0]:.6g} s"


def _describe_resampling(column: TimedColumn, sampling: Sampling) -> str:
    steps = np.diff(column.time)
    median = float(np.median(steps))
    odd = int(np.sum(np.abs(steps - median) > 0.01 * median))  # 1 %: the tolerance of a run's sample period
    text = f"resampled at {sampling.resample_hz:g} Hz from {1.0 / median:.4g} Hz"
    limit = 0.0 if column.held else _choose_anti_alias(1.0 / median, sampling)
    if limit and not 0.0 < sampling.low_pass_hz <= limit:
        text += f", low-passed at {limit:g} Hz before"
    return (
        f"{text}: {odd} of {steps.size} steps differed from {1e3 * median:.4g} ms, the longest was"
        f" {1e3 * float(steps.max()):.4g} ms"
    )


def _note_low_pass(columns: Sequence[TimedColumn], sampling: Sampling, notes: list[str]) -> None:
    if sampling.low_pass_hz:
        which = "all columns" if not any(c.held for c in columns) else "all columns but statuses"
        notes.append(f"low-passed {which} at {sampling.low_pass_hz:g} Hz, forwards and backwards")
