"""Picture of a hand-over: speeds, torques with demands, output torque, pressures over time; the hand-over is shaded."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from plant_sim.bench.power_shift_measures import handover

_A, _B, _SHARED, _DEMAND = "#1f77b4", "#d62728", "#2ca02c", "#222222"
_SHADE = "#f0e6d2"


def draw_shift(path: Path, columns: Mapping[str, np.ndarray], title: str) -> None:
    """Draw the columns of a run of the power-shift rig into a PNG at `path`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    time = columns["time_s"]
    figure = Figure(figsize=(10, 10), layout="constrained")
    FigureCanvasAgg(figure)
    speed, torque, output, pressure = figure.subplots(4, 1, sharex=True, height_ratios=(2, 2.5, 1.5, 1.8))
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)

    speed.plot(time, columns["input_speed_demand_rad_s"], color=_DEMAND, lw=1.0, ls="--", label="input, demand")
    speed.plot(time, columns["truth_input_speed_rad_s"], color=_SHARED, lw=1.4, label="input")
    for clutch, colour, gear in (("a", _A, "1st"), ("b", _B, "2nd")):
        gear_speed = columns["truth_input_speed_rad_s"] - columns[f"truth_slip_speed_{clutch}_rad_s"]
        speed.plot(time, gear_speed, color=colour, lw=1.2, label=f"output x ratio of {clutch} ({gear} gear)")
        demand = columns[f"torque_demand_{clutch}_nm"]
        torque.plot(time, columns[f"truth_clutch_torque_{clutch}_nm"], color=colour, lw=1.4, label=f"clutch {clutch}")
        torque.plot(time, demand, color=_DEMAND, lw=1.0, ls="--", label="demands" if clutch == "b" else None)
        pressure.plot(time, columns[f"cylinder_pressure_{clutch}_bar"], color=colour, lw=1.0, label=f"clutch {clutch}")
    speed.set_ylabel("speed [rad/s]")
    torque.set_ylabel("clutch torque [Nm]")
    output.plot(time, columns["truth_output_torque_nm"], color=_SHARED, lw=1.4, label="output")
    output.plot(time, columns["truth_road_torque_nm"], color=_DEMAND, lw=1.0, ls=":", label="road")
    output.set_ylabel("output torque [Nm]")
    pressure.set_ylabel("cylinder pressure [bar]")
    pressure.set_xlabel("time [s]")

    shift = handover(columns)
    if shift:
        output.axhline(shift.before, color=_DEMAND, lw=0.8, ls="--", label="before")
    for axes in (speed, torque, output, pressure):
        if shift:
            end = shift.shift_end if shift.shift_end is not None else shift.window.stop - 1
            axes.axvspan(time[shift.begin], time[shift.torque_end], color=_SHADE, lw=0)
            axes.axvspan(time[shift.torque_end], time[end], color=_SHADE, lw=0, alpha=0.5)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(loc="lower center" if axes is output else "upper left", ncols=4, fontsize=8, frameon=False)
        axes.margins(x=0.0, y=0.12)
    if shift:
        torque.annotate(
            "torque phase", (time[shift.begin], 0.96), xycoords=("data", "axes fraction"), fontsize=8, va="top"
        )
    figure.savefig(path, dpi=110)
