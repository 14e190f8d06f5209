"""State of the clutch in one word: open, sliding, sticking or locked (docs/states.md)."""

STATES = ("open", "sliding", "sticking", "locked")  # by value of the controller's column `clutch_state`
COLUMN = "controller_clutch_state"
_CLOSED = ("slip control", "lock")  # phases in which the plates touch


def find_clutch_state(phase: str, sticking: bool) -> str:
    """Return the state of the clutch from the `phase` in CONTROLLER_STATUS and from whether its plates stick."""
    if phase not in _CLOSED:
        return "open"
    if not sticking:
        return "sliding"
    return "locked" if phase == "lock" else "sticking"
