"""Figures 3.7 to 3.9, 3.11 and 3.12: the tangential frequency response of the tribometer, which friction makes non-linear."""

from typing import Any

import numpy as np

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from clutch_hil.thesis.tribometer.tribometer_identification import (
    LOADS,
    OWN_WEIGHT,
    compute_mass_line,
    compute_mass_spring,
    decibel,
    identify_response,
    is_in_band,
    level,
    measure_sines,
    resonance,
    slope,
)
from plant_sim.rigs.multisine import FrequencyResponse

Array = np.ndarray
AMPLITUDES = (0.01, 0.02, 0.03, 0.04, 0.05, 0.06)  # V, figs 3.11 and 3.12
HIGH_AMPLITUDE = 0.12  # V; chosen: so high that the response should be near the mass line
TORQUES = ("motor torque", "dynamometer torque")
GAIN_NOTE = (
    "the thesis gives no torque for a volt and does not say whose amplitude A is; chosen: 2 Nm/V, A for each of the 500 lines,"
    " so that 0.015 V are 0.47 Nm effective, under half the break-away torque at the own weight"
)
CONTACT_NOTE = (
    "chosen here: Maxwell-slip contact of 12 equal springs, 1e-4 rad to gross sliding, friction coefficient of eq 4.2 "
    "from 0.25 at"
    " 50 N to 0.11 at 1100 N. Calibrated: 222 Hz of the table alone, 170 Hz at 1400 N in pre-sliding. The rest is predicted"
)


def _draw(pair: Any, frequency: Array, values: Array, name: str, shade: float, style: str = "-") -> None:
    colour = (shade, 0.25 + 0.35 * shade, 0.75 - 0.65 * shade)
    pair[0].semilogx(frequency, decibel(values), style, color=colour, lw=0.9, ms=4, label=name)
    turned = np.degrees(np.angle(values))
    turned = np.where(turned > 90.0, turned - 360.0, turned)
    pair[1].semilogx(
        frequency, turned, style if "." in style else ".", color=colour, lw=0.7, ms=3 if "." in style else 2
    )


def _finish_panel(sheet: Sheet, pair: Any, title: str) -> None:
    label_axes(pair[0], "", r"$|\theta/T|$ [dB rel. 1 rad/Nm]", title)
    label_axes(pair[1], "frequency [Hz]", "phase [deg]")
    pair[1].set_yticks([-270, -180, -90, 0, 90])
    if not sheet.figure.legends:
        sheet.figure.legend(*pair[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8)


def _draw_preloads(sheet: Sheet, amplitude: float) -> None:
    """Draw the responses of all preloads at `amplitude` [V]; check what sec. 3.10 says of the high preloads."""
    axes = sheet.make_axes(2, 2, width=12, height=7, sharex=True, height_ratios=(2, 1))
    both = [identify_response(load, amplitude) for load in LOADS]
    for column, torque in enumerate(TORQUES):
        for shade, load, pair in zip(np.linspace(0.0, 0.9, len(LOADS)), LOADS, both, strict=True):
            _draw(axes[:, column], pair[column].frequency, pair[column].response, f"{load:g} N", shade)
        axes[0, column].axvline(170.0, color=REFERENCE_COLOUR, ls="--", lw=0.8)
        _finish_panel(sheet, axes[:, column], f"{torque} as input, A = {amplitude:g} V; dashed: 170 Hz")
    responses = [one[0] for one in both]
    peaks = [resonance(one.frequency, one.response) for one in responses]
    sheet.check(
        "first resonance at 840 and 1120 N within 10 % of 170 Hz [Hz]",
        all(abs(peak / 170.0 - 1.0) < 0.1 for peak in peaks[3:5]), measured=peaks[3:5], thesis="around 170 Hz",
    )  # fmt: skip
    slopes = [slope(one.frequency, one.response) for one in responses]
    sheet.check(
        "slope from 5 to 60 Hz at 840 N and more within 10 dB/decade of 0 [dB/decade]",
        max(map(abs, slopes[3:])) < 10.0, measured=slopes[3:], thesis="relatively linear at high loads: 0",
    )  # fmt: skip
    softer = [
        level(one.frequency, one.response) - level(one.frequency, compute_mass_spring(one.frequency, load))
        for one, load in zip(responses, LOADS, strict=True)
    ]
    sheet.check(
        "level from 5 to 60 Hz above that of the linear structure falls with every preload, to less than 3 dB at 1400 N [dB]",
        bool(np.all(np.diff(softer) < 0.0)) and softer[-1] < 3.0, measured=softer,
        thesis="relatively linear at high normal loads, non-linear at the own weight",
    )  # fmt: skip
    ratios = [_compute_median_distortion(one) for one in responses]
    sheet.note(
        "non-linear distortion over response, median 5 to 60 Hz, 58 to 1400 N: "
        + ", ".join(f"{ratio:.0f}" for ratio in ratios)
        + " dB; most of it comes from the slip that the resonance makes"
    )
    sheet.note(GAIN_NOTE)
    sheet.note(CONTACT_NOTE)
    sheet.note(
        "the angle is that of an ideal encoder: a count of the real one, 38 urad, is as much as the motion at 1400 N"
    )


def _compute_median_distortion(frf: FrequencyResponse) -> float:
    """Non-linear distortion of one realisation over the response [dB], median of 5 to 60 Hz."""
    inside = is_in_band(frf.frequency)
    return float(decibel(np.array([np.median(frf.distortion[inside] / np.abs(frf.response[inside])), 1e-15]).max()))


def _check_steeper(sheet: Sheet, smaller: float, amplitude: float) -> None:
    slopes = [
        slope(one.frequency, one.response)
        for one in (identify_response(OWN_WEIGHT, a)[0] for a in (smaller, amplitude))
    ]
    sheet.check(
        f"under the own weight the slope is steeper than at {smaller:g} V by 5 dB/decade or more [dB/decade]",
        slopes[1] < slopes[0] - 5.0, measured=slopes, thesis="from 0 towards -40",
    )  # fmt: skip


@register_reproduction(
    "figure-3.7", "Tangential frequency response, A = 0.015 V",
    claim="relatively linear at high preloads; first resonance at about 170 Hz",
)  # fmt: skip
def reproduce_figure_3_7(sheet: Sheet) -> None:
    """Smallest amplitude."""
    _draw_preloads(sheet, 0.015)


@register_reproduction(
    "figure-3.8", "Tangential frequency response, A = 0.03 V",
    claim="relatively linear at high preloads, non-linear under the own weight; first resonance at about 170 Hz",
)  # fmt: skip
def reproduce_figure_3_8(sheet: Sheet) -> None:
    """Middle amplitude."""
    _draw_preloads(sheet, 0.03)
    _check_steeper(sheet, 0.015, 0.03)


@register_reproduction(
    "figure-3.9", "Tangential frequency response, A = 0.06 V",
    claim="under the own weight the slope goes from 0 towards -40 dB/decade; relatively linear at high preloads",
)  # fmt: skip
def reproduce_figure_3_9(sheet: Sheet) -> None:
    """Largest amplitude."""
    _draw_preloads(sheet, 0.06)
    _check_steeper(sheet, 0.03, 0.06)


def _draw_bounds(sheet: Sheet, axes: Any, responses: list[Array], frequency: Array) -> None:
    """Draw mass line and mass-spring curve; check that the response grows from one to the other."""
    bounds = compute_mass_line(frequency), compute_mass_spring(frequency, OWN_WEIGHT)
    for values, style, name in zip(bounds, ("--", ":"), ("mass line", "mass-spring"), strict=True):
        axes.semilogx(frequency, decibel(values), color=REFERENCE_COLOUR, ls=style, lw=1.0, label=name)
    inside = is_in_band(frequency)
    high, low = (decibel(values[inside]) for values in bounds)
    share = float(np.mean([(decibel(r[inside]) > low - 3.0) & (decibel(r[inside]) < high + 3.0) for r in responses]))
    levels = [level(frequency, one) for one in responses]
    sheet.check(
        "the median amplitude from 5 to 60 Hz grows with every step of excitation [dB]",
        bool(np.all(np.diff(levels) > 0.0)), measured=levels, thesis="increases with the amplitude of excitation",
    )  # fmt: skip
    sheet.check(
        "share of the response from 5 to 60 Hz between mass-spring curve and mass line, 3 dB allowed: above 0.95",
        share > 0.95, measured=share, thesis="the bounds are mass line and mass-spring curve",
    )  # fmt: skip


@register_reproduction(
    "figure-3.11", "Non-linear tangential response under the own weight",
    claim="the amplitude grows with the excitation, its slope from 0 towards -40 dB/decade: to the mass line",
)  # fmt: skip
def reproduce_figure_3_11(sheet: Sheet) -> None:
    """Own weight, six amplitudes, multisine."""
    axes = sheet.make_axes(2, 2, width=12, height=7, sharex=True, height_ratios=(2, 1))
    amplitudes = (*AMPLITUDES, HIGH_AMPLITUDE)
    both = [identify_response(OWN_WEIGHT, amplitude) for amplitude in amplitudes]
    frequency = both[0][0].frequency
    for column in (0, 1):
        for shade, amplitude, pair in zip(np.linspace(0.0, 1.0, 7), amplitudes, both, strict=True):
            _draw(axes[:, column], frequency, pair[column].response, f"A = {amplitude:g} V", shade)
    _draw_bounds(sheet, axes[0, 0], [one[0].response for one in both], frequency)
    for column, torque in enumerate(TORQUES):
        _finish_panel(sheet, axes[:, column], f"{torque} as input, own weight (58 N)")
    for column, statement in enumerate(
        ("motor torque as input", "dynamometer torque as input, as sec. 3.10 defines it")
    ):
        slopes = [slope(frequency, one[column].response) for one in both]
        sheet.check(
            f"{statement}: slope above -10 at 0.01 V, falls with A, below -30 dB/decade at {HIGH_AMPLITUDE:g} V [dB/decade]",
            slopes[0] > -10.0 and slopes[-1] < -30.0 and bool(np.all(np.diff(slopes) < 0.0)), measured=slopes,
            thesis="from 0 towards -40",
        )  # fmt: skip
    sheet.note(
        "the torque at the dynamometers is the friction: in sliding it grows no more with the motion, its best linear"
        " approximation is a damper, and theta/T tends to -20 dB/decade. A mass line needs the motor's torque as input; indeed"
        " the corners of the axes of figs 3.9 and 3.11 (0 dB at 1 Hz, -120 dB at 1 kHz) lie on a mass line of 0.025 kg m^2"
    )
    sheet.note(f"{HIGH_AMPLITUDE:g} V is chosen here, to see the limit")
    sheet.note(GAIN_NOTE)
    sheet.note(CONTACT_NOTE)


@register_reproduction(
    "figure-3.12", "Non-linear tangential response under the own weight, stepped sine",
    claim="a stepped sine gives a similar response as the multisine: from 0 to -40 dB/decade with the amplitude",
)  # fmt: skip
def reproduce_figure_3_12(sheet: Sheet) -> None:
    """Own weight, six amplitudes, one frequency after the other."""
    axes = sheet.make_axes(2, 1, width=9, height=7, sharex=True, height_ratios=(2, 1))
    frequency = measure_sines(AMPLITUDES[0])[0]
    responses = [measure_sines(amplitude)[1] for amplitude in AMPLITUDES]
    for shade, amplitude, values in zip(np.linspace(0.0, 0.9, 6), AMPLITUDES, responses, strict=True):
        _draw(axes, frequency, values, f"A = {amplitude:g} V", shade, ".-")
    _draw_bounds(sheet, axes[0], responses, frequency)
    _finish_panel(sheet, axes, "motor torque as input, own weight (58 N)")
    slopes = [slope(frequency, values) for values in responses]
    sheet.check(
        "slope at the smallest amplitude above -10, at the largest below -35 dB/decade [dB/decade]",
        slopes[0] > -10.0 and slopes[-1] < -35.0, measured=slopes, thesis="from 0 to -40",
    )  # fmt: skip
    sheet.note(
        "the thesis gives no amplitudes of the sines; those chosen here have the effective value of the multisine of the same A"
    )
    sheet.note(CONTACT_NOTE)
