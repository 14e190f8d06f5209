"""Picture of a run: torque, pressure and slip over time."""

from pathlib import Path

import numpy as np

_DEMAND, _TRUE, _ESTIMATE = "#222222", "#1f77b4", "#ff7f0e"


def draw_run(path: Path, columns: dict[str, np.ndarray], title: str) -> None:
    """Draw the columns of a run file into a PNG at `path`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    time = columns["time_s"]
    figure = Figure(figsize=(10, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    torque, pressure, slip = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 1))
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    torque.plot(time, columns["truth_clutch_torque_nm"], color=_TRUE, lw=1.6, label="true")
    torque.plot(time, columns["controller_torque_estimate_nm"], color=_ESTIMATE, lw=0.8, label="estimate")
    torque.plot(time, columns["torque_demand_nm"], color=_DEMAND, lw=1.0, ls="--", label="demand")
    torque.set_ylabel("clutch torque [Nm]")
    pressure.plot(time, columns["cylinder_pressure_bar"], color=_TRUE, lw=1.0, label="measured")
    pressure.plot(time, columns["controller_pressure_demand_bar"], color=_DEMAND, lw=1.0, ls="--", label="demand")
    pressure.set_ylabel("cylinder pressure [bar]")
    slip.plot(time, columns["slip_speed_rad_s"], color=_TRUE, lw=0.5, label="measured")
    slip.plot(time, columns["motor_speed_demand_rad_s"], color=_DEMAND, lw=1.0, ls="--", label="motor demand")
    slip.set_ylabel("slip [rad/s]")
    slip.set_ylim(bottom=0.0)
    slip.set_xlabel("time [s]")
    for axes in (torque, pressure, slip):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(loc="upper right", ncols=3, fontsize=8, frameon=False)
        axes.margins(x=0.0, y=0.12)
    figure.savefig(path, dpi=110)
