"""Picture of a run: torque, its error, pressure and slip over time."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from plant_sim.bench.measures import torque as torque_of

_DEMAND, _TRUE, _ESTIMATE, _INJECTED = "#222222", "#1f77b4", "#ffb56b", "#c44e52"
_ERROR_SHOWN = 2.0  # Nm, half the height of the error's axis: the transient of the first touch may leave it


def draw_run(path: Path, columns: Mapping[str, np.ndarray], title: str, injected: Iterable[float] = ()) -> None:
    """Draw the columns of a run file into a PNG at `path`, with a line at each time [s] at which something was `injected`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    time, demand = columns["time_s"], columns["torque_demand_nm"]
    true, estimate = torque_of(columns), columns["controller_torque_estimate_nm"]
    name = "true" if "truth_clutch_torque_nm" in columns else "measured"
    figure = Figure(figsize=(10, 9), layout="constrained")
    FigureCanvasAgg(figure)
    torque, error, pressure, slip = figure.subplots(4, 1, sharex=True, height_ratios=(3, 1.3, 2, 1.3))
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    torque.plot(time, estimate, color=_ESTIMATE, lw=1.0, label="estimate")
    torque.plot(time, true, color=_TRUE, lw=1.4, label=name)
    if np.any(demand > 0.0):
        torque.plot(time, demand, color=_DEMAND, lw=1.0, ls="--", label="demand")
        error.plot(time, estimate - demand, color=_ESTIMATE, lw=0.6, label="estimate - demand")
        error.plot(time, true - demand, color=_TRUE, lw=1.2, label=f"{name} - demand")
    else:  # a pressure was asked for
        error.plot(time, estimate - true, color=_ESTIMATE, lw=0.6, label=f"estimate - {name}")
    torque.set_ylabel("clutch torque [Nm]")
    error.axhline(0.0, color=_DEMAND, lw=0.8, ls="--")
    error.set_ylim(-_ERROR_SHOWN, _ERROR_SHOWN)
    error.set_ylabel("error [Nm]")
    if "truth_cylinder_pressure_bar" in columns:
        pressure.plot(time, columns["truth_cylinder_pressure_bar"], color=_ESTIMATE, lw=2.4, label="true")
    pressure.plot(time, columns["cylinder_pressure_bar"], color=_TRUE, lw=1.2, label="measured")
    pressure.plot(time, columns["controller_pressure_demand_bar"], color=_DEMAND, lw=1.0, ls="--", label="demand")
    pressure.set_ylabel("cylinder pressure [bar]")
    slip.plot(time, columns["slip_speed_rad_s"], color=_TRUE, lw=0.6, label="measured")
    slip.plot(time, columns["motor_speed_demand_rad_s"], color=_DEMAND, lw=1.0, ls="--", label="motor demand")
    slip.set_ylabel("slip [rad/s]")
    slip.set_ylim(bottom=0.0)
    slip.set_xlabel("time [s]")
    begins = sorted(set(injected))
    for axes in (torque, error, pressure, slip):
        for i, at in enumerate(begins):
            label = "injected" if axes is torque and i == 0 else "_"  # matplotlib leaves _ out of a legend
            axes.axvline(at, color=_INJECTED, lw=0.8, ls=":", label=label)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        # above the axes, where it covers no curve
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 0.98), borderaxespad=0.0, ncols=4, fontsize=8, frameon=False
        )
        axes.margins(x=0.0, y=0.08)
    figure.savefig(path, dpi=110)
