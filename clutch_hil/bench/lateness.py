"""Lateness: which cycles of a loop were late, and which of them because the machine did not run.

What counts     a cycle is late that ends after its slot, or before which a slot was left out. A witness is a loop on the same
                CPU that does nothing, above in priority: from its slot until it sleeps again is the machine's time, a spike
                where that is long (`spike`). A late cycle is explained by a spike, or a stall that a watch has seen, from two
                periods before its slot to two after its end
Assumptions     what stops the CPU stops the witness, too; what slows it (caches, a neighbour on its core) is nobody's spike
References      docs/timing.md
"""

import numpy as np

_SPIKE_SHARE = 0.1  # of a period: time that the loop can do without
# ns: ordinary wake-ups of a virtual machine are late by up to this, and would explain every late cycle
_LEAST_SPIKE = 100_000
_NEAR_PERIODS = 2  # periods around a late cycle


def late_cycles(slots: np.ndarray, counted: np.ndarray, period_ns: int) -> np.ndarray:
    """Which cycles (k,) were late, of those in `slots` (n,) [ns], before which `counted` (n,) had ended after their slot.

    A cycle that begins late is not late, unless a slot is left out.
    """
    return np.union1d(np.flatnonzero(np.diff(slots) > 1.5 * period_ns), np.flatnonzero(np.diff(counted) > 0))


def spike(period_ns: int) -> float:
    """How long time lost to the machine is that explains something [ns]."""
    return max(_SPIKE_SHARE * period_ns, _LEAST_SPIKE)


def spikes(slots: np.ndarray, ended: np.ndarray, period_ns: int) -> np.ndarray:
    """Begin and end (k, 2) of the spikes of a witness that slept again at `ended` (n,) after slots (n,); all ns.

    A spike lasts from the slot until the witness slept again, or from the first slot that it was not woken for to the next.
    """
    late = (ended - slots) > spike(period_ns)
    gaps = np.flatnonzero(np.diff(slots) > 1.5 * period_ns)
    begins = np.concatenate([slots[late], slots[gaps] + period_ns])
    return np.column_stack([begins, np.concatenate([ended[late], slots[gaps + 1]])])


def mark_explained(cycles: np.ndarray, lost: np.ndarray, period_ns: int) -> np.ndarray:
    """Whether cycles, slot and end (k, 2), have time `lost` to the machine, begin and end (n, 2), near; all ns."""
    lost = lost[np.argsort(lost[:, 0])]
    ends = np.append(-np.inf, np.maximum.accumulate(lost[:, 1]))
    before = np.searchsorted(
        lost[:, 0], cycles[:, 1] + (_NEAR_PERIODS + 0.5) * period_ns, side="right"
    )  # of those that had begun
    return ends[before] >= cycles[:, 0] - (_NEAR_PERIODS + 0.5) * period_ns
