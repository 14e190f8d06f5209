"""State of the plates as the controller estimates it: open, sliding, sticking, locked.

Assumptions     plates without contact are open, also while they turn (motion.py)
References      developed here; locked: "totally closed", Janssens 2010, sec. 6.2.1
"""

from enum import IntEnum

from numba import njit


class ClutchState(IntEnum):
    """States of the plates."""

    OPEN = 0
    SLIDING = 1
    STICKING = 2
    LOCKED = 3  # sticking on request


@njit
def find_clutch_state(contact, moves, lock):
    """Return the ClutchState of plates that touch (`contact`), slide (`moves`), or are to be locked (`lock`)."""
    if not contact:
        return ClutchState.OPEN.value
    if moves:
        return ClutchState.SLIDING.value
    return ClutchState.LOCKED.value if lock else ClutchState.STICKING.value
