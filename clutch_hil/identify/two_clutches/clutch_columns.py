"""Columns of one clutch in runs of the power-shift rig, with their names on the wet-clutch rig."""

from collections.abc import Mapping
from typing import TypeVar

T = TypeVar("T")

COLUMNS = {  # name on the wet-clutch rig: name on the power-shift rig, for clutch {}
    "valve_voltage_v": "valve_voltage_{}_v",
    "cylinder_pressure_bar": "cylinder_pressure_{}_bar",
    "shaft_angle_rad": "slip_angle_{}_rad",
    "oil_temperature_degc": "oil_temperature_{}_degc",
    "clutch_torque_nm": "clutch_torque_{}_nm",
    "slip_speed_rad_s": "slip_speed_{}_rad_s",
}


def name_column(name: str, clutch: str) -> str:
    """Return the name on the power-shift rig of a column of `clutch`, a or b, from its name on the wet-clutch rig."""
    return COLUMNS[name].format(clutch)


def select_clutch_columns(run: Mapping[str, T], clutch: str) -> dict[str, T]:
    """Return time_s and the columns of `clutch`, a or b, with their names on the wet-clutch rig; those that the run has.

    run: columns, or anything else by the names of columns, such as their units.
    """
    names = {"time_s": "time_s", **{name: name_column(name, clutch) for name in COLUMNS}}
    return {name: run[own] for name, own in names.items() if own in run}
