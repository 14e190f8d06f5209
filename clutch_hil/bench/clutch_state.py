"""State of the clutch in a word, for people: open, sliding, sticking, locked."""

STATES = ("open", "sliding", "sticking", "locked")  # by value of the controller's column `clutch_state`
COLUMN = "controller_clutch_state"
_CLOSED = ("slip control", "lock")  # phases


def clutch_state(phase: str, sticking: bool) -> str:
    """The state by CONTROLLER_STATUS: its phase and whether the plates touch and stand."""
    if phase not in _CLOSED:
        return "open"
    if not sticking:
        return "sliding"
    return "locked" if phase == "lock" else "sticking"
