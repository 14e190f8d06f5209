"""The virgin curve of a hysteresis: the force at the first loading from rest, computed from measured loops.

What            one half of a loop, or all the loops of a noisy record, reduced to the curve that makes them
Equation        h(x) = h_m + 2 f((x - x_m)/2) after a reversal at (x_m, h_m), f odd                               (D.1)
Assumptions     Masing's rules: both halves of a loop are the virgin curve, twice as large; no rate dependence
Valid range     strokes up to the widest loop measured
Not modelled    drift of the force within one stroke; noise of the position widens the stroke by about its peak value
References      Janssens 2010, app. D.2, figs D.1 and D.2; Masing 1926
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from scipy.optimize import nnls

from plant_sim.friction.model import Array, check_real, require
from plant_sim.friction.whole_number import require_whole
from protocols.errors import InputError

DEAD_BAND = 0.05  # of the position's range: a smaller turn is noise; chosen: ten times the noise of a good encoder
FULL_STROKE = 0.95  # of the widest stroke: shorter ones are inner loops or cut off by the record; chosen
LEAST_POINTS = 2  # of a fitted curve: a single point does not show how the curve bends
BINS = 10  # number of parts of the stroke whose mean forces must not fall; chosen
LARGEST_FALL = 0.05  # of the height of the curve: a larger fall is not noise; chosen


@dataclass(frozen=True)
class VirginCurve:
    """Virgin curve through `position` [m] (n,), rising from 0, and `force` [N] (n,), from 0 and never falling.

    Raises InputError.
    """

    position: Array
    force: Array

    def __post_init__(self) -> None:
        position, force = check_pair(self.position, self.force, "virgin curve")
        if position[0] != 0.0 or force[0] != 0.0:
            raise InputError(f"virgin curve begins at ({position[0]:g}, {force[0]:g}); it must begin at (0, 0)")
        if (i := _find_first(np.diff(position) <= 0.0)) is not None:
            raise InputError(f"position of the virgin curve does not rise after {position[i]:g} m; each must be larger")
        if (i := _find_first(np.diff(force) < 0.0)) is not None:
            raise InputError(
                f"virgin curve falls from {force[i]:g} to {force[i + 1]:g} N after {position[i]:g} m; it must never fall"
            )
        if force[-1] == 0.0:
            raise InputError("virgin curve is 0 N everywhere; the force must rise")
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "force", force)

    @property
    def stroke(self) -> float:
        """The last position [m], half the stroke of the loop it was cut from."""
        return float(self.position[-1])

    @property
    def saturation(self) -> float:
        """Position [m] at which the curve reaches its final height."""
        return float(self.position[np.argmax(self.force >= self.force[-1] * (1.0 - 1e-9))])

    @property
    def slope(self) -> Array:
        """Stiffness between neighbouring points [N/m] (n - 1,)."""
        return np.diff(self.force) / np.diff(self.position)

    def __call__(self, position: Array | float) -> Array:
        """Return the force [N] at `position` [m], same shape; odd, linear between the points.

        Raises InputError beyond the stroke.
        """
        position = check_real("position [m]", position)
        reach = float(np.max(np.abs(position), initial=0.0))
        if not reach <= self.stroke * (1.0 + 1e-12):
            raise InputError(f"position {reach:g} m is beyond the virgin curve, which ends at {self.stroke:g} m")
        return np.sign(position) * np.interp(np.abs(position), self.position, self.force)  # D.1

    def branch(self, position: Array, from_position: float, from_force: float) -> Array:
        """Return the force [N] (n,) at `position` [m] (n,) after a reversal at (`from_position`, `from_force`)."""
        return from_force + 2.0 * self((np.asarray(position, float) - from_position) / 2.0)  # D.1


def from_half_loop(position: Array, force: Array) -> VirginCurve:
    """Return the virgin curve of one branch between two reversals, `position` [m] (n,) and `force` [N] (n,), either way.

    The first sample is the reversal. For a clean branch; noise belongs to `from_loops`. Raises InputError.
    """
    position, force = check_pair(position, force, "half loop")
    side = np.sign(position[-1] - position[0])
    if side == 0.0 or not (np.diff(position) * side > 0.0).all():
        raise InputError("position of the half loop reverses or rests; one branch between two reversals is needed")
    return VirginCurve(side * (position - position[0]) / 2.0, side * (force - force[0]) / 2.0)  # D.1


def from_loops(position: Array, force: Array, points: int = 60, side: int = 0) -> VirginCurve:
    """Return the virgin curve of a noisy record of loops, `position` [m] (n,) and `force` [N] (n,), on `points` positions.

    The record is cut at its reversals; the strokes of full width are fitted together by least squares with a curve that
    rises ever more slowly, as that of any Maxwell-slip elements does, each stroke with an offset of its own.
    `side` 1 takes the upward strokes only (upper left half of the loop), -1 the downward ones, 0 both.
    Raises InputError.
    """
    position, force = check_pair(position, force, "record")
    require_whole("number of points", points, least=LEAST_POINTS)
    if side not in (-1, 0, 1):
        raise InputError(f"side is {side!r:.60}; allowed is 1 (upward strokes), -1 (downward) or 0 (both)")
    strokes = _find_full_strokes(position, side)
    reach = min(abs(position[b] - position[a]) for a, b in strokes) / 2.0
    grid = reach * (np.arange(1, points + 1) / points) ** 2  # finer near the reversal, where friction curves bend most
    columns, heights, paths = [], [], []
    for a, b in strokes:
        sense = np.sign(position[b] - position[a])
        path = np.clip(sense * (position[a : b + 1] - position[a]) / 2.0, 0.0, reach)  # D.1
        column = np.minimum.outer(path, grid)  # D.2
        height = sense * force[a : b + 1] / 2.0  # D.1
        columns.append(column - column.mean(axis=0))
        heights.append(height - height.mean())
        paths.append(path)
    samples, height = np.vstack(columns), np.concatenate(heights)
    if len(samples) < 3 * points:
        raise InputError(
            f"record has {len(samples)} samples in full strokes; {points} points need {3 * points} or more"
        )
    q, r = np.linalg.qr(samples)
    stiffness, _ = nnls(r, q.T @ height)
    curve = np.append(0.0, np.minimum.outer(grid, grid) @ stiffness)  # D.3
    path = np.concatenate(paths)
    _refuse_falling(path, np.minimum.outer(path, grid) @ stiffness + height - samples @ stiffness)
    return VirginCurve(np.append(0.0, grid), np.maximum.accumulate(curve))


def check_pair(position: Array, force: Array, name: str, least: int = 3) -> tuple[Array, Array]:
    """Return `position` and `force` as float64 vectors of one length, `least` or more, finite. Raises InputError."""
    position, force = check_real(f"position of the {name}", position), check_real(f"force of the {name}", force)
    if position.ndim != 1 or position.shape != force.shape:
        raise InputError(
            f"{name} has positions {position.shape} and forces {force.shape}; they must be vectors of equal length"
        )
    if position.size < least:
        raise InputError(f"{name} has {position.size} points; {least} or more are needed")
    return position, force


def find_reversals(position: Array, dead_band: float = DEAD_BAND) -> Array:
    """Return the samples at which `position` [m] (n,) turns, int (k,); turns smaller than `dead_band` of its range are noise.

    Raises InputError.
    """
    position = check_real("position", position)
    if position.ndim != 1 or position.size < 1:
        raise InputError(f"position has shape {position.shape}; one value or more in one dimension is needed")
    require("dead band", dead_band, least=0.0, most=1.0)
    return _find_reversals(position, dead_band * float(np.ptp(position)))


@njit(cache=True)
def _find_reversals(position, dead_band):
    reversals = np.empty(position.size, np.int64)
    count = 0
    low = high = extreme = 0
    sense = 0
    for i in range(position.size):
        if sense == 0:
            if position[i] < position[low]:
                low = i
            if position[i] > position[high]:
                high = i
            if position[high] - position[low] > dead_band:
                sense = 1 if high > low else -1
                extreme = i
        elif sense * (position[i] - position[extreme]) > 0.0:
            extreme = i
        elif sense * (position[extreme] - position[i]) > dead_band:
            reversals[count] = extreme
            count += 1
            sense, extreme = -sense, i
    return reversals[:count]


def _find_full_strokes(position: Array, side: int) -> list[tuple[int, int]]:
    """Return the first and last sample of every stroke of full width."""
    turns = find_reversals(position)
    if turns.size == 0:
        raise InputError("record has no reversal of the position; one loop or more is needed")
    ends = np.concatenate(([0], turns, [position.size - 1]))
    strokes = [(int(a), int(b)) for a, b in pairwise(ends) if b > a]
    width = max(abs(position[b] - position[a]) for a, b in strokes)
    strokes = [(a, b) for a, b in strokes if abs(position[b] - position[a]) >= FULL_STROKE * width]
    strokes = [(a, b) for a, b in strokes if side == 0 or np.sign(position[b] - position[a]) == side]
    if not strokes:
        raise InputError(f"record has no full stroke {'upwards' if side > 0 else 'downwards'}; one or more is needed")
    return strokes


def _refuse_falling(path: Array, force: Array) -> None:
    """Raise InputError if the samples, averaged in BINS of the path, fall by more than noise can make them."""
    edges = np.linspace(0.0, path.max(), BINS + 1)[1:-1]
    member = np.searchsorted(edges, path)
    mean = np.bincount(member, force, BINS) / np.maximum(np.bincount(member, minlength=BINS), 1)
    fall = np.maximum.accumulate(mean) - mean
    if fall.max() > LARGEST_FALL * abs(mean).max():
        raise InputError(
            f"measured virgin curve falls by {fall.max():g} N towards {path.max():g} m, which no Maxwell-slip elements do; "
            f"allowed is {LARGEST_FALL:.0%} of its height {abs(mean).max():g} N"
        )


def _find_first(wrong: Array) -> int | None:
    return int(np.argmax(wrong)) if wrong.any() else None
