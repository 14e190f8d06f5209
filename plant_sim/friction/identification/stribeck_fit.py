"""Stribeck curves and load law fitted to steady forces: Nelder-Mead as in the thesis, and bounded least squares.

What            parameters of one steady law y(x), by the smallest root-mean-square error
Equation        RMSE = sqrt(1/N sum (F_funct - F_exp)^2) over the laws of eqs 1.4, 4.1, 4.2, 6.2                     (sec. 5.6)
Assumptions     steady state; x without error
Valid range     x > 0 (one direction of sliding)
Not modelled    weights: points of relative accuracy are to be fitted as logarithms by the caller
References      Janssens 2010, secs. 4.2.4, 5.6, 5.8; Nelder and Mead 1965 (Comput. J. 7:308)
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import optimize
from scipy.optimize import nnls

from plant_sim.friction.identification.least_squares import Estimate, minimise
from plant_sim.friction.identification.virgin_curve import check_pair
from plant_sim.friction.load_law import LoadLaw
from plant_sim.friction.model import Array, check_real, require
from plant_sim.friction.stribeck import Stribeck
from protocols.errors import InputError

MOST_EVALUATIONS = 20000  # of Nelder-Mead
GRID = 10  # starts for each nonlinear parameter, enough that one of them converges to the best fit; chosen
TOLERANCE = 1e-10  # relative, of Nelder-Mead, in parameters and RMSE


@dataclass(frozen=True)
class SteadyLaw:
    """A law y(x; parameters): `names`, `evaluate(x, *parameters)`, `bounds` (m, 2), `guess(x, y)` -> (m,)."""

    equation: str
    names: tuple[str, ...]
    evaluate: Callable[..., Array]
    bounds: tuple[tuple[float, float], ...]
    guess: Callable[[Array, Array], Array]


def _guess_curve(speed: Array, force: Array) -> Array:
    """Return F_S, beta, V_S, C_v, gamma: the best of a grid of V_S and gamma, the others linear given these (eq 1.4)."""
    best, guess = np.inf, np.ones(5)
    for velocity in np.geomspace(speed.min() / 3.0, speed.max() * 3.0, GRID):
        decay = np.exp(-velocity / speed)
        for exponent in np.linspace(0.2, 2.0, GRID):
            (static, low, viscous), misfit = nnls(np.stack([1.0 - decay, decay, speed**exponent], axis=1), force)
            if misfit < best:
                static = max(static, 1e-3 * float(np.abs(force).max()), 1e-12)
                best, guess = misfit, np.array([static, np.clip(low / static, 0.05, 0.95), velocity, viscous, exponent])
    return guess


def _guess_depth(speed: Array, force: Array) -> Array:
    static, beta, velocity, viscous, exponent = _guess_curve(speed, force)
    return np.array([static, 1.0 / (1.0 - beta), velocity, viscous / static, exponent])


def _guess_load(load: Array, force: Array) -> Array:
    """Return mu_max, a_2, L: the best of a grid of L, the others linear given it (eq 4.2)."""
    best, guess = np.inf, np.ones(3)
    for scale in np.geomspace(load.min() / 3.0, load.max() * 3.0, GRID):
        decay = np.exp(-scale / load)
        (high, low), misfit = nnls(np.stack([load * (1.0 - decay), load * decay], axis=1), force)
        if misfit < best and high > 0.0:
            best, guess = misfit, np.array([high, 1.0 / (1.0 - np.clip(low / high, 0.05, 0.95)), scale])
    return guess


# gamma, the last: 1/3 to 2/3 in the thesis
_CURVE_BOUNDS = ((1e-12, np.inf), (1e-3, 10.0), (1e-9, np.inf), (0.0, np.inf), (0.05, 3.0))
_DEPTH_BOUNDS = ((1e-12, np.inf), (1.0 + 1e-9, 1e3), (1e-9, np.inf), (0.0, np.inf), (0.05, 3.0))
_LOAD_BOUNDS = ((1e-9, 10.0), (1.0 + 1e-9, 1e3), (1e-9, np.inf))


def _curve(speed: Array, *values: float) -> Array:
    return Stribeck(*values)(speed)  # 1.4


def _depth(speed: Array, *values: float) -> Array:
    return Stribeck.from_depth(*values)(speed)  # 4.1


def _load(load: Array, *values: float) -> Array:
    return LoadLaw(*values)(load)  # 4.2


STRIBECK = SteadyLaw(
    "1.4", ("static_force", "beta", "stribeck_velocity", "viscous", "exponent"), _curve, _CURVE_BOUNDS, _guess_curve
)
DEPTH = SteadyLaw("4.1", ("static_force", "a_1", "v_s", "sigma_v", "gamma"), _depth, _DEPTH_BOUNDS, _guess_depth)
CLUTCH = SteadyLaw("6.2", ("M_C", "beta", "V_S", "C_v", "gamma"), _curve, _CURVE_BOUNDS, _guess_curve)
LOAD = SteadyLaw("4.2", ("coefficient", "a_2", "load_scale"), _load, _LOAD_BOUNDS, _guess_load)


@dataclass(frozen=True)
class SimplexFit:
    """Result of Nelder-Mead: `values` by name (frozen ones too), `rmse` in the unit of the data, `evaluations`."""

    values: Mapping[str, float]
    rmse: float
    evaluations: int


def fit_by_simplex(
    law: SteadyLaw,
    x: Array,
    y: Array,
    start: Mapping[str, float] | None = None,
    frozen: Mapping[str, float] | None = None,
) -> SimplexFit:
    """Fit `law` to `x` (n,), `y` (n,) by the downhill simplex on the RMSE, as the thesis does; gives no intervals.

    `start` replaces guesses by name, `frozen` keeps parameters. Raises InputError.
    """
    free, begin, bounds, fixed, x, y = _check_inputs(law, x, y, start, frozen)
    residual = _make_residual(law, free, fixed, x, y)

    scale = np.where(begin != 0.0, np.abs(begin), 1.0)

    def compute_rmse(theta: Array) -> float:
        return float(np.sqrt(np.mean(residual(theta * scale) ** 2)))  # sec. 5.6

    limits = optimize.Bounds(bounds[:, 0] / scale, bounds[:, 1] / scale)
    options = {"maxfev": MOST_EVALUATIONS, "maxiter": MOST_EVALUATIONS, "adaptive": True, "xatol": TOLERANCE}
    options["fatol"] = TOLERANCE * compute_rmse(begin / scale)
    result = optimize.minimize(compute_rmse, begin / scale, method="Nelder-Mead", bounds=limits, options=options)
    values = dict(zip(free, map(float, result.x * scale), strict=True)) | fixed
    return SimplexFit({name: values[name] for name in law.names}, float(result.fun), int(result.nfev))


def fit_least_squares(
    law: SteadyLaw,
    x: Array,
    y: Array,
    start: Mapping[str, float] | None = None,
    frozen: Mapping[str, float] | None = None,
) -> Estimate:
    """Fit `law` to `x` (n,), `y` (n,) by bounded least squares, with 95 % intervals; arguments as `fit_by_simplex`."""
    free, begin, bounds, fixed, x, y = _check_inputs(law, x, y, start, frozen)
    return minimise(_make_residual(law, free, fixed, x, y), free, begin[None, :], bounds, fixed)


@dataclass(frozen=True)
class FittedStribeck:
    """A Stribeck `curve` fitted to points, and the `estimate` of its parameters: 95 % intervals, `doubts`, `rmse` [N]."""

    curve: Stribeck
    estimate: Estimate


def fit_stribeck(speed: object, force: object, frozen: Mapping[str, float] | None = None) -> FittedStribeck:
    """Fit eq 1.4 to measured points of steady sliding by bounded least squares.

    `speed` [m/s] (n,), not 0, and `force` [N] (n,). The curve is odd: a point at a negative speed counts as its mirror image.
    `frozen` keeps parameters, such as {"exponent": 1.0}; their names are those of `Stribeck`. Raises InputError.
    """
    speeds, forces = check_real("speed [m/s]", speed), check_real("force [N]", force)
    if speeds.ndim != 1 or speeds.shape != forces.shape:
        raise InputError(
            f"speed has shape {speeds.shape} and force {forces.shape}; they must be vectors of equal length"
        )
    estimate = fit_least_squares(STRIBECK, np.abs(speeds), np.sign(speeds) * forces, frozen=frozen)
    return FittedStribeck(Stribeck(*(estimate[name] for name in STRIBECK.names)), estimate)


def _make_residual(
    law: SteadyLaw, free: tuple[str, ...], fixed: Mapping[str, float], x: Array, y: Array
) -> Callable[[Array], Array]:
    def compute_residual(theta: Array) -> Array:
        values = {**fixed, **dict(zip(free, theta, strict=True))}
        return law.evaluate(x, *(values[name] for name in law.names)) - y

    return compute_residual


def _check_inputs(
    law: SteadyLaw, x: Array, y: Array, start: Mapping[str, float] | None, frozen: Mapping[str, float] | None
) -> tuple[tuple[str, ...], Array, Array, dict[str, float], Array, Array]:
    """Return the names, start and bounds of the free parameters, the frozen ones, and the checked data."""
    fixed = dict(frozen or {})
    for name in (*fixed, *(start or {})):
        if name not in law.names:
            raise InputError(f"parameter {name!r} is not in eq {law.equation}; it has {', '.join(law.names)}")
    free = tuple(name for name in law.names if name not in fixed)
    if not free:
        raise InputError(f"no parameter of eq {law.equation} is to be fitted; all are frozen")
    x, y = check_pair(x, y, "measured curve", least=len(free) + 1)
    if (x <= 0.0).any():
        raise InputError(f"measured curve has a point at {x.min():g}; allowed are points above 0")
    if y.mean() <= 0.0:
        raise InputError(
            f"measured curve has the mean force {y.mean():g}; allowed is above 0: friction against the motion"
        )
    low, high = np.array(law.bounds).T
    floor = np.where(low > 0.0, low * 1.01, 1e-6 * np.abs(y).max())  # off the bound, where the search has slope
    guess = dict(zip(law.names, np.clip(law.guess(x, y), floor, high * 0.999), strict=True)) | dict(start or {})
    bounds = np.array([law.bounds[law.names.index(name)] for name in free])
    begin = np.array([guess[name] for name in free], float)
    for name, value, (least, most) in zip(free, begin, bounds, strict=True):
        require(f"start of {name}", value, least=least, most=most)
    return free, begin, bounds, fixed, x, y
