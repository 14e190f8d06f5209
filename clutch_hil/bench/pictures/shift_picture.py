"""Picture of a hand-over: speeds, torques, output torque, pressures; phase, clutch state and faults of both clutches.

The time of the hand-over is shaded. A colour stands for a clutch, or for the driveline. Thick lines are true values, thin
lines estimated or measured, dashed lines demands.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from clutch_hil.bench.direction import SIGNED_TORQUE, find_directions
from clutch_hil.bench.judgement.power_shift_measures import find_handover
from clutch_hil.bench.pictures import palette
from clutch_hil.bench.pictures.sheet import Sheet, draw_zero
from protocols.can.request import Request

_HEIGHTS = (2.0, 2.7, 1.6, 1.8)  # inches: speed, torque, output torque, pressure
_CLUTCHES = (("a", "controller_", palette.CLUTCH_A, "1st"), ("b", "controller_b_", palette.CLUTCH_B, "2nd"))


def draw_shift(path: Path, columns: Mapping[str, np.ndarray], title: str) -> None:
    """Draw the columns of a run of the power-shift rig into a PNG at `path`."""
    make_shift_sheet(columns, title).save(path)


def make_shift_sheet(columns: Mapping[str, np.ndarray], title: str, injected: Iterable[float] = ()) -> Sheet:
    """Draw a run with a line at each time [s] in `injected`; return the sheet, which is not yet saved."""
    sheet = Sheet(columns, title, _HEIGHTS, {name: prefix for name, prefix, *_ in _CLUTCHES})
    time = sheet.time
    speed, torque, output, pressure = sheet.panels
    dashed = {"color": palette.DEMAND, "lw": 1.0, "ls": "--"}
    driveline = {"color": palette.TRUE, "lw": 1.4}

    speed.plot(time, columns["truth_input_speed_rad_s"], label="input", **driveline)
    for name, prefix, colour, gear in _CLUTCHES:
        gear_speed = columns["truth_input_speed_rad_s"] - columns[f"truth_slip_speed_{name}_rad_s"]
        speed.plot(time, gear_speed, color=colour, lw=1.2, label=f"output x ratio of {name} ({gear} gear)")
        estimate = columns[f"{prefix}torque_estimate_nm"]
        torque.plot(time, estimate, color=colour, lw=0.7, alpha=0.5, label=f"{name}, estimate")
        torque.plot(time, columns[f"truth_clutch_torque_{name}_nm"], color=colour, lw=1.5, label=f"{name}, true")
        pressure.plot(time, columns[f"cylinder_pressure_{name}_bar"], color=colour, lw=1.0, label=f"{name}, measured")
        last = name == _CLUTCHES[-1][0]
        torque.plot(time, sign_demand(columns, name, prefix), label="demands" if last else None, **dashed)
        pressure.plot(time, columns[f"{prefix}pressure_demand_bar"], label="demands" if last else None, **dashed)
    speed.plot(time, columns["input_speed_demand_rad_s"], label="input, demand", **dashed)
    speed.set_ylabel("speed [rad/s]")
    torque.set_ylabel("clutch torque [Nm]")
    if any(np.any(columns[f"truth_clutch_torque_{name}_nm"] <= -SIGNED_TORQUE) for name, *_ in _CLUTCHES):
        draw_zero(torque)
    torque.margins(y=0.12)  # room for a word
    output.plot(time, columns["truth_output_torque_nm"], label="output", **driveline)
    output.plot(time, columns["truth_road_torque_nm"], color=palette.SECOND, lw=1.0, ls=":", label="road")
    output.set_ylabel("output torque [Nm]")
    pressure.set_ylabel("cylinder pressure [bar]")

    shift = find_handover(columns)
    if shift:
        output.axhline(shift.before, color=palette.INK, lw=0.8, ls="--", label="output before")
        end = shift.shift_end if shift.shift_end is not None else shift.window.stop - 1
        for axes in sheet.panels:
            axes.axvspan(time[shift.begin], time[shift.torque_end], color=palette.SHADE, lw=0)
            axes.axvspan(time[shift.torque_end], time[end], color=palette.SHADE, lw=0, alpha=0.5)
        torque.annotate(
            "torque phase", (time[shift.begin], 0.98), xycoords=("data", "axes fraction"), fontsize=8, va="top"
        )
    sheet.mark(injected, "injected", palette.INJECTED)
    return sheet


def sign_demand(columns: Mapping[str, np.ndarray], clutch: str, prefix: str) -> np.ndarray:
    """Return the torque demand of a clutch (n,) [Nm] with the sign of its slip; NaN where a lock or a pressure is demanded."""
    way = find_directions(columns[f"truth_slip_speed_{clutch}_rad_s"], columns[f"truth_clutch_torque_{clutch}_nm"])
    other = np.isin(columns[f"{prefix}request"], (Request.LOCK, Request.PRESSURE))
    return np.where(other, np.nan, way * np.nan_to_num(columns[f"torque_demand_{clutch}_nm"]))
