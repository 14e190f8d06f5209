"""Time restarts: detects times of a log that restart, because of two recordings in one file, or a clock that was set back.

Rule            times increase, return to their start, and increase again over the same range; in time order, frames of one
                identifier of one bus would be interleaved. Blocks that are only in another order fill each other's gaps, or
                have frames of other identifiers
Clock set back  times decrease anywhere; in the range that occurs twice, the frames of each sender before and after alternate
                one by one, and are denser than elsewhere. This does not hold for late frames, blocks in another order and
                frames of two buffers
"""

import numpy as np

_NEAR = 0.25  # of the range of times before: chosen, a bus may be silent at the beginning or the end
_LARGE = 0.5  # of this range: smaller steps back are ignored
_FALLING_SHARE = 0.1  # of all steps, in increasing times: a few frames are late in every log
_FEW = 10  # frames, or changes between the recordings: fewer do not allow a decision
_CHANGES_SHARE = 0.05  # of the frames: those of a cycle come together
_MOST_CHECKED = 8  # steps back that are checked: the first ones, in `find_step_back` the largest
_DENSER = 1.5  # ratio of frame rates that shows a range that occurs twice: halfway between 1 and 2
# Of the frames in a range that occurs twice; blocks in another order have several frames each
_ALTERNATING_SHARE = 0.5


def find_restart(stamps: np.ndarray, senders: np.ndarray) -> int | None:
    """Return the index of the first frame of a second recording; None if there is none.

    stamps [s], senders (bus and identifier): both (n,).
    """
    steps = np.diff(stamps)
    if not (steps < 0).any():
        return None
    low, high = np.minimum.accumulate(stamps)[:-1], np.maximum.accumulate(stamps)[:-1]
    near = _NEAR * (high - low)
    falls = np.concatenate([[0], np.cumsum(steps < 0)])
    before = np.arange(len(steps))
    returns = (steps < 0) & (before >= _FEW) & (stamps[1:] <= low + near) & (stamps[:-1] >= high - near)
    returns &= falls[:-1] <= _FALLING_SHARE * before
    for last in np.flatnonzero(returns)[:_MOST_CHECKED].tolist():
        begin = last + 1
        rising = falls[-1] - falls[begin] <= _FALLING_SHARE * (len(stamps) - begin)
        if rising and _repeats(stamps, begin, low[last], high[last]) and _interleaves(stamps, senders, begin):
            return int(begin)
    return None


def find_step_back(stamps: np.ndarray, senders: np.ndarray) -> int | None:
    """Return the index of the first frame after the clock was set back; None if it was not.

    Arguments as of `find_restart`.
    """
    steps = np.diff(stamps)
    falls = np.flatnonzero(steps < 0)
    if len(falls) > _FALLING_SHARE * len(steps):
        return None  # frames in arbitrary order
    largest = falls[np.argsort(steps[falls], kind="stable")[:_MOST_CHECKED]]
    for begin in (np.sort(largest) + 1).tolist():
        low, high = float(stamps[begin]), float(stamps[:begin].max())
        twice = np.flatnonzero((stamps >= low) & (stamps <= high))
        if _alternates(stamps[twice], senders[twice], twice >= begin) and _is_denser(stamps, senders, low, high):
            return int(begin)
    return None


def _alternates(stamps: np.ndarray, senders: np.ndarray, second: np.ndarray) -> bool:
    """Return whether frames of each sender before and after would alternate one by one in time order.

    second (n,): mask of the frames after.
    """
    order = np.lexsort((second, stamps, senders))
    changes = (second[order][1:] != second[order][:-1]) & (senders[order][1:] == senders[order][:-1])
    shared = np.isin(senders, np.intersect1d(senders[second], senders[~second]))
    least = min(np.count_nonzero(shared & second), np.count_nonzero(shared & ~second))
    return bool(np.count_nonzero(changes) >= max(_FEW, _ALTERNATING_SHARE * least))


def _is_denser(stamps: np.ndarray, senders: np.ndarray, low: float, high: float) -> bool:
    """Return whether the senders between `low` and `high` send more often there than elsewhere, unlike two buffers."""
    inside = (stamps >= low) & (stamps <= high)
    shared = np.isin(senders, senders[inside])
    outside_s = float(np.ptp(stamps)) - (high - low)
    rate = np.count_nonzero(inside) / (high - low)
    return outside_s > 0.0 and bool(rate > _DENSER * np.count_nonzero(shared & ~inside) / outside_s)


def _repeats(stamps: np.ndarray, begin: int, low: float, high: float) -> bool:
    """Return whether most large steps back lead to the start of the times before `begin`, as in successive recordings."""
    large = np.flatnonzero(np.diff(stamps[begin - 1 :]) < -_LARGE * (high - low)) + begin
    to_begin = int(np.count_nonzero(stamps[large] <= low + _NEAR * (high - low)))
    return len(large) - to_begin < to_begin


def _interleaves(stamps: np.ndarray, senders: np.ndarray, begin: int) -> bool:
    """Return whether frames of the same senders before and after `begin` would be interleaved in time order."""
    shared = np.isin(senders, np.intersect1d(senders[:begin], senders[begin:]))
    second = np.arange(len(stamps)) >= begin
    rows = np.flatnonzero(shared)
    counts = np.bincount(second[rows], minlength=2)
    ordered = second[rows][np.argsort(stamps[rows], kind="stable")]
    changes = np.count_nonzero(ordered[1:] != ordered[:-1])
    return bool(changes >= max(_FEW, _CHANGES_SHARE * counts.min()))
