"""Dashboard: the plot of each column. Each column of a node is in exactly one plot, so a recording stores it once."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from clutch_hil.bench.pictures import palette
from protocols.can.two_clutches import CLUTCHES, CONTROLLERS
from protocols.node import Column


class Line(NamedTuple):
    """A column as a line: its label in the legend, and its width [ui points]."""

    column: str
    label: str
    width: float = 1.5


class Plot(NamedTuple):
    """A plot over time: entity path under the prefix, title, and lines. It also shows all other columns of its `units`."""

    path: str
    title: str
    lines: tuple[Line, ...] = ()
    units: tuple[str, ...] = ()


# rerun draws the entities of a plot in alphabetical order, so lines of the plant are on top of those of the controller. The
# plot of the torque also has the demand, with the sign of the slip (torque.py). The balance has the demand as a magnitude.
PLOTS = (
    Plot("torque", "torque [Nm]", (
        Line("controller_torque_estimate_nm", "estimate", 1.2),
        Line("truth_clutch_torque_nm", "true", 2.5),
    )),
    Plot("pressure", "pressure [bar]", (
        Line("controller_pressure_demand_bar", "demand", 2.0),
        Line("truth_valve_pressure_bar", "valve", 1.5),
        Line("truth_cylinder_pressure_bar", "true", 2.0),
        Line("cylinder_pressure_bar", "measured", 1.0),
    )),
    Plot("voltage", "valve command [V]", (
        Line("controller_voltage_v", "requested by the law", 2.5),
        Line("valve_voltage_v", "at the valve", 1.2),
    )),
    Plot("slip", "slip [rad/s]", (
        Line("controller_slip_rad_s", "observed", 1.5),
        Line("motor_speed_demand_rad_s", "motor demand", 1.5),
        Line("slip_speed_rad_s", "measured", 1.0),
        Line("truth_slip_speed_rad_s", "true", 1.5),
    )),
    Plot("temperature", "oil temperature [degC]", (
        Line("controller_temperature_degc", "as used by the law", 1.0),
        Line("oil_temperature_degc", "measured", 1.0),
        Line("truth_oil_temperature_degc", "true", 2.0),
    )),
    Plot("timing", "loop timing [us]", (
        Line("controller_wake_us", "controller wake-up lateness", 1.0),
        Line("controller_work_us", "controller work", 1.0),
        Line("plant_wake_us", "plant wake-up lateness", 1.0),
        Line("plant_work_us", "plant work", 1.0),
    )),
    Plot("terms", "feedback terms [bar]", (
        Line("controller_proportional_bar", "torque P", 1.0),
        Line("controller_integral_bar", "torque I", 2.0),
        Line("controller_pressure_proportional_bar", "pressure P", 1.0),
        Line("controller_pressure_integral_bar", "pressure I", 2.0),
    )),
    Plot("feedforward", "feedforward and pressure [bar]", (
        Line("controller_feedforward_bar", "feedforward", 2.0),
        Line("controller_pressure_bar", "measured, as used by the law", 1.0),
    )),
    Plot("balance", "torque balance [Nm]", (
        Line("controller_torque_demand_nm", "demand, a magnitude", 1.5),
        Line("controller_capacity_nm", "capacity", 1.5),
        Line("controller_observed_torque_nm", "observed at the motor", 1.0),
        Line("controller_coulomb_part_nm", "Coulomb part", 2.0),
        Line("controller_viscous_part_nm", "viscous part", 2.0),
        Line("clutch_torque_nm", "clutch, measured", 1.0),
        Line("motor_torque_nm", "motor, measured", 1.0),
        Line("truth_motor_torque_nm", "motor, true", 1.5),
    )),
    Plot("adaptation", "adaptation [1]", (
        Line("controller_friction_level", "friction level", 2.0),
        Line("controller_trimmed_level", "momentary level", 1.0),
        Line("controller_viscous_correction", "viscous correction", 1.5),
    )),
    Plot("more/position", "piston position [m]", units=("m",)),
    Plot("more/force", "forces [N]", units=("N",)),
    Plot("more/angle", "shaft angle [rad]", units=("rad",)),
    Plot("more/acceleration", "observed slip acceleration [rad/s^2]", units=("rad/s^2",)),
    Plot("more/clock", "clocks [s] and sample tick [1]", (
        Line("controller_sample_tick", "controller sample tick"),
    ), ("s",)),
)  # fmt: skip
LIGHT = ("torque", "pressure", "voltage", "slip", "timing")  # paths of the plots on a light screen
(SLIP,) = (plot for plot in PLOTS if plot.path == "slip")
REST = Plot("more/rest", "states, flags and counts [1], and all other columns")


class Place(NamedTuple):
    """An entity with several columns of a node. `numbers` are their indices among the columns of the node."""

    path: str
    numbers: tuple[int, ...]
    columns: tuple[Column, ...]
    lines: tuple[Line, ...]
    colours: tuple[str, ...]

    @property
    def labels(self) -> list[str]:
        """Return the labels of the lines with units, for the legend."""
        return [f"{line.label} [{column.unit}]" for line, column in zip(self.lines, self.columns, strict=True)]


def list_places(node: str, columns: Sequence[Column]) -> list[Place]:
    """Return the entities of a node's columns; every column is in exactly one of them.

    Columns of two clutches are both in the plot of the single clutch's column, with the name of the clutch in their labels.
    """
    free = {column.name: number for number, column in enumerate(columns)}
    of_clutches: dict[
        str, list[tuple[str, str]]
    ] = {}  # by the column of a single clutch: the name here, and the clutch
    for column in columns:
        single, clutch = split_clutch_name(column)
        if clutch:
            of_clutches.setdefault(single, []).append((column.name, clutch))
    chosen: dict[Plot, list[tuple[int, Line, str]]] = {}
    for plot in PLOTS:
        lines = [line for single in plot.lines for line in (single, *_make_lines_of_two(single, of_clutches))]
        coloured = [(line, palette.choose_colour(line.column, place)) for place, line in enumerate(lines)]
        chosen[plot] = [(free.pop(line.column), line, colour) for line, colour in coloured if line.column in free]
    by_unit = {unit: plot for plot in PLOTS for unit in plot.units}
    for name, number in free.items():
        unit = columns[number].unit
        own = chosen.setdefault(by_unit.get(unit, REST), [])
        label = name.removesuffix(_make_suffix(unit)).replace("_", " ")
        own.append((number, Line(name, label), palette.choose_colour(name, len(own))))
    return [
        Place(
            f"{plot.path}/{node}",
            tuple(number for number, *_ in own),
            tuple(columns[number] for number, *_ in own),
            tuple(line for _, line, _ in own),
            tuple(colour for *_, colour in own),
        )
        for plot, own in chosen.items()
        if own
    ]


def split_clutch_name(column: Column) -> tuple[str, str]:
    """Return the name of a column on a rig with one clutch, and its clutch: a or b, or "" on a rig with one clutch.

    `cylinder_pressure_b_bar` is `cylinder_pressure_bar` of b, `controller_b_voltage_v` is `controller_voltage_v` of b.
    """
    first, second = (f"{node}_" for node in CONTROLLERS)
    if column.name.startswith(second):
        return first + column.name.removeprefix(second), CLUTCHES[1]
    suffix = _make_suffix(column.unit)
    for clutch in CLUTCHES:
        if column.name.endswith(end := f"_{clutch}{suffix}"):
            return column.name.removesuffix(end) + suffix, clutch
    return column.name, ""


def _make_lines_of_two(line: Line, of_clutches: Mapping[str, Sequence[tuple[str, str]]]) -> list[Line]:
    """Return the lines of two clutches that replace the line of a single clutch."""
    return [Line(name, f"{line.label} {clutch}", line.width) for name, clutch in of_clutches.get(line.column, ())]


def _make_suffix(unit: str) -> str:
    """Return the suffix of the name of a column with this unit."""
    return "" if unit == "1" else f"_{unit.lower().replace('/', '_').replace('^', '')}"
