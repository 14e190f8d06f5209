"""Figures 3.6, 3.10, 4.12 and 4.13: structure of the tribometer, and its normal direction with a contact that stiffens."""

from typing import Any

import numpy as np
from scipy.optimize import curve_fit
from scipy.signal import find_peaks

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.rigs.multisine import Multisine
from plant_sim.rigs.tribometer import Tribometer, load_nominal
from plant_sim.rigs.tribometer_responses import measure_normal_response
from plant_sim.rigs.tribometer_structure import Chain, compute_response

Array = np.ndarray
PRELOADS = (58.0, 100.0, 200.0, 400.0, 800.0, 1200.0)  # N, fig 3.10; 58 N is the own weight
STEADY_LOADS = (50.0, 280.0, 560.0, 840.0, 1100.0)  # N, figs 4.9, 4.12, 4.13
SPEEDS = (0.8, 1.6, 3.2, 6.4)  # rad/s, fig 4.10
LIFT = 1e-6  # m, fig 4.11
FIRST_RESONANCE, SECOND_RESONANCE = 186.0, 288.0  # Hz, sec. 3.10: under the own weight, and at high preload
HERTZ = 1.5  # exponent of a sphere on a flat
DT = 2e-5  # s; chosen: a hundredth of a period at 500 Hz
SAMPLES = 25_000  # a period of 0.5 s
# N, amplitude of a line, 1.1 N effective over all; chosen: small beside the own weight
LINE = 0.1
# N/m, N; any will do, because it does not act in this direction
FRICTION = MaxwellSlip(np.array([2e6]), np.array([10.0]))
CONTACT_NOTE = (
    "calibrated: Hertz's exponent and 15 um from 50 to 1100 N (fig 4.12) for the contact; 186 Hz (first, own weight) and 288 Hz"
    " (second, 1200 N) for the springs k_d and k_eff. Chosen here: m_1 = 8 kg, m_2 = 4.5 kg; m_2 + m_3 are the own weight"
)


def compute_printed_torque(chain: Chain, s: Array, k_kf: float, c_kf: float) -> Array:
    """Compute T/theta_3 [Nm/rad] over `s` (n,) [1/s] as the thesis prints it beside fig 3.6."""
    contact, k_d, k_eff = c_kf * s + k_kf, chain.table_stiffness, chain.coupling_stiffness
    first = chain.inertia[0] * s**2 + c_kf * s + k_d + k_kf
    second = chain.inertia[1] * s**2 + c_kf * s + k_eff + k_d
    return contact * k_eff * k_d / (contact**2 - first * second)  # T/theta_3, as printed


def compute_printed_deflection(chain: Chain, s: Array, k_kf: float, c_kf: float) -> Array:
    """Compute X_1/F [m/N] over `s` (n,) [1/s] as the thesis prints it beside fig 3.6."""
    contact, k_d, k_eff = c_kf * s + k_kf, chain.table_stiffness, chain.coupling_stiffness
    first = chain.inertia[0] * s**2 + c_kf * s + k_eff + k_d
    second = chain.inertia[1] * s**2 + c_kf * s + k_kf + k_eff
    third = chain.inertia[2] * s**2 + k_eff
    return contact * k_eff / (third * (second * first - contact**2) - k_eff**2 * first)  # X_1/F, as printed


@register_reproduction(
    "figure-3.6", "Structural models and their transfer functions",
    claim="the printed transfer functions T/theta_3 and X_1/F follow from the printed system equations",
)  # fmt: skip
def reproduce_figure_3_6(sheet: Sheet) -> None:
    """Transfer functions by the system equations, in closed form, and as printed."""
    rig = Tribometer(FRICTION, sensors=False)
    frequency = np.geomspace(1.0, 1000.0, 600)
    s = 2j * np.pi * frequency
    bare = [Chain(c.inertia, c.table_stiffness, 0.0, c.coupling_stiffness, 0.0) for c in (rig.tangential, rig.normal)]
    stiffness = (2e5, float(rig.contact_stiffness(280.0)))
    damping = tuple(k * rig.parameters["normal.contact_time"].si for k in stiffness)
    a, _ = bare[0].make_state_space(stiffness[0], damping[0])
    free = [0, 1, 3, 4]  # the motor angle is the input: two masses
    torque = compute_response(
        a[np.ix_(free, free)], a[free, 2], np.array([-bare[0].table_stiffness, 0.0, 0.0, 0.0]), frequency
    )
    a, b = bare[1].make_state_space(stiffness[1], damping[1])
    cases = [
        (
            r"$|T/\theta_3|$ [dB rel. 1 Nm/rad]", "tangential", torque,
            bare[0].transmitted_torque(s, stiffness[0], damping[0]),
            compute_printed_torque(bare[0], s, stiffness[0], damping[0]),
        ),
        (
            r"$|X_1/F|$ [dB rel. 1 m/N]", "normal", compute_response(a, b[:, 1], np.eye(6)[0], frequency),
            bare[1].deflection(s, stiffness[1], damping[1]),
            compute_printed_deflection(bare[1], s, stiffness[1], damping[1]),
        ),
    ]  # fmt: skip
    for axes, (axis, name, exact, formula, printed) in zip(sheet.make_axes(1, 2, width=11), cases, strict=True):
        axes.semilogx(
            frequency, 20 * np.log10(np.abs(exact)), color=REFERENCE_COLOUR, lw=3, alpha=0.35, label="system equations"
        )
        axes.semilogx(frequency, 20 * np.log10(np.abs(formula)), lw=1.2, label="transfer function")
        axes.semilogx(frequency, 20 * np.log10(np.abs(printed)), "--", lw=1.2, label="transfer function as printed")
        label_axes(axes, "frequency [Hz]", axis, name)
        axes.legend(fontsize=8, loc="lower left")
        for what, values, most in (("derived here", formula, 1e-9), ("as printed", printed, 1e-9)):
            worst = float(np.abs(values / exact - 1.0).max())
            sheet.check(
                f"{name}: transfer function {what} is that of the system equations within 1e-9, largest relative difference",
                worst < most, measured=worst, thesis="the same",
            )  # fmt: skip
    sheet.note(
        "misprints of the thesis: the factor of I_2 in T/theta_3 must have k_eff + k_kf where k_eff + k_d is printed; those of"
        " m_1 in X_1/F must have k_kf + k_d where k_eff + k_d is printed. With these the formulas are exact"
    )


@register_reproduction(
    "figure-3.10", "Normal frequency response, deflection of the dynamometers over shaker force",
    claim="the first resonance, 186 Hz under the own weight, moves up with preload; many resonances at low preload merge into"
          " two, the second at 288 Hz",
)  # fmt: skip
def reproduce_figure_3_10(sheet: Sheet) -> None:
    """Six preloads."""
    axes = sheet.make_axes(2, 2, width=12, height=7, sharex="col", height_ratios=(2, 1), width_ratios=(3, 2))
    peaks = []
    for shade, load in zip(np.linspace(0.0, 0.9, len(PRELOADS)), PRELOADS, strict=True):
        transfer, colour = (
            measure_normal_response(
                Tribometer(FRICTION), load, Multisine(np.arange(1, 251), LINE, SAMPLES), DT, periods=3
            ),
            (shade, 0.25 + 0.35 * shade, 0.75 - 0.65 * shade),
        )
        decibel = 20.0 * np.log10(1e6 * np.abs(transfer.response))
        for upper, lower in axes.T:
            upper.plot(transfer.frequency, decibel, color=colour, lw=1.0, label=f"{load:g} N")
            lower.plot(transfer.frequency, np.degrees(np.unwrap(np.angle(transfer.response))), color=colour, lw=1.0)
        peaks.append(transfer.frequency[find_peaks(decibel, prominence=3.0)[0]])
    axes[0, 0].set_xscale("log")
    axes[0, 1].set_xlim(160.0, 320.0)
    axes[0, 1].set_ylim(-20.0, 10.0)
    for upper, lower in axes.T:
        upper.axvline(FIRST_RESONANCE, color=REFERENCE_COLOUR, ls="--", lw=0.8)
        label_axes(
            upper, "", r"$|x_1/F|$ [dB rel. 1 um/N]", "dashed: 186 Hz" if upper is axes[0, 0] else "the two resonances"
        )
        label_axes(lower, "frequency [Hz]", "phase [deg]")
    sheet.figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    first = [float(one[0]) for one in peaks]
    sheet.check(
        "the first resonance moves up from own weight over 200 N to 1200 N [Hz]",
        first[0] < first[2] < first[5] and bool(np.all(np.diff(first) >= 0.0)), measured=first, thesis="186, moves up",
    )  # fmt: skip
    printed = (FIRST_RESONANCE, SECOND_RESONANCE)
    found = (first[0], float(peaks[-1][-1]))
    sheet.check(
        "the first under the own weight, and the second at 1200 N, within a line of 2 Hz of 186 and 288 Hz [Hz]",
        max(abs(one - other) for one, other in zip(found, printed, strict=True)) <= 1.0 / (SAMPLES * DT), found, printed,
    )  # fmt: skip
    sheet.check(
        "number of resonances up to 500 Hz at 1200 N is two", len(peaks[-1]) == 2, measured=len(peaks[-1]), thesis="two"
    )
    sheet.check(
        "number of resonances up to 500 Hz under the own weight is above two",
        len(peaks[0]) > 2, measured=len(peaks[0]), thesis="multiple",
    )  # fmt: skip
    rig = Tribometer(FRICTION, sensors=False)
    third = [
        rig.normal.compute_eigenfrequencies(float(rig.contact_stiffness(load)))[2]
        for load in (PRELOADS[0], PRELOADS[-1])
    ]
    sheet.note(
        f"the third mode of the model, disk against table over the contact, is at {third[0]:.0f} Hz under the own weight and"
        f" {third[1]:.0f} Hz at 1200 N with the stiffness of fig 4.12: it leaves upwards, which is the merge, but outside the"
        " 500 Hz. The further resonances of the thesis are then those of its hammer test, tilting modes, which a model in one"
        " direction does not have; under the own weight the approach, 2.4 um, is less than the runout, 3.5 um"
    )
    sheet.note(CONTACT_NOTE)


def run_steady(load: float, speed: float) -> tuple[Array, Array, Array]:
    """Run three revolutions at `speed` [rad/s] in oil; return angle [rad], mean gap [m] and measured load [N] of the last."""
    rig = Tribometer(FRICTION, load_nominal().with_values({"lift.height": LIFT}))
    seconds = 3.0 * 2.0 * np.pi / speed
    record = rig.run(rig.make_velocity_drive(speed), load, seconds, 1e-4, every=max(1, round(20.0 / speed)))
    last = record.slip_angle_rad > record.slip_angle_rad[-1] - 2.0 * np.pi
    return record.slip_angle_rad[last], record.gap.mean(axis=0)[last], record.normal_measured[last]


@register_reproduction(
    "figure-4.12", "Stiffening of the contact with normal load",
    claim="normal force over relative displacement is a stiffening curve, as of a Hertzian contact",
)  # fmt: skip
def reproduce_figure_4_12(sheet: Sheet) -> None:
    """Mean displacement and load of steady sliding at four speeds and five loads."""
    axes = sheet.make_axes(1, 1, width=8)
    runs = [[run_steady(load, speed) for speed in SPEEDS] for load in STEADY_LOADS]
    displacement = -np.array([[gap.mean() for _, gap, _ in row] for row in runs])
    force = np.array([[measured.mean() for _, _, measured in row] for row in runs])
    axes.plot(1e6 * displacement.ravel(), force.ravel(), "o", ms=4, color="tab:blue", label="four speeds at five loads")
    rig = Tribometer(FRICTION, sensors=False)
    loads = np.linspace(1.0, 1150.0, 200)
    axes.plot(1e6 * rig.approach(loads), loads, color=REFERENCE_COLOUR, lw=1.0, label="Hertz, at rest")
    label_axes(axes, "normal relative displacement [um]", "normal force [N]")
    axes.legend(fontsize=8, loc="upper left")
    secant = np.diff(force.mean(axis=1)) / np.diff(displacement.mean(axis=1))
    sheet.check(
        "stiffness between neighbouring loads rises with every load [N/um]",
        bool(np.all(np.diff(secant) > 0.0)), measured=1e-6 * secant, thesis="stiffening",
    )  # fmt: skip
    means, loads_of_means = 1e6 * displacement.mean(axis=1), force.mean(axis=1)
    (_, _, exponent), _ = curve_fit(
        lambda load, begin, scale, p: begin + scale * load ** (1.0 / p), loads_of_means, means, (means[0], 0.1, 1.3)
    )
    sheet.check(
        "exponent of the force over the displacement from where it begins, 1.5 within 2 %",
        abs(exponent / HERTZ - 1.0) < 0.02, measured=exponent, thesis="Hertzian",
    )  # fmt: skip
    low, high = (float(rig.approach(load)) for load in (52.0, 280.0))
    sheet.check(
        "approach from 52 to 280 N within 15 % of the distance of the butterflies of fig 4.18 [um]",
        abs((high - low) / 4.55e-6 - 1.0) < 0.15, measured=1e6 * (high - low), thesis="4.55, between -0.65 and -5.2",
    )  # fmt: skip
    sheet.note(
        "calibrated: 15 um from 50 to 1100 N, with Hertz's exponent 1.5, which is found again through the noisy sensors."
        " Predicted: how much of it lies between which loads"
    )


@register_reproduction(
    "figure-4.13", "Normal stiffness over the angle: stiffening with load and speed, dependence on position",
    claim="the stiffness rises with load and with speed and depends on position; at 280 N the effect of speed is less obvious",
)  # fmt: skip
def reproduce_figure_4_13(sheet: Sheet) -> None:
    """Secant stiffness, load over displacement, over one revolution."""
    axes = sheet.make_axes(1, 2, width=11)
    means, swings = np.empty((4, len(SPEEDS))), np.empty(4)
    for row, load in enumerate(STEADY_LOADS[1:]):
        for column, speed in enumerate(SPEEDS):
            angle, gap, force = run_steady(load, speed)
            stiffness = 1e-6 * force / -gap  # N/um
            means[row, column] = stiffness.mean()
            if column in (0, 3):
                _draw_over_position(axes[1], angle, stiffness, row, column)
        swings[row] = np.ptp(np.convolve(stiffness, np.full(15, 1 / 15), "valid")) / stiffness.mean()
        axes[0].plot(SPEEDS, means[row], "o-", color=f"C{row}", label=f"{load:g} N")
    label_axes(axes[0], "speed [rad/s]", "mean of load over displacement [N/um]", "stiffening with load and speed")
    label_axes(axes[1], "angle [rad]", "load over displacement [N/um]", "position; pale: 0.8 rad/s, full: 6.4 rad/s")
    sheet.figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    sheet.check(
        "the stiffness rises with every load at every speed [N/um at 6.4 rad/s]",
        bool(np.all(np.diff(means, axis=0) > 0.0)), measured=means[:, -1], thesis="stiffening with load",
    )  # fmt: skip
    sheet.check(
        "the stiffness rises with every speed at every load [%, 0.8 to 6.4 rad/s]",
        bool(np.all(np.diff(means, axis=1) > 0.0)), measured=100.0 * (means[:, -1] / means[:, 0] - 1.0),
        thesis="velocity stiffening",
    )  # fmt: skip
    sheet.check(
        "the stiffness varies over a revolution by more than with the speed, at every load [% peak to peak]",
        bool(np.all(swings > means[:, -1] / means[:, 0] - 1.0)), measured=100.0 * swings, thesis="depends on position",
    )  # fmt: skip
    standing_out = (means[:, -1] / means[:, 0] - 1.0) / swings
    sheet.check(
        "the change with speed over that in a revolution is at 280 N smaller by a fifth or more than at 560 N",
        standing_out[0] < 0.8 * standing_out[1], measured=standing_out, thesis="less obvious at 280 N",
    )  # fmt: skip
    sheet.note(
        "the simulator's lift-up is 1 um at any load (fig 4.11 gives it only for the highest load); one that grows "
        "with the load"
        " would explain that speed shows less at 280 N, but the thesis gives no measure of it"
    )
    sheet.note(
        "the stiffness is load over displacement from first contact, a zero that the thesis does not know. Calibrated: runout"
        " of 3.5 um, lift-up of 1 um, contact of fig 4.12; the effects of speed and position follow from them"
    )


def _draw_over_position(axes: Any, angle: Array, stiffness: Array, row: int, column: int) -> None:
    turned = np.mod(angle, 2.0 * np.pi)
    order = np.argsort(turned)
    axes.plot(turned[order], stiffness[order], lw=1.2, alpha=0.4 if column == 0 else 1.0, color=f"C{row}")
