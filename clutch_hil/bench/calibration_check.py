"""Calibration check: whether a controller's estimate of the torque is that of another clutch than the one that it runs.

Equation        d = mean of sign(slip) (M - estimate) in slip control; M = M_m - J alpha as the controller observes it. Of two
                  clutches M = M_m: a torque that only turns the inertia averages out
                another clutch: |d| > max(0.1 mean |M|, 0.5 Nm). The shipped calibration had up to 0.050 on the plants of
                  Table 6.6, which are its own clutch with small differences
                off: |d| > max(0.02 mean |M|, 0.1 Nm), on a rig of one clutch. A controller that knows its rig had at most
                  0.0011 on 50 rigs drawn within 30 %; the shipped one has 0.014 on the nominal rig, whose springs it leaves out
Assumptions     the motor's torque is measured well, where another clutch is told
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from clutch_hil.bench.measures import is_in_phase
from protocols.can.two_clutches import CLUTCHES, CONTROLLERS

_OTHER = (0.1, 0.5)  # of the mean torque of the motor, and Nm: another clutch; see Equation
_OFF = (0.02, 0.1)  # the same: calibration or sensor is off
_LEAST_SAMPLES = 100  # in slip control: fewer are a touch
_OR = "or the clutch has changed; see clutch-hil identify"


@dataclass(frozen=True)
class _Gap:
    """Mean torque [Nm] that was given by `what`, and how far it is `off` the estimate [Nm]."""

    what: str
    off: float
    mean: float

    def exceeds(self, limit: tuple[float, float]) -> bool:
        """Whether it is off by more than a share of the mean, and by more than a torque [Nm]."""
        return abs(self.off) > max(limit[0] * self.mean, limit[1])

    def __str__(self) -> str:
        return f"{self.what} gave {self.mean:.1f} Nm on average, {abs(self.off):.2g} Nm {'more' if self.off > 0.0 else 'less'}"


def describe_mismatch(columns: Mapping[str, np.ndarray]) -> str | None:
    """A sentence where motor and estimate differ as with another clutch; None where they do not, or it cannot be known."""
    given = "motor and inertia", columns["controller_observed_torque_nm"]
    gap = _compare(columns, is_in_phase(columns, "slip control"), given, "controller", "slip_speed_rad_s")
    if gap is None or not gap.exceeds(_OFF):
        return None
    if gap.exceeds(_OTHER):
        return f"{gap} than the controller estimated: its calibration is of another clutch, {_OR}"
    share = 100.0 * abs(gap.off) / gap.mean
    return (
        f"{gap} than the controller estimated, {share:.1f} %: its calibration or the torque sensor is off;"
        " see clutch-hil identify"
    )


def describe_shift_mismatch(columns: Mapping[str, np.ndarray]) -> str | None:
    """As `describe_mismatch`, of a rig of two clutches: of each, in the time in which it alone is in slip control."""
    sliding = [is_in_phase(columns, "slip control", name) for name in CONTROLLERS]
    for clutch, name, own, other in zip(CLUTCHES, CONTROLLERS, sliding, reversed(sliding), strict=True):
        given = "the motor", columns["motor_torque_nm"]
        gap = _compare(columns, own & ~other, given, name, f"slip_speed_{clutch}_rad_s")
        if gap is not None and gap.exceeds(_OTHER):
            return f"on clutch {clutch} alone {gap} than its controller estimated: its calibration is of another clutch, {_OR}"
    return None


def _compare(
    columns: Mapping[str, np.ndarray], sliding: np.ndarray, given: tuple[str, np.ndarray], controller: str, slip: str
) -> _Gap | None:
    """How far a given torque, by name, and the estimate differ where the clutch slides; None where it hardly does."""
    if np.count_nonzero(sliding) < _LEAST_SAMPLES:
        return None
    torque, estimate = (values[sliding] for values in (given[1], columns[f"{controller}_torque_estimate_nm"]))
    off = float(np.mean(np.sign(columns[slip][sliding]) * (torque - estimate)))
    return _Gap(given[0], off, float(np.mean(np.abs(torque))))
