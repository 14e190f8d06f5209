"""Pictures of identified quantities: frequency response of the pressure loop (fig 6.15), maps over the pressure (fig 6.13)."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from clutch_hil.bench.pictures.palette import DEMAND, ESTIMATE, MEASURED, TRUE
from clutch_hil.identify.frequency_response import HALF_POWER, LoopResponse
from clutch_hil.identify.thesis_quantities import Propagation, compute_maps, list_pressures
from clutch_hil.page.figures import name_file
from protocols.files.output_file import whole_file

_TICKS = (0.5, 1, 2, 5, 10, 20, 50)  # Hz
_TURN = 45.0  # deg between grid lines of the phase
_POINTS = 60  # points of a curve of the maps
RESPONSE_HEIGHT, MAPS_HEIGHT = 8.0, 4.4  # inch


def draw_response(response: LoopResponse, path: Path) -> None:
    """Write the Bode diagram with coherence and 95 % bands to `path`. Raises InputError."""
    figure = Figure(figsize=(8.0, RESPONSE_HEIGHT), layout="constrained")
    plot_response(figure, response)
    with whole_file(path) as part:
        figure.savefig(part, format="png", dpi=110)


def plot_response(figure: Figure, response: LoopResponse) -> None:
    """Plot the Bode diagram with coherence and 95 % bands."""
    magnitude, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=(3, 3, 1.5))
    for channel, name, colour, line in (
        (response.pressure, "p_cyl/p_d", MEASURED, {"marker": "o", "ms": 5.0, "lw": 1.8}),
        (response.torque, "M/p_d", ESTIMATE, {"marker": "s", "ms": 2.5, "lw": 1.0, "ls": "--"}),
    ):
        low, high = channel.decibel_band
        interval = channel.bandwidth_interval
        bandwidth = (
            ""
            if interval is None
            else f": 3 dB down at {channel.bandwidth:.2f} Hz ({interval[0]:.2f}–{interval[1]:.2f})"
        )
        style: dict[str, Any] = {"color": colour, **line}
        magnitude.semilogx(channel.frequency, channel.decibel, label=name + bandwidth, **style)
        magnitude.fill_between(channel.frequency, low, high, color=colour, alpha=0.3, lw=0)
        phase.semilogx(channel.frequency, channel.phase, **style)
        half = channel.phase_half
        phase.fill_between(channel.frequency, channel.phase - half, channel.phase + half, color=colour, alpha=0.3, lw=0)
        coherence.semilogx(channel.frequency, channel.coherence, **style)
        if channel.bandwidth is not None:
            magnitude.axvline(channel.bandwidth, color=colour, lw=0.8, ls=":")
    magnitude.axhline(HALF_POWER, color=DEMAND, lw=0.8, ls=":")
    shown = response.pressure.frequency
    ticks = [tick for tick in _TICKS if shown[0] * 0.99 <= tick <= shown[-1] * 1.01]
    magnitude.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    magnitude.minorticks_off()
    lowest = min(float(c.coherence.min()) for c in (response.pressure, response.torque))
    lines = np.concatenate([response.pressure.phase, response.torque.phase])
    phase.set_yticks(np.arange(_TURN * np.floor(lines.min() / _TURN), lines.max() + _TURN, _TURN))
    coherence.set_ylim(min(0.9, lowest - 0.02), 1.01)
    magnitude.set_ylabel("magnitude over that at rest [dB]")
    phase.set_ylabel("phase [deg]")
    coherence.set_ylabel("coherence [-]")
    coherence.set_xlabel("frequency [Hz]")
    magnitude.legend(loc="lower left", frameon=False, fontsize=9)
    pressure, slip, celsius = response.point
    magnitude.set_title(
        f"{name_file(response.run)}, {response.between[0]:.1f}–{response.between[1]:.1f} s\nabout {pressure:.2f} bar,"
        f" {slip:.1f} rad/s, {celsius:.0f} °C; demand {response.amplitude:.2g} bar rms; bands: 95 %",
        fontsize=9,
        parse_math=False,  # a name may have a $
    )
    for axis in (magnitude, phase, coherence):
        axis.grid(alpha=0.3)


def draw_maps(known: Propagation, highest: float, path: Path) -> None:
    """Write the picture of `plot_maps` to `path`. Raises InputError."""
    figure = Figure(figsize=(11.0, MAPS_HEIGHT), layout="constrained")
    plot_maps(figure, known, highest)
    figure.suptitle("Maps of the clutch, with 95 % bands", fontsize=10)
    with whole_file(path) as part:
        figure.savefig(part, format="png", dpi=110)


def plot_maps(figure: Figure, known: Propagation, highest: float) -> None:
    """Plot M_C, C_v and beta over the pressure with 95 % bands, shaded above the `highest` pressure of the runs [bar]."""
    levels = list_pressures(known.values["piston.contact_pressure"], highest)
    pressure = np.linspace(levels[0], levels[-1], _POINTS)
    value, half = known(lambda v: compute_maps(v, pressure))
    axes = figure.subplots(2, 3, sharex=True, height_ratios=(3, 1))
    units = ("M_C [Nm]", "C_v [Nm/(rad/s)^γ]", "β [-]")
    for k, unit in enumerate(units):
        top, low = axes[:, k]
        top.plot(pressure, value[k], color=TRUE)
        top.fill_between(pressure, value[k] - half[k], value[k] + half[k], color=TRUE, alpha=0.3, lw=0)
        top.set_ylabel(unit)
        share = 100.0 * half[k] / np.where(value[k] > 0.0, value[k], np.nan)  # a map may be 0 above contact
        low.plot(pressure, share, color=TRUE)
        low.set_ylim(0.0, 1.2 * float(np.max(share, where=np.isfinite(share), initial=0.0)) or 1.0)
        low.set_xlabel("pressure [bar]")
        for axis in (top, low):
            axis.grid(alpha=0.3)
            axis.set_xlim(pressure[0], pressure[-1])
            if highest < pressure[-1]:
                axis.axvspan(max(highest, pressure[0]), pressure[-1], color=DEMAND, alpha=0.12, lw=0)
    axes[1, 0].set_ylabel("± 95 % [%]")
    if highest < pressure[-1]:
        axes[0, 0].set_title("shaded: above the pressures of the runs", fontsize=8.5, loc="left")
