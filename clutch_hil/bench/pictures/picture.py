"""Picture of a run: torque, its error, pressure, slip, and phase, clutch state and faults over time.

Torque and slip are signed. The demand is a magnitude and is drawn with the sign of the slip. An error is positive where the
magnitude of the torque is too large. The error of the torque is drawn only where there is a demand and the plates slide:
sticking plates transmit the applied torque. The error of the estimate is drawn everywhere.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.bench.clutch_state import STATES
from clutch_hil.bench.direction import SIGNED_TORQUE, find_directions
from clutch_hil.bench.judgement.measures import find_torque as torque_of
from clutch_hil.bench.pictures import palette
from clutch_hil.bench.pictures.sheet import Sheet, draw_zero, plot_errors, set_speed_axis, show_at_least
from protocols.can.request import Request

_HEIGHTS = (2.9, 1.5, 2.0, 1.5)  # inches: torque, error, pressure, slip
_TRUE = "truth_clutch_torque_nm"
# Column, label, width [pt] and style; later entries are drawn on top, and a run may lack some columns
_PRESSURES = (
    ("truth_cylinder_pressure_bar", "true", 2.4, "-"),
    ("cylinder_pressure_bar", "measured", 1.0, "-"),
    ("controller_pressure_demand_bar", "demand", 1.2, "--"),
)
_SLIPS = (
    ("slip_speed_rad_s", "measured", 0.8, "-"),
    ("truth_slip_speed_rad_s", "true", 1.4, "-"),
    ("motor_speed_demand_rad_s", "motor demand", 1.2, "--"),
)
_OPEN, _SLIDING, _STICKING = map(STATES.index, ("open", "sliding", "sticking"))


def draw_run(path: Path, columns: Mapping[str, np.ndarray], title: str, injected: Iterable[float] = ()) -> None:
    """Draw the columns of a run file into a PNG at `path`, with a line at each time [s] of an injection in `injected`."""
    make_run_sheet(columns, title, injected).save(path)


def make_run_sheet(columns: Mapping[str, np.ndarray], title: str, injected: Iterable[float] = ()) -> Sheet:
    """Draw a run; return the sheet, which is not yet saved."""
    sheet = Sheet(columns, title, _HEIGHTS, {"": "controller_"})
    torque, error, pressure, slip = sheet.panels
    _draw_torque(torque, columns)
    _draw_errors(error, columns)
    for column, label, width, style in _PRESSURES:
        _plot(pressure, columns, column, label, width, style)
    show_at_least(pressure, 1.0)
    pressure.set_ylabel("cylinder pressure [bar]")
    for column, label, width, style in _SLIPS:
        _plot(slip, columns, column, label, width, style)
    set_speed_axis(slip, *(columns[column] for column, *_ in _SLIPS if column in columns))
    slip.set_ylabel("slip [rad/s]")
    sheet.mark(injected, "injected", palette.INJECTED)
    return sheet


def _draw_torque(axes: Any, columns: Mapping[str, np.ndarray]) -> None:
    time, demand = columns["time_s"], sign_demand(columns)
    axes.plot(time, columns["controller_torque_estimate_nm"], color=palette.ESTIMATE, lw=1.0, label="estimate")
    name, column = _find_torque_column(columns)
    _plot(axes, columns, column, name, 1.4)
    if np.any(np.nan_to_num(demand) != 0.0):
        axes.plot(time, demand, color=palette.DEMAND, lw=1.2, ls="--", label="demand")
    low, high = axes.get_ylim()
    standing = columns["controller_clutch_state"] >= _STICKING
    if np.any(standing):
        capacity = np.where(standing, columns["controller_capacity_nm"], np.nan)
        axes.fill_between(
            time, -capacity, capacity, color=palette.DEMAND, alpha=0.15, lw=0, label="capacity, plates at rest"
        )
        high = max(high, 1.05 * float(np.nanmax(capacity)))
    axes.set_ylim(low, high)
    show_at_least(axes, 1.0)
    axes.set_ylabel("clutch torque [Nm]")
    if np.any(columns[column] <= -SIGNED_TORQUE):
        draw_zero(axes)


def _draw_errors(axes: Any, columns: Mapping[str, np.ndarray]) -> None:
    name, column = _find_torque_column(columns)
    torque, sign = columns[column], find_slip_direction(columns)
    of_demand = np.where(_is_followed(columns), sign * torque - np.nan_to_num(columns["torque_demand_nm"]), np.nan)
    of_estimate = sign * (columns["controller_torque_estimate_nm"] - torque)
    errors = {
        f"estimate - {name}": (of_estimate, palette.ESTIMATE, 0.6),
        f"{name} - demand": (of_demand, palette.choose_colour(column), 1.3),
    }
    known = {label: one for label, one in errors.items() if np.isfinite(one[0]).any()}
    plot_errors(axes, columns["time_s"], known, columns["controller_clutch_state"] > _OPEN)
    axes.set_ylabel("error [Nm]\n+ is too much")


def _find_torque_column(columns: Mapping[str, np.ndarray]) -> tuple[str, str]:
    """Return label and column of the clutch torque: the true one, or the measured one of a run recorded blind."""
    return ("true", _TRUE) if _TRUE in columns else ("measured", "clutch_torque_nm")


def find_slip_direction(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the direction of slip, +1 or -1, shape (n,); from the truth where the run has it."""
    return find_directions(columns.get("truth_slip_speed_rad_s", columns["slip_speed_rad_s"]), torque_of(columns))


def sign_demand(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the torque demand (n,) [Nm] with the sign of the slip; NaN where a lock or a pressure is demanded."""
    other = np.isin(columns["controller_request"], (Request.LOCK, Request.PRESSURE))
    return np.where(other, np.nan, find_slip_direction(columns) * np.nan_to_num(columns["torque_demand_nm"]))


def _is_followed(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return a mask (n,) of the samples in which a torque is demanded and the plates slide."""
    return (columns["controller_request"] == Request.ENGAGE) & (columns["controller_clutch_state"] == _SLIDING)


def _plot(
    axes: Any, columns: Mapping[str, np.ndarray], column: str, label: str, width: float, style: str = "-"
) -> None:
    if column in columns:
        axes.plot(
            columns["time_s"], columns[column], color=palette.choose_colour(column), lw=width, ls=style, label=label
        )
