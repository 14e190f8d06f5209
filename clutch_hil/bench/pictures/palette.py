"""Palette: all colours of pictures, viewer and terminal. One meaning has the same colour everywhere.

A colour must be readable on white paper and on a dark screen: its contrast is at least 3 on both (test_palette.py). A column
of a run has the colour of its meaning (`choose_colour`), and every state has its own colour (`STATES`).
"""

DEMAND = "#737373"  # grey: demands
TRUE = "#2a86e0"  # blue: the truth, and the plant itself
ESTIMATE = "#e0731a"  # orange: estimates of the controller, and the controller itself
MEASURED = "#1f9d62"  # green: sensor values
COMMAND = "#a58a00"  # gold: commands to an actuator
LIMIT = "#e0413f"  # red: limits and errors

# Colours without a meaning, for further lines of a plot
CYCLE = ("#a566d6", "#149aa8", "#dc5a9a", "#7d9a1a", "#a9784f", "#7a78e0")
SECOND, CLUTCH_A, CLUTCH_B, INJECTED = CYCLE[0], CYCLE[1], CYCLE[2], CYCLE[5]

_LINES = {
    "torque_demand_nm": DEMAND, "controller_torque_demand_nm": DEMAND,
    "controller_torque_estimate_nm": ESTIMATE, "controller_observed_torque_nm": ESTIMATE,
    "clutch_torque_nm": MEASURED, "truth_clutch_torque_nm": TRUE, "truth_motor_torque_nm": TRUE,
    "controller_pressure_demand_bar": DEMAND, "controller_pressure_bar": ESTIMATE,
    "cylinder_pressure_bar": MEASURED, "truth_cylinder_pressure_bar": TRUE, "truth_valve_pressure_bar": SECOND,
    "controller_voltage_v": DEMAND, "valve_voltage_v": COMMAND,
    "motor_speed_demand_rad_s": DEMAND, "controller_slip_rad_s": ESTIMATE,
    "slip_speed_rad_s": MEASURED, "truth_slip_speed_rad_s": TRUE,
    "controller_temperature_degc": ESTIMATE, "oil_temperature_degc": MEASURED, "truth_oil_temperature_degc": TRUE,
    "controller_friction_level": ESTIMATE, "controller_wake_us": ESTIMATE, "plant_wake_us": TRUE,
}  # fmt: skip

# Colours of states of controller, clutch and services. Darker, because white text is written on them
_REST, _BUSY, _MOVING, _STANDING, _HELD, _LEAVING = "#607d8b", "#b26a00", "#2e7d32", "#00838f", "#3949ab", "#8e44ad"
_BAD = "#d32f2f"
STATES = {
    "idle": _REST, "open": _REST, "none": _REST, "no": _REST, "absent": _REST, "unconfigured": _REST, "inactive": _REST,
    "fill": _BUSY, "integrator held": _BUSY, "waiting": _BUSY,
    "slip control": _MOVING, "sliding": _MOVING, "in contact": _MOVING, "learning": _MOVING,
    "engage": _MOVING, "pressure": _MOVING, "active": _MOVING, "running": _MOVING,
    "sticking": _STANDING,
    "lock": _HELD, "locked": _HELD,
    "release": _LEAVING,
}  # fmt: skip

NOTICE, WRONG = f"bold {_BUSY}", f"bold {LIMIT}"  # styles of text in a terminal: notices and errors
DIM = "bright_black"  # of text in a terminal: the grey of the user's own theme
INK, PAPER, SHADE = "#222222", "#ffffff", "#f0e6d2"  # text and axes on white, the white, a shaded time span
GRID, TEXT = "#4a4f57", "#b4bac3"  # axes and their labels on the viewer's dark background

# Drawing of a clutch: its materials; oil and plates without load and at full load
HOUSING, DRUM, STEEL, SHAFT_STRIPE, SPRING, PLATE_STRIPE = (
    "#6b7683", "#58626e", "#a9b4c0", "#5c6672", "#d9dee4", "#8c8c8c",
)  # fmt: skip
COLD_OIL, PRESSED_OIL = "#263242", "#409cff"
COLD_PLATE, LOADED_PLATE = "#786048", "#ff8c28"


def choose_colour(column: str, number: int = 0) -> str:
    """Return the colour of a column. A column without its own colour gets the one with this `number` in CYCLE."""
    return _LINES.get(column, CYCLE[number % len(CYCLE)])


def choose_clutch_colour(colour: str, clutch: str) -> str:
    """Return the colour for clutch a or b of a line with this `colour` on a single clutch: truth and estimate of b differ."""
    return {TRUE: CLUTCH_B, ESTIMATE: SECOND}.get(colour, colour) if clutch == "b" else colour


def choose_state_colour(word: str) -> str:
    """Return the colour of a phase, a state or a flag. Any other word is a fault and is red."""
    return STATES.get(word, _BAD)


def choose_badge(word: str | None) -> str:
    """Return the style of such a word in a terminal; empty for None, "" and "-"."""
    return "" if word in (None, "", "-") else f"{PAPER} on {choose_state_colour(str(word))}"


def split_colour(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue of a colour, 0 to 255."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def make_rgba(colour: str) -> int:
    """Return a colour in the format of rerun, 0xRRGGBBAA."""
    return int(colour[1:], 16) << 8 | 0xFF
