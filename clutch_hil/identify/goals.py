"""Goals: required accuracy of an identification, and whether it is reached.

Equation        half width of a map f(p; x): `thesis_quantities.Propagation`, from the intervals and their correlation
                reached: half width of the 95 % interval <= goal, for a map at every pressure of its range
                two identifications agree: their values differ by no more than sqrt(h_1^2 + h_2^2), for every goal
Assumptions     intervals are not valid for a wrong fit. So the residual must be noise, and two successive identifications,
                the second with one more run, must agree
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

from clutch_hil.bench.rig import find_rig
from clutch_hil.fitting.model import Values
from clutch_hil.identify.calibration import Calibration
from clutch_hil.identify.courses.clutch_courses import LEAST, MOST
from clutch_hil.identify.identification import Identification
from clutch_hil.identify.joint_fit import GOOD_FIT
from clutch_hil.identify.thesis_quantities import Propagation, as_covariance, compute_maps

_POINTS = 9  # number of pressures at which a map is checked


@dataclass(frozen=True)
class Goal:
    """Required accuracy of a quantity: `limit` of the half width of its 95 % interval, relative where `unit` is %.

    of: computes the quantity, or a map over the pressure (n,), from the rig's parameters. needs: parameters that must be
    identified for it.
    """

    name: str
    limit: float
    unit: str
    of: Callable[[Values], np.ndarray]
    needs: tuple[str, ...]


@dataclass(frozen=True)
class Standing:
    """State of a goal: values (n,) and half widths (n,) of its quantity, in its unit; half widths are NaN where not
    identified."""

    goal: Goal
    values: np.ndarray
    half: np.ndarray

    @property
    def worst(self) -> float:
        """Largest half width, in the unit of the goal; in percent it is infinite for a quantity that is 0."""
        if self.goal.unit != "%":
            return float(np.max(self.half))
        of_zero = np.where(np.isnan(self.half), np.nan, np.inf)
        return float(np.max(np.divide(100.0 * self.half, np.abs(self.values), out=of_zero, where=self.values != 0.0)))

    @property
    def is_reached(self) -> bool:
        """Whether the half width is within the limit."""
        return self.worst <= self.goal.limit

    def agrees_with(self, other: "Standing") -> bool:
        """Return whether the values differ by no more than sqrt(h_1^2 + h_2^2), with the half widths of both."""
        return bool(np.all(np.abs(self.values - other.values) <= np.hypot(self.half, other.half)))

    def __str__(self) -> str:
        shown = "not identified" if not np.isfinite(self.worst) else f"± {self.worst:.2g} {self.goal.unit}"
        return f"{self.goal.name} {shown} (goal {self.goal.limit:g} {self.goal.unit})"


def _list_pressures(v: Values) -> np.ndarray:
    return v["piston.contact_pressure"] + np.linspace(LEAST, MOST, _POINTS)


def _make_map_goal(row: int) -> Callable[[Values], np.ndarray]:
    """Return a function for M_C, C_v or beta over the pressures, given by its row in `compute_maps`."""
    return lambda v: compute_maps(v, _list_pressures(v))[row]


def _make_parameter_goal(name: str, factor: float = 1.0) -> Callable[[Values], np.ndarray]:
    return lambda v: np.array([factor * v[name]])


# Accuracy required by issue 31
GOALS: tuple[Goal, ...] = (
    Goal("contact pressure", 10.0, "mbar", _make_parameter_goal("piston.contact_pressure", 1e3), ("piston.contact_pressure",)),
    Goal("M_C(p)", 2.0, "%", _make_map_goal(0), ("clutch.coulomb_slope", "clutch.coulomb_intercept")),
    Goal("C_v(p)", 2.0, "%", _make_map_goal(1), ("clutch.viscous_slope", "clutch.viscous_intercept")),
    Goal("beta(p)", 2.0, "%", _make_map_goal(2), ("clutch.beta_inf", "clutch.beta_onset", "clutch.beta_scale")),
    Goal("V_S", 10.0, "%", _make_parameter_goal("clutch.stribeck_speed"), ("clutch.stribeck_speed",)),
    Goal("gamma", 10.0, "%", _make_parameter_goal("clutch.viscous_exponent"), ("clutch.viscous_exponent",)),
    Goal("C", 10.0, "%", _make_parameter_goal("clutch.attraction"), ("clutch.attraction",)),
    Goal("inertia", 2.0, "%", _make_parameter_goal("motor.inertia"), ("motor.inertia",)),
)  # fmt: skip


def stand(calibration: Calibration, goals: Sequence[Goal] = GOALS) -> list[Standing]:
    """Return the state of each of the `goals` for a calibration."""
    names = [p.name for p in calibration.parameters]
    declared = find_rig(calibration.rig).model().parameters
    values = {n: p.value for n, p in declared.items()} | {n: value for n, (value, _) in calibration.fixed.items()}
    values |= {p.name: p.value for p in calibration.parameters}
    half = np.array([p.half for p in calibration.parameters])
    known = Propagation(values, names, as_covariance(half, calibration.correlation))
    standings = []
    for goal in goals:
        value, width = known(goal.of)
        unknown = any(name not in names for name in goal.needs)
        standings.append(Standing(goal, value, np.full_like(width, np.nan) if unknown else width))
    return standings


@dataclass
class Progress:
    """Progress of successive identifications, each with one more run: whether the goals are reached and confirmed."""

    goals: Sequence[Goal] = GOALS
    _last: Sequence[Standing] | None = None
    _fits: bool = False

    def add(self, identification: Identification) -> tuple[bool, list[Standing], list[str]]:
        """Add an identification. Return whether all goals are confirmed, the state of each goal, and a sentence for each open
        point."""
        standings = stand(identification.calibration, self.goals)
        open_ = [str(one) for one in standings if not one.is_reached]
        worst = max(identification.misfit.values())
        fits = worst <= GOOD_FIT
        if not fits:
            shown = ceil(round(100.0 * worst, 6)) / 100.0  # 1.201 is not 1.2
            open_.append(f"the residual is {shown:g} times its noise, allowed is {GOOD_FIT:g}")
        if not open_ and (self._last is None or not self._fits):
            open_.append("one more run must confirm it")
        elif not open_ and self._last is not None:
            astray = [a.goal.name for a, b in zip(standings, self._last, strict=True) if not a.agrees_with(b)]
            if astray:
                open_.append(f"{', '.join(astray)} moved by more than both intervals since the last run")
        reached = all(one.is_reached for one in standings)
        self._last, self._fits = (standings, fits) if reached else (None, False)
        return not open_, standings, open_
