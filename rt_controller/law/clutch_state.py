"""State of the plates as the controller believes it: open, sliding, sticking, locked.

Assumptions     plates that do not touch are open, whatever moves (motion.py)
References      ours; locked: "totally closed", Janssens 2010, sec. 6.2.1
"""

from enum import IntEnum

from numba import njit


class ClutchState(IntEnum):
    """What the plates do."""

    OPEN = 0
    SLIDING = 1
    STICKING = 2
    LOCKED = 3  # sticking, and held so on request


@njit
def clutch_state(contact, moves, lock):
    """The ClutchState, from whether the plates touch, move, and are to be locked."""
    if not contact:
        return ClutchState.OPEN.value
    if moves:
        return ClutchState.SLIDING.value
    return ClutchState.LOCKED.value if lock else ClutchState.STICKING.value
