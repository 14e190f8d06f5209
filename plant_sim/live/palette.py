"""Palette: one meaning, one colour, in every plot, curve and lane; chosen for rerun's dark background."""

DEMAND = 0xC8C8C8FF  # light grey: what is asked for
TRUE = 0x3D9BF5FF  # blue: what the plant knows; the pictures of `bench/picture.py` use blue and orange too
ESTIMATE = 0xFFB56BFF  # orange: what the controller believes
MEASURED = 0x6FCF97FF  # green: what a sensor says
SECOND = 0xC792EAFF  # violet: a second true quantity in one plot
COMMAND = 0xF2D64BFF  # yellow: what is sent to an actuator
LIMIT = 0xEF5350FF  # red: a limit
GRID = 0x4A4F57FF  # dim: axes and grids
TEXT = 0xB4BAC3FF  # axis labels

CYCLE = (0x3D9BF5FF, 0xFFB56BFF, 0x6FCF97FF, 0xC792EAFF, 0xF2D64BFF, 0xEF7FA8FF, 0x5AD1D6FF, 0xC8C8C8FF)  # no meaning
