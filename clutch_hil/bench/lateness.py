"""Lateness: which cycles of a loop were late, and which of these because the machine ran nothing.

What counts     a cycle is late if it ends after its slot, or if a slot before it was left out. A witness is a loop on the same
                CPU that does nothing and has a higher priority. The time from its slot until it sleeps again is lost to the
                machine. If it is long it is a spike (`compute_shortest_spike`). A late cycle is explained by a spike, or by
                a stall that a watch found, between two periods before its slot and two after its end
Assumptions     what stops the CPU also stops the witness. What only slows the CPU (caches, a neighbour on its core) makes no
                spike
References      docs/timing.md
"""

import numpy as np

_SPIKE_SHARE = 0.1  # of a period: the loop can lose this time and still be punctual
# ns: ordinary wake-ups of a virtual machine are late by up to this, and would explain every late cycle
_LEAST_SPIKE = 100_000
_NEAR_PERIODS = 2  # before the slot of a late cycle and after its end, in which a spike explains it


def find_late_cycles(slots: np.ndarray, counted: np.ndarray, period_ns: int) -> np.ndarray:
    """Indices (k,) of the late cycles.

    slots: of the cycles (n,) [ns]. counted: how many cycles before each had ended after their slot (n,). period_ns: [ns].
    A cycle that begins late is not late, unless a slot was left out.
    """
    return np.union1d(np.flatnonzero(np.diff(slots) > 1.5 * period_ns), np.flatnonzero(np.diff(counted) > 0))


def compute_shortest_spike(period_ns: int) -> float:
    """Shortest time lost to the machine that counts as a spike [ns]."""
    return max(_SPIKE_SHARE * period_ns, _LEAST_SPIKE)


def find_spikes(slots: np.ndarray, ended: np.ndarray, period_ns: int) -> np.ndarray:
    """Begin and end (k, 2) of the spikes of a witness that slept again at `ended` (n,) after its `slots` (n,); all in ns.

    A spike lasts from a slot until the witness slept again, or from the first slot that it missed to the next one it ran in.
    """
    late = (ended - slots) > compute_shortest_spike(period_ns)
    gaps = np.flatnonzero(np.diff(slots) > 1.5 * period_ns)
    begins = np.concatenate([slots[late], slots[gaps] + period_ns])
    return np.column_stack([begins, np.concatenate([ended[late], slots[gaps + 1]])])


def mark_explained(cycles: np.ndarray, lost: np.ndarray, period_ns: int) -> np.ndarray:
    """Mask (k,) of the cycles that are explained: time `lost` to the machine is near.

    cycles: slot and end of each (k, 2). lost: begin and end of each spike and stall (n, 2). All in ns.
    """
    lost = lost[np.argsort(lost[:, 0])]
    ends = np.append(-np.inf, np.maximum.accumulate(lost[:, 1]))
    before = np.searchsorted(
        lost[:, 0], cycles[:, 1] + (_NEAR_PERIODS + 0.5) * period_ns, side="right"
    )  # of those that had begun
    return ends[before] >= cycles[:, 0] - (_NEAR_PERIODS + 0.5) * period_ns
