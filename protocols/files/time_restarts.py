"""Time restarts: whether the times of a log begin anew, because two recordings are in one file.

Rule            Times rise, go back to where they began, and rise again over the same range; frames of one identifier of one bus
                would come to lie between each other. Blocks that are merely in another order fill each other's gaps, or have
                frames of other identifiers
"""

import numpy as np

_NEAR = 0.25  # of the range of times before: chosen, a bus may be silent at the beginning or the end
_LARGE = 0.5  # of this range: steps back that count
_FALLING_SHARE = 0.1  # of the steps of times that rise: a few frames are late in every log
_FEW = 10  # frames, and changes between the two recordings, of which nothing can be said
_CHANGES_SHARE = 0.05  # of the frames: those of a cycle come together
_MOST_CHECKED = 8  # steps back, the first ones


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
