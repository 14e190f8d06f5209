"""Likely unit: the unit that a column was recorded in, by the factor that it is off by."""

from math import log

from clutch_hil.recordings.checks.knowledge import BASELINE, Knowledge, Recorded

_ALIKE = 1.6  # factor within which a scale is that of a unit: half a step between the nearest ones
# Units that a column may be in by mistake -> how many of them make one of the run's unit; K and degF have another zero
_OTHERS = {
    "m": {"mm": 1e3, "um": 1e6, "cm": 1e2, "inch": 39.37, "km": 1e-3},
    "N": {"kN": 1e-3, "mN": 1e3, "uN": 1e6, "kgf": 0.102},
    "Nm": {"kNm": 1e-3, "mNm": 1e3, "Ncm": 1e2, "kgf cm": 10.2},
    "bar": {"Pa": 1e5, "kPa": 1e2, "MPa": 0.1, "psi": 14.5, "mbar": 1e3},
    "rad/s": {"rpm": 9.549, "deg/s": 57.3, "Hz": 0.159, "krpm": 9.549e-3},
    "rad": {"deg": 57.3, "revolutions": 0.159, "mrad": 1e3},
    "V": {"mV": 1e3, "kV": 1e-3},
    "m/s": {"mm/s": 1e3, "km/h": 3.6},
}  # fmt: skip


def name_unit(run: Recorded, known: Knowledge, scale: float) -> str:
    """What to check, in words, where a column is `scale` of what it should be: likely units of it, or of an input."""
    sources = run.inputs if known.source == BASELINE else (known.source,)
    of_inputs = [
        f"{c} in {unit}" for c in sources if c in run.known for unit in _list_units(run.known[c].unit, 1.0 / scale)
    ]
    asked = " or ".join([*_list_units(known.unit, scale)[:2], *of_inputs[:2]])
    asked = f"{asked}? set its unit in the import map" if asked else "check its unit and gain, and those of the inputs"
    return f"{asked}, or give the model of your rig{run.of_unknown_rig}"


def name_own_unit(known: Knowledge, scale: float) -> str:
    """What to check, in words, where only the unit of the column itself may be wrong."""
    asked = " or ".join(_list_units(known.unit, scale)[:2])
    return f"{asked}? set its unit in the import map" if asked else "check its unit in the import map"


def _list_units(unit: str, scale: float) -> list[str]:
    return [name for name, count in _OTHERS.get(unit, {}).items() if abs(log(count / scale)) < log(_ALIKE)]
