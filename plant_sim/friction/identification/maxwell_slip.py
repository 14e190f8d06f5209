"""Maxwell-slip elements from a virgin curve.

What            stiffness k_i and limit W_i of N elements whose model runs through the curve at N break points
Equation        A k = b,  A_ij = x_min(i,j),  b_i = f(x_i),  W_i = k_i x_i                              (D.2 to D.6)
Assumptions     symmetric hysteresis; two sides that differ: `asymmetric`
Valid range     up to the last break point; an element that never slips carries the slope of the curve beyond the last but one
Not modelled    rate dependence
References      Janssens 2010, app. D.2, figs D.3 and D.4; non-negative least squares: Lawson and Hanson 1974, ch. 23
"""

import numpy as np
from scipy.optimize import nnls

from plant_sim.friction.identification.break_points import check_break_points
from plant_sim.friction.identification.virgin_curve import VirginCurve
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import Array, check_real, require
from protocols.errors import InputError

LEAST_STIFFNESS = 1e-9  # of the whole stiffness: an element with less is rounding, and is left out


def make_matrix(position: Array, break_points: Array) -> Array:
    """Return the matrix A (n, N) [m]: the force at `position` [m] (n,) of elements with unit stiffness.

    The elements slip at `break_points` [m] (N,).
    """
    return np.minimum.outer(np.asarray(position, float), np.asarray(break_points, float))  # D.3


def virgin_force(model: MaxwellSlip, position: Array | float) -> Array:
    """Return the force of `model` [N] when first loaded from rest to `position` [m] of 0 or more, same shape.

    Raises InputError.
    """
    positions = check_real("position", position)
    require("least position", float(positions.min(initial=0.0)), least=0.0, unit="m")
    sticking = np.multiply.outer(positions, model.stiffness)
    return np.minimum(sticking, model.limits).sum(axis=-1)  # D.2


def solve(curve: VirginCurve, break_points: Array, saturating: bool = True) -> MaxwellSlip:
    """Return the elements whose virgin curve runs through `curve` at each of `break_points` [m] (N,).

    Not `saturating`: the last element never slips, its limit is infinite. Elements without stiffness are left out.
    Raises InputError, also where the curve bends upwards, which no element does.
    """
    points = check_break_points(break_points, curve.stroke)
    stiffness = np.linalg.solve(make_matrix(points, points), curve(points))  # D.3 to D.5
    worst = int(np.argmin(stiffness))
    if stiffness[worst] < -LEAST_STIFFNESS * np.abs(stiffness).sum():
        raise InputError(
            f"element {worst + 1} would have a stiffness of {stiffness[worst]:g} N/m, as the virgin curve bends upwards at "
            f"its break point {points[worst]:g} m; allowed are stiffnesses above 0: use the least-squares fit"
        )
    return _make_model(stiffness, points, saturating)


def fit(curve: VirginCurve, break_points: Array, saturating: bool = True) -> MaxwellSlip:
    """Return the elements with stiffness of 0 or more that come nearest to `curve` over its whole stroke, in least squares.

    `break_points` [m] (N,) as given; not `saturating` makes the last element one that never slips. Elements without stiffness
    are left out. Raises InputError.
    """
    points = check_break_points(break_points, curve.stroke)
    weight = np.sqrt(np.gradient(curve.position))[:, None]  # a dense part of the curve counts no more than its length
    columns = make_matrix(curve.position, points if saturating else np.append(points[:-1], curve.stroke))
    stiffness, _ = nnls(weight * columns, weight[:, 0] * curve.force)
    return _make_model(stiffness, points, saturating)


def compute_error(model: MaxwellSlip, curve: VirginCurve) -> float:
    """Return the largest difference of the virgin curve of `model` and `curve` [N]."""
    return float(np.abs(virgin_force(model, curve.position) - curve.force).max())


def _make_model(stiffness: Array, points: Array, saturating: bool) -> MaxwellSlip:
    limits = stiffness * points  # D.6
    if not saturating:
        limits[-1] = np.inf
    stiff = stiffness > LEAST_STIFFNESS * stiffness.sum()
    return MaxwellSlip(stiffness[stiff], limits[stiff])
