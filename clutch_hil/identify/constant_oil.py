"""Constant oil: what is held of a clutch whose oil temperature nobody measured, so that an import map gave one constant.

Equation        T = constant and r_T = 1: no heat, no exchange with the sump, and the friction of the constant temperature
                                                                                                     docs/rig.md, 6 and 7
"""

from clutch_hil.identify.run_evidence import Evidenced

_COLUMN = "oil_temperature_degc"
_NO_CHANGE = {"oil.viscous_gain": 0.0, "oil.heat_transfer": 0.0, "oil.heat_capacity": 1e5}  # J/K: 10 kJ are 0.1 K


def hold_constant_oil(runs: Evidenced) -> dict[str, tuple[float, str]]:
    """Parameters of the oil with the value that they are held at, and why; none where the temperature was measured."""
    if (celsius := runs.find_constant(_COLUMN)) is None:
        return {}
    why = f"{_COLUMN} is a constant of the import map: the oil keeps its temperature"
    return {name: (value, why) for name, value in {**_NO_CHANGE, "oil.sump_temperature": celsius}.items()}
