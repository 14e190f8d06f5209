"""Palette: one meaning, one colour, in every picture, on the viewer's screen and in a terminal; no colour stands elsewhere.

A colour is as bright as is read on white paper and on a dark screen alike: contrast 3 at least on both (test_palette.py).
So it is the same everywhere. A column of a run has its colour here, by what its line tells (`of`), a state its own (`STATES`).
"""

DEMAND = "#737373"  # grey: what is asked for
TRUE = "#2a86e0"  # blue: what the plant knows, and the plant itself
ESTIMATE = "#e0731a"  # orange: what the controller believes, and the controller itself
MEASURED = "#1f9d62"  # green: what a sensor says
COMMAND = "#a58a00"  # gold: what is sent to an actuator
LIMIT = "#e0413f"  # red: a limit, and what is wrong

# Without a meaning of their own: they tell lines of one plot apart
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

# What is so for a while, as words: of the controller, of the clutch, of a service. Darker, as white text stands on it
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

NOTICE, WRONG = f"bold {_BUSY}", f"bold {LIMIT}"  # of text in a terminal: what to look at, what is wrong
DIM = "bright_black"  # of text in a terminal: as its owner has it
INK, PAPER, SHADE = "#222222", "#ffffff", "#f0e6d2"  # text and axes on white, the white, a stretch of time on it
GRID, TEXT = "#4a4f57", "#b4bac3"  # axes and their labels on the viewer's dark ground

# Of the drawing of a clutch: what things are made of, and oil and plates at rest and fully loaded
HOUSING, DRUM, STEEL, SHAFT_STRIPE, SPRING, PLATE_STRIPE = (
    "#6b7683", "#58626e", "#a9b4c0", "#5c6672", "#d9dee4", "#8c8c8c",
)  # fmt: skip
COLD_OIL, PRESSED_OIL = "#263242", "#409cff"
COLD_PLATE, LOADED_PLATE = "#786048", "#ff8c28"


def of(column: str, number: int = 0) -> str:
    """Colour of a column; one without a meaning takes the `number`-th of those that have none."""
    return _LINES.get(column, CYCLE[number % len(CYCLE)])


def of_state(word: str) -> str:
    """Colour of a phase, of a state of clutch or service, of a flag; a word that is not known tells what is wrong."""
    return STATES.get(word, _BAD)


def badge(word: str | None) -> str:
    """Style of such a word in a terminal; of none, None or "-", none."""
    return "" if word in (None, "", "-") else f"{PAPER} on {of_state(str(word))}"


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of a colour, 0 to 255."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def rgba(colour: str) -> int:
    """A colour as rerun has it, 0xRRGGBBAA."""
    return int(colour[1:], 16) << 8 | 0xFF
