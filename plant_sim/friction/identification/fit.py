"""Parameters of any friction model from a measured trace.

What            the parameters with which a model, driven by the measured position, comes nearest to the measured force
Equation        min over theta of sum (F_model(theta) - F_measured)^2, from several starts within the bounds
Assumptions     as `least_squares`; the contact is at rest at the first sample
Valid range     any model with `trace(position, dt, load).force`
Not modelled    masses, sensors: measure the force at the contact, or make them part of `build`
References      Janssens 2010, sec. 5.8; starts: McKay, Beckman, Conover 1979 (Latin hypercube)
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from scipy.stats import qmc

from plant_sim.friction.identification.delay import find_delay
from plant_sim.friction.identification.least_squares import Estimate, minimise
from plant_sim.friction.identification.virgin_curve import check_pair
from plant_sim.friction.model import Array, check_real, require, require_type
from plant_sim.friction.whole_number import require_whole
from protocols.errors import InputError

LOGARITHMIC_RATIO = 10.0  # bounds further apart than this are searched by their logarithm


class Model(Protocol):
    """A friction model to be fitted."""

    def trace(self, position: Array, dt: float, load: Array | float = 1.0) -> Any: ...


@dataclass(frozen=True)
class Measured:
    """A measured trace: `position` [m] (n,), `dt` [s], `force` [N] (n,), `load` [N] scalar or (n,). Raises InputError."""

    position: Array
    dt: float
    force: Array
    load: Array | float = field(default=1.0)

    def __post_init__(self) -> None:
        position, force = check_pair(self.position, self.force, "measured trace")
        require("time step", self.dt, above=0.0, unit="s")
        load = check_real("load of the measured trace [N]", self.load)
        if load.shape not in ((), position.shape):
            raise InputError(
                f"load of the measured trace has shape {load.shape}; allowed is one value, or one for each of "
                f"{position.size} samples"
            )
        require("least load of the measured trace", float(load.min()), least=0.0, unit="N")
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "force", force)
        object.__setattr__(self, "load", load if load.ndim else float(load))


def fit(
    build: Callable[[Mapping[str, float]], Model],
    names: Sequence[str],
    start: Mapping[str, float],
    bounds: Mapping[str, tuple[float, float]],
    trace: Measured,
    starts: int = 1,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Estimate:
    """Fit the parameters `names` of the model that `build` makes of all values by name; those only in `start` stay frozen.

    Searches from `start` and from `starts` - 1 further points spread within `bounds`, which are needed for `names`; points
    differ by `seed`. `progress(done, total)` is called after each start. A delayed or early force is reported in `doubts`.
    Raises InputError.
    """
    require_type("measured trace", trace, Measured)
    require_whole("number of starts", starts)
    for name in names:
        if name not in start or name not in bounds:
            raise InputError(f"parameter {name!r} has no {'start' if name not in start else 'bounds'}; it needs both")
    for name, value in start.items():
        require(f"start of {name}", value, most=np.inf)
    frozen = {name: float(value) for name, value in start.items() if name not in names}
    limits = np.array([_read_limits(name, bounds[name]) for name in names]).reshape(-1, 2)
    if trace.force.size <= len(names):
        raise InputError(
            f"measured trace has {trace.force.size} samples for {len(names)} parameters; more samples are needed"
        )

    def compute_force(theta: Array) -> Array:
        model = build({**frozen, **dict(zip(names, map(float, theta), strict=True))})
        shown: Array = model.trace(trace.position, trace.dt, trace.load).force
        return shown

    def compute_residual(theta: Array) -> Array:
        return compute_force(theta) - trace.force

    first = np.array([[float(start[name]) for name in names]])
    tried = np.vstack([first, _spread_points(limits, starts - 1, seed)])
    estimate = minimise(compute_residual, names, tried, limits, frozen, progress)
    delay = find_delay(compute_force, trace.force, trace.dt, estimate, limits)
    return estimate if delay is None else replace(estimate, doubts=(*estimate.doubts, _describe_delay(delay)))


def _describe_delay(delay: float) -> str:
    return (
        f"the force is {1e3 * abs(delay):.3g} ms {'behind' if delay > 0.0 else 'before'} the position, which explains most of"
        " the residual: shift it and fit again, as these parameters are not valid"
    )


def _read_limits(name: str, bounds: tuple[float, float]) -> tuple[float, float]:
    """Return the two bounds of a parameter; they may be infinite. Raises InputError."""
    try:
        low, high = map(float, bounds)
    except (TypeError, ValueError):
        raise InputError(f"bounds of {name} are {bounds!r:.60}; they must be two numbers, the lower first") from None
    return low, high


def _spread_points(bounds: Array, number: int, seed: int) -> Array:
    """Return `number` points (number, m) by Latin hypercube within `bounds` (m, 2), by logarithm where they span decades."""
    if number <= 0:
        return np.empty((0, len(bounds)))
    if not np.isfinite(bounds).all():
        raise InputError("several starts need finite bounds; give bounds, or use one start")
    unit = qmc.LatinHypercube(len(bounds), rng=np.random.default_rng(seed)).random(number)
    low, high = bounds.T
    wide = (low > 0.0) & (high > LOGARITHMIC_RATIO * np.abs(low))
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithmic = np.exp(np.log(low) + unit * (np.log(high) - np.log(low)))
    return np.clip(np.where(wide, logarithmic, low + unit * (high - low)), low, high)
