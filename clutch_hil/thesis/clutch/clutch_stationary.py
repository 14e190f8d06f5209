"""Stationary friction curves of the wet clutch and what is identified from them: figures 6.12 and 6.13, Tables 6.4 and 6.5.

Every value is a parameter of the plant. Here each is identified as in the thesis from the noisy, quantised signals of the
sensors. The 95 % interval of the fit must contain the value of the plant.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import curve_fit

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from clutch_hil.thesis.clutch.clutch_experiments import (
    PRESSURES,
    load_nominal,
    run_stationary_curves,
    stack_share,
    stribeck_depth,
)
from clutch_hil.thesis.clutch.clutch_fit import compute_interval_factor, fit, make_row, straight_line
from protocols.files.units import RPM


@dataclass(frozen=True)
class StationaryFit:
    """Fit to fig 6.12, n pressures: V_S [rad/s], gamma [-], then M_C [Nm], C_v [Nm/(rad/s)^gamma] and beta [-], n of each."""

    values: np.ndarray  # (2 + 3 n,)
    half: np.ndarray  # half widths of the 95 % intervals
    spread: np.ndarray  # covariance
    residual: float  # Nm, root mean square

    @property
    def common(self) -> np.ndarray:
        """V_S [rad/s], gamma [-]."""
        return self.values[:2]

    @property
    def parts(self) -> np.ndarray:
        """M_C, C_v, beta, (3, n)."""
        return self.values[2:].reshape(3, -1)

    @property
    def parts_half(self) -> np.ndarray:
        """Half widths of `parts`."""
        return self.half[2:].reshape(3, -1)

    @property
    def covariances(self) -> np.ndarray:
        """Covariance (3, n, n) of each of `parts` over the pressures."""
        blocks = [slice(2 + i * PRESSURES.size, 2 + (i + 1) * PRESSURES.size) for i in range(3)]
        return np.array([self.spread[block, block] for block in blocks])

    def find_parameters(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """V_S, gamma, M_C, C_v, beta (5,) at one pressure and their covariance (5, 5)."""
        chosen = [0, 1, *(2 + i * PRESSURES.size + index for i in range(3))]
        return self.values[chosen], self.spread[np.ix_(chosen, chosen)]


def stationary_torque(slip: np.ndarray, common: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Torque [Nm] of eq. 6.2, for slip (..., m) and parts (3, ...)."""
    coulomb, viscous, beta = parts[..., None]
    return coulomb * (1.0 + (beta - 1.0) * np.exp(-common[0] / slip)) + viscous * slip ** common[1]  # eq. 6.2


@cache
def fit_stationary() -> StationaryFit:
    """Fit all parameters at once, with M_C, C_v and beta free at each pressure: no law over pressure is assumed."""
    runs, n = run_stationary_curves(), PRESSURES.size
    slip, torque = (np.array([getattr(run, name) for run in runs]) for name in ("slip", "torque"))

    def compute_model(_: None, *values: float) -> np.ndarray:
        return stationary_torque(slip, np.array(values[:2]), np.reshape(values[2:], (3, n))).ravel()

    start = [10.0, 0.4, *np.full(n, 10.0), *np.full(n, 2.0), *np.full(n, 0.8)]
    values, spread = curve_fit(compute_model, None, torque.ravel(), start)
    half = compute_interval_factor(torque.size - values.size) * np.sqrt(np.diag(spread))
    residual = float(np.sqrt(np.mean((torque.ravel() - compute_model(None, *values)) ** 2)))
    return StationaryFit(values, half, spread, residual)


def compute_effective_line(name: str) -> tuple[float, float]:
    """Compute slope [1/bar] and intercept of the plant's `coulomb` or `viscous` line over the pressure of the cylinder."""
    p = load_nominal()
    share, contact = stack_share(p), p["piston.contact_pressure"].value
    slope, intercept = p[f"clutch.{name}_slope"].value, p[f"clutch.{name}_intercept"].value
    return slope * share, intercept + slope * contact * (1.0 - share)  # p* of `plant_sim.blocks.clutch`


def note_springs(sheet: Sheet) -> None:
    """Note why the plant's values over cylinder pressure differ from those of the tables."""
    sheet.note(
        f"the tables' pressure acts on the plates in the simulator's plant; over the pressure of the "
        "cylinder, which is measured, the "
        f"return springs take {1.0 - stack_share(load_nominal()):.2%} of the rise (plant_sim/blocks/piston.py): the "
        "plant's values differ by it"
    )
    sheet.note(
        "much oil (chosen here: 1e5 J/K, 1000 W/K) holds 70 degC within 0.1 K: the thesis says the parts had about 70 degC"
    )


@register_reproduction(
    "figure-6.12",
    "Stationary friction curves at 2.7 to 4.2 bar",
    claim="eq. 6.2 with gamma = 1/3 and V_S = 11.52 rad/s fits all curves; torque rises with pressure; flatter at high p",
)
def reproduce_figure_6_12(sheet: Sheet) -> None:
    """Staircase of speeds at ten pressures, and the fit of eq. 6.2."""
    runs, estimate = run_stationary_curves(), fit_stationary()
    axes = sheet.make_axes(1, 1, width=8, height=5.5)
    fine = np.linspace(1.0, 250.0, 300)
    for i, run in enumerate(runs):
        torque = stationary_torque(fine * RPM, estimate.common, estimate.parts[:, i])
        (drawn,) = axes.plot(fine, torque, lw=1.0, color=REFERENCE_COLOUR, label="fit" if i == 0 else None)
        axes.plot(run.slip / RPM, run.torque, "o", ms=3.5, color=f"C{i}")
        axes.text(254, torque[-1], f"{PRESSURES[i]:.1f} bar", va="center", fontsize=8, color=f"C{i}")
    axes.set_xlim(0, 275)
    axes.set_ylim(0, 32)
    axes.legend([drawn], ["fit of eq. 6.2; points measured"], loc="upper left", frameon=False)
    label_axes(axes, "rotational speed [rpm]", "torque [Nm]")
    torque = np.array([run.torque for run in runs])
    sheet.check("torque rises with pressure at every speed", bool(np.all(np.diff(torque, axis=0) > 0)))
    for name, k, plant, thesis in (("V_S [rad/s]", 0, 11.52, 11.52), ("gamma [-]", 1, 1 / 3, 1 / 3)):
        make_row(sheet, name, estimate.common[k], estimate.half[k], plant, thesis)
    sheet.check("the fit leaves less than the torque sensor's noise of 50 mNm [mNm]", estimate.residual < 0.05,
                1e3 * estimate.residual)  # fmt: skip
    rise = torque[:, -1] / torque[:, 1] - 1.0
    sheet.check("flatter at high pressure: relative rise from 10 to 250 rpm is smaller at 4.2 than at 2.7 bar [%]",
                rise[-1] < rise[0], 100.0 * rise[[0, -1]], "flatter shape at higher pressures (6.4.3)")  # fmt: skip
    note_springs(sheet)


@register_reproduction(
    "figure-6.13",
    "M_C, C_v and beta over piston pressure",
    claim="M_C and C_v are linear in pressure; beta falls along eq. 6.6",
)
def reproduce_figure_6_13(sheet: Sheet) -> None:
    """Parameters of each curve of fig 6.12, fitted freely at each pressure."""
    estimate = fit_stationary()
    axes = sheet.make_axes(1, 3, width=12, height=4)
    fine = np.linspace(2.4, 4.3, 200)
    laws = [fit(straight_line, PRESSURES, estimate.parts[i], (1.0, 0.0), estimate.covariances[i])[0] for i in (0, 1)]
    depth = fit(stribeck_depth, PRESSURES, estimate.parts[2], (0.7, 2.7, 0.2), estimate.covariances[2])[0]
    curves = [straight_line(fine, *laws[0]), straight_line(fine, *laws[1]), stribeck_depth(fine, *depth)]
    names = ("M_C [Nm]", "C_v [Nm/(rad/s)^(1/3)]", "beta [-]")
    for i, name in enumerate(names):
        axes[i].plot(fine, curves[i], lw=1.0, color=REFERENCE_COLOUR, label="fit")
        axes[i].errorbar(
            PRESSURES, estimate.parts[i], estimate.parts_half[i], fmt="o", ms=4, capsize=2, label="identified, 95 %"
        )
        label_axes(axes[i], "pressure [bar]", name)
        axes[i].legend(loc="upper right" if i == 2 else "upper left", frameon=False)
    for i, name in enumerate(names[:2]):
        left = np.abs(estimate.parts[i] - straight_line(PRESSURES, *laws[i])) / estimate.parts_half[i]
        sheet.check(f"{name} lies on a straight line: farthest point, in 95 % intervals", left.max() <= 1.0, left.max(),
                    "linear")  # fmt: skip
    left = np.abs(estimate.parts[2] - stribeck_depth(PRESSURES, *depth)) / estimate.parts_half[2]
    sheet.check("beta follows eq. 6.6: farthest point, in 95 % intervals", left.max() <= 1.0, left.max(), "eq. 6.6")
    beta = estimate.parts[2]
    sheet.check("beta falls from 1 at 2.7 bar to beta_inf at high pressure",
                abs(beta[0] - 1.0) <= estimate.parts_half[2, 0] and abs(beta[-1] - 0.704) <= estimate.parts_half[2, -1],
                beta, "1 to 0.704")  # fmt: skip
    note_springs(sheet)


@register_reproduction(
    "table-6.4",
    "Straight lines of M_C and C_v over pressure",
    claim="M_C = 10.8 p - 25.1 Nm and C_v = 2.67 p - 6.49 Nm/(rad/s)^(1/3), p in bar",
)
def reproduce_table_6_4(sheet: Sheet) -> None:
    """First-order fits to the points of fig 6.13, with the covariance of these points."""
    estimate = fit_stationary()
    axes = sheet.make_axes(1, 2, width=10, height=4)
    for i, (name, group, thesis) in enumerate((("M_C", "coulomb", (10.8, -25.1)), ("C_v", "viscous", (2.67, -6.49)))):
        values, half = fit(straight_line, PRESSURES, estimate.parts[i], (1.0, 0.0), estimate.covariances[i])
        plant = compute_effective_line(group)
        for k, term in enumerate(("a", "b")):
            make_row(sheet, f"{term} of {name}", values[k], half[k], plant[k], thesis[k])
        truth = straight_line(PRESSURES, *plant)
        axes[i].errorbar(PRESSURES, estimate.parts[i] - truth, estimate.parts_half[i], fmt="o", ms=4, capsize=2,
                         label="identified, 95 %")  # fmt: skip
        axes[i].plot(
            PRESSURES,
            straight_line(PRESSURES, *values) - truth,
            color=REFERENCE_COLOUR,
            lw=1.2,
            label="straight-line fit",
        )
        axes[i].plot(PRESSURES, straight_line(PRESSURES, *thesis) - truth, color="C1", ls="--", label="Table 6.4")
        unit = "Nm" if i == 0 else "Nm/(rad/s)^(1/3)"
        label_axes(axes[i], "pressure [bar]", f"{name} - plant [{unit}]")
        axes[i].legend(loc="upper left", frameon=False)
    note_springs(sheet)


@register_reproduction(
    "table-6.5",
    "Fit of beta over pressure",
    claim="beta of eq. 6.6 with beta_inf = 0.704, p_1 = 2.71 bar, p_0 = 0.158 bar",
)
def reproduce_table_6_5(sheet: Sheet) -> None:
    """Fit of eq. 6.6 to the points of fig 6.13, with the covariance of these points."""
    estimate, p = fit_stationary(), load_nominal()
    values, half = fit(stribeck_depth, PRESSURES, estimate.parts[2], (0.7, 2.7, 0.2), estimate.covariances[2])
    share, contact = stack_share(p), p["piston.contact_pressure"].value
    plant = (p["clutch.beta_inf"].value, contact + (p["clutch.beta_onset"].value - contact) / share,
             p["clutch.beta_scale"].value / share)  # fmt: skip
    for i, (name, thesis) in enumerate((("beta_inf [-]", 0.704), ("p_1 [bar]", 2.71), ("p_0 [bar]", 0.158))):
        make_row(sheet, name, values[i], half[i], plant[i], thesis)
    axes = sheet.make_axes(1, 1, width=7.5, height=4.5)
    fine = np.linspace(2.6, 4.3, 200)
    axes.plot(fine, stribeck_depth(fine, *values), color=REFERENCE_COLOUR, lw=1.2, label="fit of eq. 6.6")
    axes.plot(fine, stribeck_depth(fine, 0.704, 2.71, 0.158), color="C1", ls="--", label="Table 6.5")
    axes.errorbar(
        PRESSURES, estimate.parts[2], estimate.parts_half[2], fmt="o", ms=4, capsize=2, label="identified, 95 %"
    )
    axes.legend(frameon=False)
    label_axes(axes, "pressure [bar]", "beta [-]")
    note_springs(sheet)
