"""Lateness: find which cycles of a loop were late, and which of these because the machine gave it no CPU time.

Definitions     a cycle is late if it ends after its slot, or if a slot before it was skipped. A witness is an empty loop on
                the same CPU with a higher priority. The time from its slot until it sleeps again is lost to the machine. A
                long lost time is a spike (`compute_shortest_spike`). A late cycle is explained by a spike, or by a stall that
                a stall watch found, between 2.5 periods before its slot and 2.5 after its end
Assumptions     what stops the CPU also stops the witness. What only slows the CPU (caches, a neighbour on its core) makes no
                spike
References      docs/timing.md
"""

import numpy as np

_SPIKE_SHARE = 0.1  # of a period: the loop can lose this time and still be punctual
# ns: ordinary wake-ups of a virtual machine are late by up to this; a lower limit would explain every late cycle
_LEAST_SPIKE = 100_000
_NEAR_PERIODS = 2  # before the slot of a late cycle and after its end, in which a spike explains it


def find_late_cycles(slots: np.ndarray, counted: np.ndarray, period_ns: int) -> np.ndarray:
    """Return the indices (k,) of the late cycles.

    slots: of the cycles (n,) [ns]. counted: number of earlier cycles that ended after their slot, at each cycle (n,).
    period_ns: [ns]. A cycle that begins late is not late, unless a slot was skipped.
    """
    return np.union1d(np.flatnonzero(np.diff(slots) > 1.5 * period_ns), np.flatnonzero(np.diff(counted) > 0))


def compute_shortest_spike(period_ns: int) -> float:
    """Return the shortest time lost to the machine that counts as a spike [ns]."""
    return max(_SPIKE_SHARE * period_ns, _LEAST_SPIKE)


def find_spikes(slots: np.ndarray, ended: np.ndarray, period_ns: int) -> np.ndarray:
    """Return begin and end (k, 2) of the spikes of a witness that slept again at `ended` (n,) after its `slots` (n,), in ns.

    A spike lasts from a slot until the witness slept again, or from the first missed slot to the next slot in which it ran.
    """
    late = (ended - slots) > compute_shortest_spike(period_ns)
    gaps = np.flatnonzero(np.diff(slots) > 1.5 * period_ns)
    begins = np.concatenate([slots[late], slots[gaps] + period_ns])
    return np.column_stack([begins, np.concatenate([ended[late], slots[gaps + 1]])])


def mark_explained(cycles: np.ndarray, lost: np.ndarray, period_ns: int) -> np.ndarray:
    """Return a mask (k,) of the explained cycles: those with time `lost` to the machine nearby.

    cycles: slot and end of each (k, 2). lost: begin and end of each spike and stall (n, 2). All in ns.
    """
    lost = lost[np.argsort(lost[:, 0])]
    ends = np.append(-np.inf, np.maximum.accumulate(lost[:, 1]))
    before = np.searchsorted(
        lost[:, 0], cycles[:, 1] + (_NEAR_PERIODS + 0.5) * period_ns, side="right"
    )  # of the lost times that had begun
    return ends[before] >= cycles[:, 0] - (_NEAR_PERIODS + 0.5) * period_ns
