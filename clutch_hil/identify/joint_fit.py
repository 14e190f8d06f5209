"""Joint fit: all parameters that the runs excite, in one simulation-error fit, with 95 % intervals.

Equation        fit.py without prior. Sensitivities by one-sided differences over 0.2 units of moves, then by central
                  differences over 0.05 and over 0.003 units, updated until the cost no longer falls. The torque sets in at a
                  pressure and at a slip, so it has kinks in several parameters. Differences over 0.05 alone were up to
                  78 % wrong: the fit ended 26 above its least cost, 2.4 half widths away. With those over 0.003 alone the
                  fit stopped at a kink
                jump of a few residuals, as where plates touch one sample earlier: the central difference of a jump j is j/2d
                  over +-d and j/4d over +-2d, so twice the second minus the first is free of it. The smallest of the three
                  values is used. One residual of 1e5 had made the interval of the contact pressure 15 times too narrow
                h = 1.96 max(cluster-robust standard deviation, clusters of 1 s, times sqrt(k/(k - p)) for k clusters;
                  standard deviation for white residuals of the size of those of the fit)
                h is the larger of the values with sensitivities over 0.003 and over 0.05. Rows in which plates touch or
                  separate jump, and seem more informative than they are with sensitivities over 0.003: for the hydraulics of
                  one rig (benchmarks/identification.py, 49) these varied by a factor of 2.3 where the step varied by 1e-4,
                  and 10 of its 26 intervals missed the true value
                half width = sqrt(h^2 + d^2), d: change of the parameter with a four times finer integration
                sigma of an output whose residuals have a robust standard deviation above 1.2 times its noise is that
                  deviation, so that errors of its model or recording do not outweigh the other outputs. A torque smoothed
                  over 20 ms made M_C 17 % too steep, with this weighting 0.2 %
                outliers: residuals beyond 6 robust standard deviations of their output are left out of the second pass
                a parameter that the runs hardly excite has a prior, whose standard deviation is its scale
Assumptions     residuals in the same second are correlated, those in different seconds are not
References      Marquardt 1963, J. SIAM 11; White 1980, Econometrica 48; MacKinnon and White 1985, J. Econometrics 29 (small
                samples)
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import FreeParameter, LinearModel, linearise, refit
from clutch_hil.fitting.intervals import NORMAL_95, split_clusters
from protocols.errors import InputError

# Factors of the difference step, used in this order: the long steps average over kinks, so that the fit crosses them; the short
# ones resolve them
_MIDDLE, _SHORTER = 0.25, 1.0 / 64.0
# Number of largest residuals, and largest share of a parameter's squared sensitivity that they may have. A larger share
# indicates a jump; 0.2 is usual without one
_FEW, _MOST_OF_FEW = 5, 0.3
# s left out at the beginning, three times k_p/k_i of the motor's regulator; largest share of a short run
_BEGINNING, _MOST_BEGINNING = 0.3, 0.1
_MOST_ROUNDS = 30  # linearisations; 2 to 5 are usual, 15 where short runs hardly excite some parameters
_MOST_POLISHED = 4  # steps with the last sensitivities: the first one brings nearly all of the gain
# Damping weights that are tried, per squared unit of moves (Levenberg and Marquardt): in a curved valley the undamped step
# leads out of it
_DAMPINGS = (0.0, 0.1, 1.0, 10.0, 1e2, 1e3, 1e4)
_LEAST_GAIN = 1.0  # least gain of the cost in a round: a third of the cost of a move by one standard deviation
GOOD_FIT = 1.2  # ratio of residual to noise up to which a fit is good: noise alone gives 1.02 (docs/identify_method.md)
_MOST_WEIGHINGS = 6  # rounds of re-weighting the outputs by their residuals: one or two are usual
_OUTLIER = 6.0  # robust standard deviations: noise exceeds it once in 5e8
_MAD_TO_SIGMA = 1.4826  # standard deviation over median absolute deviation


@dataclass(frozen=True)
class JointFit:
    """Result of a joint fit.

    at: linear model at the end of the fit. half (p,): half widths of the 95 % intervals. correlation (p, p): of the parameters.
    left_out: number of outliers. evidence: without the outliers. moved (p,): change of each parameter by the finer integration.
    broad (size, p): sensitivities over longer steps, for the intervals.
    """

    at: LinearModel
    half: np.ndarray
    correlation: np.ndarray
    left_out: int
    evidence: Evidence
    moved: np.ndarray
    broad: np.ndarray

    def hold(self, names: Collection[str], point: Point) -> "JointFit":
        """Return the fit with the parameters `names` held at their values in `point`, refitted with the same sensitivities."""
        kept = [k for k, f in enumerate(self.at.free) if f.name not in names]
        held = {f.name for f in self.at.free if f.name in names}
        parameters, effects = (
            {n: point[i][n] if n in held else v for n, v in self.at.point[i].items()} for i in (0, 1)
        )
        begin = LinearModel(
            (parameters, effects), tuple(self.at.free[k] for k in kept),
            self.evidence.compute_residuals([(parameters, effects)])[0], self.at.jacobian[:, kept], self.at.redundancy,
        )  # fmt: skip
        at = _polish(self.evidence, begin)
        broad = self.broad[:, kept]
        half, correlation = _compute_intervals(self.evidence, at, broad)
        moved = self.moved[kept]
        return replace(self, at=at, half=np.hypot(half, moved), correlation=correlation, moved=moved, broad=broad)


def fit_jointly(
    coarse: Evidence, fine: Evidence, start: Point, free: Sequence[FreeParameter], progress: Callable[[float], None]
) -> JointFit:
    """Fit with the fast model of `coarse`, then with the accurate model of `fine`. progress is called with the completed share.

    The first 0.3 s of each run are left out: the initial state of the motor is no property of the rig, and would cause a false
    offset. Raises InputError if the model gives non-finite values at `start`.
    """
    coarse, fine = (one.leave_out(_find_beginnings(one)).take_as_independent() for one in (coarse, fine))
    before = int(np.count_nonzero(fine.weights == 0.0))
    if not np.isfinite(coarse.compute_residuals([start])[0]).all():
        values = {**start[0], **start[1]}
        ends = [f"{f.name} = {values[f.name]:g}" for f in free if values[f.name] in (f.low, f.high)]
        at_bounds = f", of which these are at their bounds: {', '.join(ends)}" if ends else ""
        raise InputError(
            f"with the start values of the fit the model gives no finite numbers{at_bounds}; check the units in the import"
            " map, --hold and --bounds"
        )
    rough = [fit_roughly(coarse, start, free, lambda share: progress(0.5 * share))]
    # With the roughly known parameters free, the fit may drift along a valley
    if any(f.centre is not None for f in free):
        rough.append(fit_roughly(coarse, start, [f for f in free if f.centre is None]))
    at = min(rough, key=lambda one: one.cost)
    progress(0.6)
    noise = _find_noise(coarse, at)
    if max(noise.values()) > 1.0:
        coarse, fine = (one.with_noise(noise) for one in (coarse, fine))
        at = fit_roughly(coarse, at.point, free)
        rough = [at]
    limits = _compute_outlier_limits(coarse, at.residual)
    coarse, fine = (one.leave_out(np.abs(one.compute_residuals([at.point])[0]) > limits) for one in (coarse, fine))
    left_out = int(np.count_nonzero(fine.weights == 0.0)) - before
    middle, stepped = [replace(f, step=_MIDDLE * f.step) for f in free], [shorten_step(f) for f in free]
    settled = min((settle(coarse, one.point, middle) for one in rough), key=lambda one: one.cost)
    quick = settle(coarse, settled.point, stepped)
    progress(0.7)
    at = _polish(fine, linearise_past_jumps(fine, quick.point, stepped))
    far = linearise_past_jumps(fine, at.point, middle, at.residual)
    broad = far.jacobian * [one.scale / other.scale for one, other in zip(at.free, far.free, strict=True)]
    moved = np.array([at.find_value(f) - quick.find_value(f) for f in free])
    half, correlation = _compute_intervals(fine, at, broad)
    progress(1.0)
    return JointFit(at, np.hypot(half, moved), correlation, left_out, fine, moved, broad)


def shorten_step(free: FreeParameter) -> FreeParameter:
    """Return the parameter with the difference step of the accurate sensitivities."""
    return replace(free, step=_SHORTER * free.step)


def settle(
    evidence: Evidence,
    point: Point,
    free: Sequence[FreeParameter],
    is_done: Callable[[LinearModel, LinearModel], bool] = lambda before, after: before.cost - after.cost < _LEAST_GAIN,
) -> LinearModel:
    """Fit with central sensitivities, updated each round, until is_done(before, after) is true or _MOST_ROUNDS are done.

    Several rounds are needed because C_v, gamma and offsets of the speeds lie in a curved valley of the cost.
    """
    at = linearise_centrally(evidence, point, free)
    for _ in range(_MOST_ROUNDS):
        before = at
        at = _polish(evidence, at)
        if is_done(before, at):
            break
        at = linearise_centrally(evidence, at.point, free, at.residual)
    return at


def linearise_centrally(
    evidence: Evidence, point: Point, free: Sequence[FreeParameter], residual: np.ndarray | None = None
) -> LinearModel:
    """Linearise the model by central differences; one-sided where a step would cross a bound. residual: see `linearise`."""
    above = linearise(evidence, point, free, residual)
    below = linearise(evidence, point, [replace(f, step=-f.step) for f in free], above.residual)
    one_sided = ~np.any(below.jacobian, axis=0)  # all 0: the lower step crosses a bound and is not simulated
    mean = 0.5 * (above.jacobian + below.jacobian)
    return replace(above, jacobian=np.where(one_sided, above.jacobian, mean))


def linearise_past_jumps(
    evidence: Evidence, point: Point, free: Sequence[FreeParameter], residual: np.ndarray | None = None
) -> LinearModel:
    """Linearise by central differences, without the jumps of a few residuals. See Equation. residual: see `linearise`."""
    at = linearise_centrally(evidence, point, free, residual)
    squares = at.jacobian**2
    few = np.partition(squares, -_FEW, axis=0)[-_FEW:].sum(axis=0) > _MOST_OF_FEW * squares.sum(axis=0)
    # Strengths of effects are excluded
    doubtful = [k for k in np.flatnonzero(few) if at.free[k].off is None]
    if not doubtful:
        return at
    near = at.jacobian[:, doubtful]
    wider = [replace(at.free[k], step=2.0 * at.free[k].step) for k in doubtful]
    wide = linearise_centrally(evidence, point, wider, at.residual)
    ways = np.stack([near, wide.jacobian, 2.0 * wide.jacobian - near])
    jacobian = at.jacobian.copy()
    jacobian[:, doubtful] = np.take_along_axis(ways, np.abs(ways).argmin(axis=0)[np.newaxis], axis=0)[0]
    return replace(at, jacobian=jacobian)


def fit_roughly(
    evidence: Evidence,
    start: Point,
    free: Sequence[FreeParameter],
    progress: Callable[[float], None] = lambda share: None,
) -> LinearModel:
    """Fit with one-sided sensitivities: fast, for a part of the model or for start values."""
    at = linearise(evidence, start, free)
    for round_ in range(_MOST_ROUNDS):
        before = at.cost
        at = refit(evidence, at, 0)
        progress(1.0 - 0.5 ** (round_ + 1))
        if before - at.cost < _LEAST_GAIN:
            break
        at = linearise(evidence, at.point, free, at.residual)
    return at


def _find_beginnings(evidence: Evidence) -> np.ndarray:
    """Return a mask (size,) of the residuals at the beginning of their run."""
    first = np.zeros(evidence.size, bool)
    for k, length in enumerate(evidence.lengths):
        for column in evidence.columns:
            part = evidence.find_part(k, column)
            count = min(round(_BEGINNING / length), round(_MOST_BEGINNING * (part.stop - part.start)))
            first[part.start : part.start + count] = True
    return first


def _polish(evidence: Evidence, at: LinearModel) -> LinearModel:
    """Take damped Gauss-Newton steps with the sensitivities of `at` while the cost falls; `refit` ends a few deviations
    earlier."""
    for _ in range(_MOST_POLISHED):
        points = [at.move_by(at.find_best(at.residual, damping)[0]) for damping in _DAMPINGS]
        residuals = evidence.compute_residuals(points)
        tried = min((at.move_to(p, r) for p, r in zip(points, residuals, strict=True)), key=lambda one: one.cost)
        if not tried.cost < at.cost:
            break
        at = tried
    return at


def _find_noise(evidence: Evidence, at: LinearModel) -> dict[str, float]:
    """Return the factor of the noise for the weight of each output, 1 where the residual is within the noise. See Equation."""
    factors, weighed = dict.fromkeys(evidence.columns, 1.0), evidence
    for _ in range(_MOST_WEIGHINGS):
        spreads = _compute_spreads(weighed, at.residual)
        earlier, factors = factors, {c: max(factor * spreads[c], 1.0) for c, factor in factors.items()}
        if all(1.0 / GOOD_FIT < factors[c] / earlier[c] < GOOD_FIT for c in factors):
            return earlier
        weighed = evidence.with_noise(factors)
        at = fit_roughly(weighed, at.point, at.free)
    return factors


def _compute_spreads(evidence: Evidence, residual: np.ndarray) -> dict[str, float]:
    """Return the robust standard deviation of `residual` (size,) by output, over all runs."""
    spreads = {}
    for column in evidence.columns:
        parts = [evidence.find_part(k, column) for k in range(len(evidence.runs))]
        counted = np.concatenate([residual[part][evidence.weights[part] > 0.0] for part in parts])
        spreads[column] = _MAD_TO_SIGMA * float(np.median(np.abs(counted))) if len(counted) else 1.0
    return spreads


def _compute_outlier_limits(evidence: Evidence, residual: np.ndarray) -> np.ndarray:
    """Return the limit (size,) above which a residual is an outlier, from the spread of its output in all runs."""
    limits = np.empty_like(residual)
    for column, spread in _compute_spreads(evidence, residual).items():
        for k in range(len(evidence.runs)):
            limits[evidence.find_part(k, column)] = _OUTLIER * max(spread, 1.0)
    return limits


def _compute_intervals(evidence: Evidence, at: LinearModel, broad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return half widths (p,) in the parameters' units and correlation (p, p), from the sensitivities of `at` and from
    `broad`."""
    near, _ = _compute_own_intervals(evidence, at)
    far, correlation = _compute_own_intervals(evidence, replace(at, jacobian=broad))
    return np.maximum(near, far), correlation


def _compute_own_intervals(evidence: Evidence, at: LinearModel) -> tuple[np.ndarray, np.ndarray]:
    """Return half widths (p,) and correlation (p, p) from the sensitivities of `at` alone."""
    clusters = split_clusters(evidence)
    few = np.sqrt(len(clusters) / max(len(clusters) - len(at.free), 1))
    robust = at.compute_covariance(clusters)
    # a parameter at a bound with no sensitivity still gets an interval, a wide one (fit.py, prior of no weight)
    inverse = np.linalg.inv(at.gram + np.diag(at.prior + 1e-10 * np.diag(at.gram)))
    white = inverse * max(float(at.residual @ at.residual) / np.count_nonzero(evidence.weights), 1.0)
    deviation = np.maximum(few * np.sqrt(np.diag(robust)), np.sqrt(np.diag(white)))
    spread = np.sqrt(np.diag(white))
    return NORMAL_95 * deviation * np.array([f.scale for f in at.free]), white / np.outer(spread, spread)
