"""Stick stiffness: slope of the torque over the angle of sticking plates, from runs in which they stop under a load.

Equation        at rest theta = theta_0 + b M/M_C(p),  k = M_C(p)/b                       eq. 6.9 at rest: dF/dt = k omega
                least squares of theta (equal weights) over all stretches, each with its own theta_0
                half width = t(0.975, n - 1) times the standard deviation of b over n stretches (jackknife), and 5 % of b for
                  the level of the limits, added in quadrature
                a stretch: in contact, |omega| < 0.3 rad/s, |M| < 0.5 M_C(p), for 10 ms or longer, M changes by 1 Nm or more
Assumptions     up to half of M_C no asperity exceeds its limit; the stiffness is proportional to the load, like M_C
Not modelled    elements that break away one after the other: `presliding` of the catalogue has four
References      Janssens 2010, sec. 5.2, eq. 6.9
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t

from clutch_hil.fitting.model import Columns, Values
from clutch_hil.identify.clutch_effects import PRESSURE, SPEED, TORQUE
from clutch_hil.identify.stepwise import estimate_contact_torque
from clutch_hil.identify.thesis_quantities import MIDDLE, Quantity, compute_maps

# rad/s, largest slip in means over _MEAN: a spring of 5000 Nm/rad loaded with 150 Nm/s turns at 0.03 rad/s
_RESTS = 0.3
_MEAN = 5e-3  # s, averaging time of the slip: one encoder count in 1 ms is 0.04 rad/s
_SHARE = 0.5  # largest share of M_C of plates at rest
_LEAST_SECONDS = 0.01  # s, shortest stretch
# Relative error of b: M_C is used for the limits of sliding, which are M_C s_n, and s_n is 0.9 to 1 at the slips before
_LEVEL_ERROR = 0.05
_COUNT = 2.0 * np.pi / 163840  # rad, count of the encoder: docs/rig.md, 9
_LEAST_STRETCHES = 3  # least number of stretches for a standard deviation


@dataclass(frozen=True)
class Stick:
    """Result: `quantity` is the stick stiffness at the middle pressure, None if not identified; `warning` is the reason,
    or ""."""

    quantity: Quantity | None
    warning: str = ""


def measure_stick(runs: Sequence[Columns], values: Values) -> Stick:
    """Measure the stick stiffness in `runs`. values: identified parameters and offsets of the clutch, by dotted name."""
    stretches = [one for run in runs for one in _list_stretches(run, values)]
    count = len(stretches)
    if count < _LEAST_STRETCHES:
        return Stick(
            None,
            f"the stick stiffness needs plates at rest under a changing torque; these runs have {count} such"
            f" stretches, {_LEAST_STRETCHES} are needed: play the experiment reversals",
        )
    best = _fit(stretches)
    without = np.array([_fit(stretches[:k] + stretches[k + 1 :]) for k in range(count)])
    deviation = np.sqrt((count - 1) / count * np.sum((without - without.mean()) ** 2))
    half = float(np.hypot(t.ppf(0.975, count - 1) * deviation, _LEVEL_ERROR * best))
    middle = values["piston.contact_pressure"] + MIDDLE
    limit = float(compute_maps(values, np.array([middle]))[0, 0])
    resolution = _COUNT / _SHARE
    if best <= max(half, resolution):
        return Stick(
            None,
            f"plates at rest turn by no more than the encoder resolves: the stick stiffness is above"
            f" {limit / max(best + half, resolution):.2g} Nm/rad at {middle:.3g} bar",
        )
    stiffness = limit / best
    return Stick(
        Quantity(
            "stick stiffness", stiffness, stiffness * half / best, "Nm/rad", "eq. 6.9", f"{middle:.3f} bar, at rest"
        )
    )


def _list_stretches(run: Columns, values: Values) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return angle [rad] and M/M_C(p) [-], (n,) each, of every stretch in which the plates stick."""
    period = float(run["time_s"][1] - run["time_s"][0])
    width = max(1, round(_MEAN / period))
    slip = np.convolve(run["slip_speed_rad_s"] - values.get(SPEED, 0.0), np.full(width, 1.0 / width), mode="same")
    pressure = run["cylinder_pressure_bar"] - values.get(PRESSURE, 0.0)
    torque = run["clutch_torque_nm"] - values.get(TORQUE, 0.0)
    limit, least_change = compute_maps(values, pressure)[0], estimate_contact_torque([run])
    rests = (np.abs(slip) < _RESTS) & (np.abs(torque) < _SHARE * limit) & (pressure > values["piston.contact_pressure"])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rests, [False]]).astype(int)))
    stretches = []
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        rows = slice(first, end)
        if (end - first) * period >= _LEAST_SECONDS and np.ptp(torque[rows]) >= least_change:
            stretches.append((run["shaft_angle_rad"][rows], torque[rows] / limit[rows]))
    return stretches


def _fit(stretches: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Fit b [rad] by least squares; each stretch has its own angle at zero torque."""
    angle, share = (np.concatenate([one[k] - one[k].mean() for one in stretches]) for k in (0, 1))
    return float(angle @ share / (share @ share))
