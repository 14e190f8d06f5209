"""Asymmetric hysteresis: two sets of elements and their two conditions, or one set with a shape function, which needs neither.

What            a set of Maxwell-slip elements for each side of a loop; whether such a pair drifts and closes its loops
Equation        after a reversal at (x_m, h_m)  up: h = h_m + 2 f_up((x - x_m)/2),  down: h = h_m - 2 f_down((x_m - x)/2)
                1. drift of a small stroke: sum k_up = sum k_down
                2. return through the extreme left: gap(d) = 2 [f_down(d/2) - f_up(d/2)] = 0 for every stroke d    (D.7)
                shaped: h = g(x) sum F_i, g > 0, one set of elements: both hold for every stroke
Assumptions     right after a reversal every element sticks (app. D.3); condition 1 is the slope of condition 2 at d = 0
Valid range     strokes up to that of the loop. For every stroke at once condition 2 needs f_up = f_down: two sets that
                differ cannot meet it, as the thesis supposes; a shaped set can
Not modelled    memory of inner loops in a pair of sets; a shaped set has all of it
References      Janssens 2010, app. D.3, figs D.5 and D.6
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import nnls

from plant_sim.friction.identification.break_points import check_break_points
from plant_sim.friction.identification.maxwell_slip import make_matrix, virgin_force
from plant_sim.friction.identification.virgin_curve import VirginCurve, check_pair
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import Array, check_real, require, require_type
from protocols.errors import InputError

TOLERANCE = 1e-6  # relative, of stiffness and height: more is a violation; chosen, far below what can be measured
CONSTRAINT_WEIGHT = 1e6  # of the constraints relative to the data; they are then met to about 1e-9 of the height
STROKE_COUNT = 400  # number of strokes at which the gap is computed; chosen
MOST_ITERATIONS = 200  # of the alternating fit; it converges in about 20


@dataclass(frozen=True)
class Condition:
    """One condition of app. D.3: whether it `holds`, by how much it is violated, and both in one sentence."""

    holds: bool
    violation: float
    statement: str


@dataclass(frozen=True)
class TwoSidedElements:
    """A set of elements for the `up`ward branches and one for the `down`ward, for strokes of at most 2 `reach` [m].

    Raises InputError.
    """

    up: MaxwellSlip
    down: MaxwellSlip
    reach: float

    def __post_init__(self) -> None:
        require_type("elements upwards", self.up, MaxwellSlip)
        require_type("elements downwards", self.down, MaxwellSlip)
        require("reach", self.reach, above=0.0, unit="m")

    def gap(self, stroke: Array | float) -> Array:
        """Return how far below the last maximum the output returns after `stroke` [m] down and up again [N], same shape."""
        half = np.asarray(stroke, float) / 2.0
        return 2.0 * (virgin_force(self.down, half) - virgin_force(self.up, half))  # D.7

    def equal_stiffness(self) -> Condition:
        """Return condition 1. Violation: drift of the output in a small cycle, by its stroke [N/m], positive upwards."""
        up, down = self.up.stiffness.sum(), self.down.stiffness.sum()
        holds = bool(abs(up - down) <= TOLERANCE * max(up, down))
        text = f"sum of stiffness {up:g} N/m upwards, {down:g} N/m downwards: "
        way = "up" if up > down else "down"
        text += (
            "small strokes do not drift" if holds else f"each metre of small stroke drifts {abs(up - down):g} N {way}"
        )
        return Condition(holds, float(up - down), text)

    def return_through_extreme(self) -> Condition:
        """Return condition 2. Violation: the gap of largest size over all strokes [N]."""
        strokes = 2.0 * self.reach * np.arange(1, STROKE_COUNT + 1) / STROKE_COUNT
        gaps = self.gap(strokes)
        worst = int(np.argmax(np.abs(gaps)))
        holds = bool(abs(gaps[worst]) <= TOLERANCE * 2.0 * virgin_force(self.up, self.reach))
        text = (
            "output returns through the extreme it left"
            if holds
            else (
                f"output returns {abs(gaps[worst]):g} N {'below' if gaps[worst] > 0 else 'above'} the maximum it left, "
                f"after a stroke of {strokes[worst]:g} m"
            )
        )
        return Condition(holds, float(gaps[worst]), text)

    def play(self, turns: Array, points: int = 100, force: float = 0.0) -> tuple[Array, Array]:
        """Return position [m] and force [N] (points (k - 1) + 1,) along `turns` [m] (k,).

        It begins in a reversal at `force`.
        """
        turns = np.asarray(turns, float)
        position, forces = [turns[:1]], [np.array([force])]
        for start, end in pairwise(turns):
            branch = start + (end - start) * np.arange(1, points + 1) / points
            side, model = (1.0, self.up) if end > start else (-1.0, self.down)
            rise = 2.0 * virgin_force(model, np.abs(branch - start) / 2.0)
            position.append(branch)
            forces.append(forces[-1][-1] + side * rise)  # D.1
        return np.concatenate(position), np.concatenate(forces)


def fit_two_sided(
    up: VirginCurve, down: VirginCurve, break_points: Array, constrained: bool = True
) -> TwoSidedElements:
    """Return a set of elements with `break_points` [m] (N,) for each side, stiffnesses of 0 or more, by least squares.

    `constrained`: equal sums of stiffness, and equal heights at the last break point, so that the whole loop closes.
    Condition 2 may still be violated at shorter strokes; `return_through_extreme` gives by how much. Raises InputError.
    """
    points = check_break_points(break_points, min(up.stroke, down.stroke))
    number = points.size
    scale = max(up.force[-1], down.force[-1])
    weight_up, weight_down = np.sqrt(np.gradient(up.position)), np.sqrt(np.gradient(down.position))
    a_up, a_down = make_matrix(up.position, points), make_matrix(down.position, points)
    rows = [
        np.hstack([weight_up[:, None] * a_up, np.zeros_like(a_up)]),
        np.hstack([np.zeros_like(a_down), weight_down[:, None] * a_down]),
    ]
    target = np.concatenate([weight_up * up.force, weight_down * down.force])
    if constrained:
        size = CONSTRAINT_WEIGHT * np.linalg.norm(target) / scale
        tied = np.vstack([np.full(number, points[0]), points])  # first break point, last break point
        rows.append(size * np.hstack([tied, -tied]))
        target = np.append(target, [0.0, 0.0])
    stiffness, _ = nnls(np.vstack(rows), target)
    both = [MaxwellSlip(k[k > 0.0], (k * points)[k > 0.0]) for k in (stiffness[:number], stiffness[number:])]
    return TwoSidedElements(both[0], both[1], float(points[-1]))


@dataclass(frozen=True)
class ShapedElements:
    """One set of `elements`, its force multiplied by g = 1 + c_1 (x/reach) + c_2 (x/reach)^2 + ...; `shape` c_1, c_2, ...

    As g depends on position alone, the memory of the elements is kept: no drift, and every loop closes (app. D.3, last
    sentence). Raises InputError unless g is positive from -`reach` to `reach` [m].
    """

    elements: MaxwellSlip
    shape: Array
    reach: float

    def __post_init__(self) -> None:
        require_type("elements", self.elements, MaxwellSlip)
        require("reach", self.reach, above=0.0, unit="m")
        object.__setattr__(self, "shape", check_real("shape", self.shape))
        if self.shape.ndim != 1:
            raise InputError(f"shape has shape {self.shape.shape}; it must be a vector, of c_1, c_2 and so on")
        lowest = self.factor(np.linspace(-self.reach, self.reach, STROKE_COUNT)).min()
        if not lowest > 0.0:
            raise InputError(
                f"shape function falls to {lowest:g} between {-self.reach:g} and {self.reach:g} m; it must be above 0"
            )

    def factor(self, position: Array) -> Array:
        """Return g [-] at `position` [m], same shape; beyond the reach it keeps its value."""
        return 1.0 + _compute_powers(position, self.reach, len(self.shape)) @ self.shape

    def force(self, position: Array) -> Array:
        """Return the force [N] (n,) along `position` [m] (n,), beginning at rest."""
        return self.factor(position) * self.elements.trace(position, 1.0).force


def fit_shaped(position: Array, force: Array, break_points: Array, degree: int = 2) -> ShapedElements:
    """Return the elements with `break_points` [m] (N,) and a shape of `degree` for a record `position` [m], `force` [N] (n,).

    The record begins at rest. Least squares, elements and shape in turn: the problem is linear in each. Raises InputError.
    """
    position, force = check_pair(position, force, "record")
    points = check_break_points(break_points, float(np.ptp(position)))
    reach = float(np.abs(position).max())
    unit = MaxwellSlip(np.ones(points.size), points).trace(position, 1.0).state  # of stiffness 1
    powers = _compute_powers(position, reach, degree)
    shape = np.zeros(degree)
    for _ in range(MOST_ITERATIONS):
        stiffness, _ = nnls((1.0 + powers @ shape)[:, None] * unit, force)
        inner = unit @ stiffness
        before, shape = shape, np.linalg.lstsq(inner[:, None] * powers, force - inner, rcond=None)[0]
        if np.abs(shape - before).max() < TOLERANCE * 1e-3:
            break
    positive = stiffness > 0.0
    return ShapedElements(MaxwellSlip(stiffness[positive], (stiffness * points)[positive]), shape, reach)


def _compute_powers(position: Array, reach: float, degree: int) -> Array:
    place = np.clip(np.asarray(position, float)[..., None] / reach, -1.0, 1.0)  # beyond the reach g keeps its value
    return place ** np.arange(1, degree + 1)
