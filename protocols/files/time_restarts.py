"""Time restarts: whether the times of a log begin anew, because two recordings are in one file, or a clock was set back.

Rule            Times rise, go back to where they began, and rise again over the same range; frames of one identifier of one bus
                would come to lie between each other. Blocks that are merely in another order fill each other's gaps, or have
                frames of other identifiers
Clock set back  Times fall anywhere, and in the range that is passed twice the frames of each sender before and after lie
                between each other one by one, and are more than elsewhere. Late frames, blocks in another order and the frames
                of two buffers are not
"""

import numpy as np

_NEAR = 0.25  # of the range of times before: chosen, a bus may be silent at the beginning or the end
_LARGE = 0.5  # of this range: steps back that count
_FALLING_SHARE = 0.1  # of the steps of times that rise: a few frames are late in every log
_FEW = 10  # frames, and changes between the two recordings, of which nothing can be said
_CHANGES_SHARE = 0.05  # of the frames: those of a cycle come together
_MOST_CHECKED = 8  # steps back, the first ones
_DENSER = 1.5  # times as many frames in a second where a range is passed twice: halfway between once and twice
# Of the frames in a range that is passed twice; blocks in another order have several frames each
_ALTERNATING_SHARE = 0.5


def find_restart(stamps: np.ndarray, senders: np.ndarray) -> int | None:
    """Index of the first frame of a second recording, None where there is none. Both (n,); senders: bus and identifier."""
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
    """Index of the first frame after the clock was set back, None where it was not. Both (n,), as of `find_restart`."""
    steps = np.diff(stamps)
    falls = np.flatnonzero(steps < 0)
    if len(falls) > _FALLING_SHARE * len(steps):
        return None  # frames in any order
    largest = falls[np.argsort(steps[falls], kind="stable")[:_MOST_CHECKED]]
    for begin in (np.sort(largest) + 1).tolist():
        low, high = float(stamps[begin]), float(stamps[:begin].max())
        twice = np.flatnonzero((stamps >= low) & (stamps <= high))
        if _alternates(stamps[twice], senders[twice], twice >= begin) and _is_denser(stamps, senders, low, high):
            return int(begin)
    return None


def _alternates(stamps: np.ndarray, senders: np.ndarray, second: np.ndarray) -> bool:
    """Whether frames of each sender before and after, which are the `second` ones, would come one by one in order of time."""
    order = np.lexsort((second, stamps, senders))
    changes = (second[order][1:] != second[order][:-1]) & (senders[order][1:] == senders[order][:-1])
    shared = np.isin(senders, np.intersect1d(senders[second], senders[~second]))
    least = min(np.count_nonzero(shared & second), np.count_nonzero(shared & ~second))
    return bool(np.count_nonzero(changes) >= max(_FEW, _ALTERNATING_SHARE * least))


def _is_denser(stamps: np.ndarray, senders: np.ndarray, low: float, high: float) -> bool:
    """Whether the senders of the times from `low` to `high` send more often there than elsewhere, as two buffers do not."""
    inside = (stamps >= low) & (stamps <= high)
    shared = np.isin(senders, senders[inside])
    outside_s = float(np.ptp(stamps)) - (high - low)
    rate = np.count_nonzero(inside) / (high - low)
    return outside_s > 0.0 and bool(rate > _DENSER * np.count_nonzero(shared & ~inside) / outside_s)


def _repeats(stamps: np.ndarray, begin: int, low: float, high: float) -> bool:
    """Whether most of the large steps back lead to the beginning of the times before `begin`, as in recordings one by one."""
    large = np.flatnonzero(np.diff(stamps[begin - 1 :]) < -_LARGE * (high - low)) + begin
    to_begin = int(np.count_nonzero(stamps[large] <= low + _NEAR * (high - low)))
    return len(large) - to_begin < to_begin


def _interleaves(stamps: np.ndarray, senders: np.ndarray, begin: int) -> bool:
    """Whether frames of the same senders before and after `begin` would lie between each other in order of time."""
    shared = np.isin(senders, np.intersect1d(senders[:begin], senders[begin:]))
    second = np.arange(len(stamps)) >= begin
    rows = np.flatnonzero(shared)
    counts = np.bincount(second[rows], minlength=2)
    ordered = second[rows][np.argsort(stamps[rows], kind="stable")]
    changes = np.count_nonzero(ordered[1:] != ordered[:-1])
    return bool(changes >= max(_FEW, _CHANGES_SHARE * counts.min()))
