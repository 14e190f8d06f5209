"""Repeated: runs that have the same samples. They would count twice in intervals, and a held-out run that is fitted, too, would
judge nothing.

Equation        two runs repeat each other where, from some shift on, every row that both have is the same in every column, to
                0.03 of the usual change from row to row or to the decimals that it is written with
Assumptions     noise: it never repeats. A simulation without noise repeats where it is the same simulation
Not modelled    copies at another rate, and copies that were filtered
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from clutch_hil.recordings.checks.finding import Finding
from protocols.errors import name_run

_ROWS = 50  # of a window that is looked for: white noise of one channel agrees in so many by chance once in 1e80
_WINDOWS = 8  # of each run: a stretch that two runs share has one where it is a fifth of one of them
_SAME = 0.03  # of the root mean square change from row to row: that of two noises is 1
_LEAST_VALUES = 10  # different ones in a window: fewer, as of a rig at rest without noise, are found everywhere
_MOST_DECIMALS = 6  # of a column as text; with more the rounding is below any noise


def find_repeated(runs: Sequence[tuple[str, Mapping[str, np.ndarray]]]) -> list[Finding]:
    """Hard findings, one for each run that has samples of an earlier one. runs: name, and columns (n,) by name, of each."""
    findings = []
    for place, (name, run) in enumerate(runs):
        for earlier, other in runs[:place]:
            if shared := _find_shared(other, run):
                first, last, own = shared
                text = f"are rows {first} to {last} of {name_run(earlier)}: give each stretch of a recording once"
                findings.append(Finding("repeated", "time_s", (own, own + last - first), text, True, name))
                break
    return findings


def _find_shared(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]) -> tuple[int, int, int] | None:
    """First and last row of `one` that `other` repeats, and the first row there; None where it repeats none."""
    if not (names := [name for name in one if name in other and name != "time_s"]):
        return None
    a, b = ([np.asarray(run[name], float) for name in names] for run in (one, other))
    limits = [max(_find_limit(x), _find_limit(y)) for x, y in zip(a, b, strict=True)]
    shifts = [*_find_shifts(a, b, limits), *(-shift for shift in _find_shifts(b, a, limits))]
    for shift in dict.fromkeys(shifts):
        first, last = max(shift, 0), min(len(a[0]), len(b[0]) + shift)
        pairs = zip(a, b, limits, strict=True)
        if last - first >= _ROWS and all(
            np.all(_are_same(x[first:last], y[first - shift : last - shift], limit)) for x, y, limit in pairs
        ):
            return first, last - 1, first - shift
    return None


def _find_shifts(where: list[np.ndarray], what: list[np.ndarray], limits: list[float]) -> Iterator[int]:
    """Rows by which windows of `what` are later in `where`."""
    for begin in np.linspace(0, max(len(what[0]) - _ROWS, 0), _WINDOWS).astype(int).tolist():
        window = [column[begin : begin + _ROWS] for column in what]
        telling = [len(np.unique(part)) for part in window]
        best = int(np.argmax(telling))
        if len(window[0]) < _ROWS or telling[best] < _LEAST_VALUES:
            continue
        places = np.arange(len(where[best]) - _ROWS + 1)
        for row, value in enumerate(window[best]):
            if not len(places):
                break
            places = places[_are_same(where[best][places + row], value, limits[best])]
        yield from (places - begin).tolist()


def _are_same(one: np.ndarray, other: np.ndarray | float, limit: float) -> np.ndarray:
    """Whether values are the same to `limit`, or are both missing."""
    return (np.abs(one - other) <= limit) | (np.isnan(one) & np.isnan(other))


def _find_limit(values: np.ndarray) -> float:
    """Difference of two values (n,) that are the same sample: noise, or the rounding of a text."""
    known = values[np.isfinite(values)]
    if len(known) < 2:
        return 0.0
    change = float(np.sqrt(np.mean(np.diff(known) ** 2)))
    for decimals in range(_MOST_DECIMALS + 1):
        if np.array_equal(np.round(known, decimals), known):
            return max(_SAME * change, 0.5 * 10.0**-decimals + 1e-9)
    return _SAME * change
