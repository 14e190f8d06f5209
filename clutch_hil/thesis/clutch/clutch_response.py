"""Frequency response of the controlled clutch: figure 6.15, with the running controller."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from clutch_hil.thesis.clutch.clutch_experiments import (
    list_cooling_changes,
    load_nominal,
    run_experiment,
    stationary_law,
)
from clutch_hil.thesis.clutch.clutch_fit import TOLERANCE
from plant_sim.rigs.multisine import FrequencyResponse, Multisine, compute_coherence, estimate_response
from protocols.files.units import RPM

Array = np.ndarray
# bar, rad/s; chosen: as in figs 6.11 and 6.14. The thesis says only that the plates touch
PRESSURE, SLIP = (3.4, 200 * RPM)
SOURCE = Multisine(np.arange(1, 61), amplitude=0.012, samples=2000)  # 0.5 to 30 Hz, at most 0.25 bar: it never opens
REALISATIONS, PERIODS = 4, 10  # as in sec. 3.10; the first of 11 periods is left out, in which the rig settles
STEP = 1e-3  # s, of the controller
HALF_POWER_DECIBEL = -10.0 * np.log10(2.0)  # dB: "-3 dB"
THESIS_BANDWIDTH = 9.8  # Hz, sec. 6.3
COMPARED_UP_TO = 15.0  # Hz; chosen: well above both bandwidths
LINK_QUOTE = "'clearly the link between both systems'"
TABLE_FREQUENCIES = (0.5, 1.0, 2.0, 5.0, 8.0, 10.0, 15.0, 20.0, 30.0)  # Hz, rows of the table


@dataclass(frozen=True)
class Channel:
    """Response (n,) from the demanded pressure to one signal, and the coherence (n,) of both."""

    transfer: FrequencyResponse
    coherence: Array
    stationary: float  # the response at rest, [bar/bar] or [Nm/bar]

    @property
    def decibel(self) -> Array:
        """Magnitude over the stationary response [dB]."""
        return 20.0 * np.log10(np.abs(self.transfer.response) / self.stationary)

    @property
    def phase(self) -> Array:
        """Phase [deg], unwrapped."""
        return np.degrees(np.unwrap(np.angle(self.transfer.response)))

    @property
    def bandwidth(self) -> float:
        """Frequency [Hz] where the magnitude first falls by 3 dB, interpolated between the two neighbouring lines."""
        decibel = self.decibel
        beyond = int(np.argmax(decibel < HALF_POWER_DECIBEL))
        pair = slice(beyond - 1, beyond + 1)
        return float(np.interp(-HALF_POWER_DECIBEL, -decibel[pair], self.transfer.frequency[pair]))


@dataclass(frozen=True)
class Response:
    """Responses of measured cylinder pressure [bar/bar] and clutch torque [Nm/bar] to the demanded pressure."""

    pressure: Channel
    torque: Channel


def measure_response(tuned: Mapping[str, float] | None = None) -> Response:
    """Measure the response to a multisine of random phases on the demand; `tuned`: changed parameters of the controller."""
    random = np.random.default_rng(1)
    waves = [np.tile(SOURCE.draw_period(random), PERIODS + 1) for _ in range(REALISATIONS)]
    run = run_experiment(
        PRESSURE + np.concatenate(waves), SLIP, load_nominal(**list_cooling_changes()), seed=5, tuned=tuned
    )

    def split_periods(signal: Array) -> Array:
        return signal.reshape(REALISATIONS, PERIODS + 1, SOURCE.samples)[:, 1:]

    demand, pressure, torque = (split_periods(signal) for signal in (run.demand, run.pressure, run.torque))
    above, below = (np.add(*stationary_law(PRESSURE + d, SLIP, load_nominal())) for d in (0.01, -0.01))
    return Response(
        *(
            Channel(estimate_response(SOURCE, STEP, demand, one), compute_coherence(SOURCE, demand, one), stationary)
            for one, stationary in ((pressure, 1.0), (torque, float(above - below) / 0.02))
        )
    )


@register_reproduction(
    "figure-6.15",
    "Frequency response of pressure loop and clutch torque",
    claim="over the running controller p_cyl/p_d is 3 dB down within 3 % of the thesis's 9.8 Hz, and M/p_d follows p_cyl/p_d "
    "within 1 dB and 5 deg up to 15 Hz",
)
def reproduce_figure_6_15(sheet: Sheet) -> None:
    """p_cyl/p_d and M/p_d by a multisine, in contact."""
    response = measure_response()
    frequency = response.pressure.transfer.frequency
    _draw(sheet, response)
    pressure, torque = response.pressure, response.torque
    head = ("frequency [Hz]", "p_cyl/p_d [dB]", "phase [deg]", "coherence", "M/p_d [Nm/bar]", "[dB]", "phase [deg]",
            "coherence")  # fmt: skip
    sheet.table = [head]
    for target in TABLE_FREQUENCIES:
        k = int(np.argmin(np.abs(frequency - target)))
        sheet.table.append((
            f"{frequency[k]:g}", f"{pressure.decibel[k]:.2f}", f"{pressure.phase[k]:.1f}", f"{pressure.coherence[k]:.4f}",
            f"{np.abs(torque.transfer.response[k]):.2f}", f"{torque.decibel[k]:.2f}", f"{torque.phase[k]:.1f}",
            f"{torque.coherence[k]:.4f}",
        ))  # fmt: skip
    bandwidth = pressure.bandwidth
    sheet.table.append(("3 dB down at", f"{bandwidth:.2f} Hz", "", "", "", f"{torque.bandwidth:.2f} Hz", "", ""))
    sheet.check(f"p_cyl/p_d is 3 dB down within {TOLERANCE:.0%} of the thesis's bandwidth [Hz]",
                abs(bandwidth / THESIS_BANDWIDTH - 1.0) <= TOLERANCE, bandwidth, THESIS_BANDWIDTH)  # fmt: skip
    sheet.check("M/p_d is 3 dB down within 3 % of where p_cyl/p_d is [Hz]",
                abs(torque.bandwidth / bandwidth - 1.0) <= 0.03, torque.bandwidth, LINK_QUOTE)  # fmt: skip
    up_to = frequency <= COMPARED_UP_TO
    ripple, turn = (torque.decibel - pressure.decibel)[up_to], (torque.phase - pressure.phase)[up_to]
    sheet.check("M/p_d over p_cyl/p_d is constant within 1 dB up to 15 Hz [dB]", np.abs(ripple).max() < 1.0,
                (ripple.min(), ripple.max()), LINK_QUOTE)  # fmt: skip
    sheet.check("... and in phase within 5 deg [deg]", np.abs(turn).max() < 5.0, (turn.min(), turn.max()))
    least = [float(channel.coherence[up_to].min()) for channel in (pressure, torque)]
    sheet.check(
        "coherence with p_d up to 15 Hz, of p_cyl and of M, is above 0.98", min(least) > 0.98, least, "this project"
    )
    sheet.note(
        f"valve, line and gains are design values of this project (janssens2010.toml, controller.toml) "
        f"for {THESIS_BANDWIDTH:g} Hz; "
        "over the "
        f"controller as it runs, with the bus, they give {bandwidth:.2f} Hz"
    )
    sheet.note(
        f"{REALISATIONS} realisations of {PERIODS} periods of 2 s at {PRESSURE:g} bar and 200 rpm; p_d is the pressure demand "
        "that the controller records, p_cyl and M are the sensors'. 3 dB: half the power of what the response is at rest, 1 "
        f"bar/bar and {torque.stationary:.2f} Nm/bar of the plant's law, on the straight line between neighbouring lines"
    )


def _draw(sheet: Sheet, response: Response) -> None:
    axes: Any = sheet.make_axes(3, 1, width=8, height=8, sharex=True, height_ratios=(3, 3, 1.5))
    for channel, name, style in (
        (response.pressure, r"$p_{cyl}/p_d$", {"color": "C0", "lw": 2.2}),
        (response.torque, r"$M/p_d$", {"color": "C1", "ls": "--", "lw": 1.4}),
    ):
        frequency = channel.transfer.frequency
        for panel, values in zip(axes, (channel.decibel, channel.phase, channel.coherence), strict=True):
            panel.semilogx(frequency, values, label=f"{name}: 3 dB down at {channel.bandwidth:.2f} Hz", **style)
    axes[0].axhline(HALF_POWER_DECIBEL, color=REFERENCE_COLOUR, lw=0.8, ls=":")
    axes[0].axvline(response.pressure.bandwidth, color=REFERENCE_COLOUR, lw=0.8, ls=":")
    ticks = (0.5, 1, 2, 5, 10, 20, 30)
    axes[0].set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes[0].minorticks_off()
    axes[0].legend(loc="lower left", frameon=False)
    axes[2].set_ylim(0.8, 1.01)
    axes[1].set_yticks(range(-270, 1, 45))
    label_axes(axes[0], "", "magnitude over that at rest [dB]")
    label_axes(axes[1], "", "phase [deg]")
    label_axes(axes[2], "frequency [Hz]", "coherence [-]")
