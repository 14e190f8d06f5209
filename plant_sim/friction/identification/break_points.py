"""Where the elements of a Maxwell-slip model start to slip: break points placed on a virgin curve.

What            N positions 0 < x_1 < ... < x_N; the last is where the curve saturates, or ends
Equation        number of break points per length proportional to |f''|^exponent                               (app. D.2)
Assumptions     between break points the model is a straight line
Not modelled    scatter of the curve: make a curve of a noisy record by `virgin_curve.from_loops` first
References      Janssens 2010, app. D.2; exponent 1/2: de Boor 1973, good approximation by splines with variable knots
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from plant_sim.friction.identification.virgin_curve import VirginCurve
from plant_sim.friction.model import Array, check_real, require
from plant_sim.friction.whole_number import require_whole
from protocols.errors import InputError


class Spacing(Protocol):
    """A rule that places `number` break points on a curve: (number,) [m]. Raises InputError."""

    def place(self, curve: VirginCurve, number: int) -> Array: ...


@dataclass(frozen=True)
class EqualSpacing:
    """Break points equidistant up to saturation: the simple choice."""

    def place(self, curve: VirginCurve, number: int) -> Array:
        """Break points (number,) [m]. Raises InputError."""
        require_whole("number of break points", number)
        return curve.saturation * np.arange(1, number + 1) / number


@dataclass(frozen=True)
class CurvatureSpacing:
    """Distance of break points inversely proportional to |f''|^`exponent`; 1 is the thesis's rule. Raises InputError.

    With 1 each element gets the same stiffness. With 1/2 each straight piece makes the same error, so that the largest error
    is the smallest for many elements.
    """

    exponent: float = 1.0

    def __post_init__(self) -> None:
        require("exponent of the curvature", self.exponent, above=0.0, most=1.0)

    def place(self, curve: VirginCurve, number: int) -> Array:
        """Break points (number,) [m]. Raises InputError."""
        require_whole("number of break points", number)
        end = curve.saturation
        middle = (curve.position[:-1] + curve.position[1:]) / 2.0
        inside = middle < end
        edges = np.concatenate(([0.0], middle[inside], [end]))
        slope = curve.slope[inside]
        bend = np.abs(np.concatenate(([0.0], np.diff(slope), [0.0])))
        density = (bend / np.diff(edges)) ** self.exponent  # 1/distance
        share = np.concatenate(([0.0], np.cumsum(density * np.diff(edges))))
        if share[-1] == 0.0:
            # a straight line up to saturation: no place is better than another
            return EqualSpacing().place(curve, number)
        rising = np.append(True, np.diff(share) > 0.0)
        targets = share[-1] * np.arange(1, number) / number
        return np.append(np.interp(targets, share[rising], edges[rising]), end)


def check_break_points(break_points: Array, stroke: float) -> Array:
    """Return `break_points` [m] (N,) as a float64 vector, rising, inside 0 to `stroke` [m]. Raises InputError."""
    points = np.atleast_1d(check_real("break points", break_points))
    if points.ndim != 1 or points.size == 0:
        raise InputError(f"break points have shape {points.shape}; one or more are needed, in one dimension")
    if points[0] <= 0.0 or (np.diff(points) <= 0.0).any():
        raise InputError("break points do not rise; each must be larger than the one before, the first larger than 0 m")
    if points[-1] > stroke * (1.0 + 1e-12):
        raise InputError(f"break point {points[-1]:g} m is beyond the virgin curve, which ends at {stroke:g} m")
    return points
