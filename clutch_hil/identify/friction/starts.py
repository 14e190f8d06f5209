"""Where the search begins, and its bounds: by the size of the records, a linear regression, and their virgin curve (app. D)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from clutch_hil.identify.friction.law import Structure, Values
from clutch_hil.identify.friction.slide_record import SlideRecord
from plant_sim.friction.identification import maxwell_slip
from plant_sim.friction.identification.break_points import CurvatureSpacing
from plant_sim.friction.identification.virgin_curve import from_loops
from protocols.errors import InputError

# Of the mean speed: what all but 0.5 % of the rows stay below is more than it, unless the way is made in these few rows
LEAST_PEAK = 0.5
SLIDING_SHARE = 0.05  # of the greatest speed: faster samples slide; chosen
WIDE = 50.0  # ratio of a bound to its start; chosen: a start by regression is right within a factor of a few
BEST_SPACING = CurvatureSpacing(0.5)  # the optimum of docs/friction.md
# samples that a force is behind its position: chosen, converters and filters; a longer one is pre-sliding
MOST_DELAY = 5.0
SHARES = (0.6, 1.4)  # of an element's break point, for the two that it is split into; chosen


@dataclass(frozen=True)
class Scale:
    """Size of the records: regression of `level`, `viscous`, `mass`, `offset`, `load_gain` (start values), and ranges.

    `speed`, `span`, `period`, `load` (mean): the greatest of all records. `force`: the size of force.
    """

    level: float
    viscous: float
    mass: float
    offset: float
    load_gain: float
    force: float
    speed: float
    acceleration: float
    span: float
    finest: float
    period: float
    load: float


def measure_scale(records: Sequence[SlideRecord]) -> Scale:
    """Regress the force on sign and size of the speed, acceleration, load and 1.

    Raises InputError for a reversed sign, and for a position that only jumps.
    """
    speed, acceleration, force, load = (
        np.concatenate([getattr(one, name) for one in records]) for name in ("speed", "acceleration", "force", "load")
    )
    fastest = float(np.quantile(np.abs(speed), 0.995))
    if not fastest > LEAST_PEAK * float(np.mean(np.abs(speed))):
        raise InputError("the position rests in nearly all rows, and jumps in the others; it must slide")
    slides = np.abs(speed) > SLIDING_SHARE * fastest
    usual = float(np.mean(load))  # without it a constant load would take half of the offset
    rows = np.column_stack([np.sign(speed), speed, acceleration, np.ones(speed.size), load - usual])[slides]
    size = np.linalg.norm(rows, axis=0)
    solution = np.linalg.lstsq(rows / np.where(size > 0.0, size, 1.0), force[slides], rcond=1e-6)[0]
    level, viscous, mass, offset, gain = (float(v) for v in solution / np.where(size > 0.0, size, 1.0))
    offset -= gain * usual
    # friction at a typical speed; the two parts share it where there is one speed only
    friction = level + viscous * float(np.median(np.abs(speed[slides])))
    span = max(float(np.ptp(one.position)) for one in records)
    greatest = float(np.quantile(np.abs(force), 0.995))
    rigid = mass * acceleration + offset + gain * load
    acting = float(np.mean((np.sign(speed) * (force - rigid))[slides]))
    if friction < 0.0 and acting < 0.0 and _reverses(speed, fastest):
        raise InputError(
            f"the force acts with {-acting:.3g} along the motion: friction would drive it; reverse its sign, for"
            " example with COLUMN:-N"
        )
    moving = np.abs(speed[slides])
    finest = float(np.quantile(moving, 0.05)) * max(one.period for one in records)
    # reversals of a few ms in strokes of seconds are fewer than 0.5 % of the rows, and are all that shows the mass
    strongest = max(float(np.quantile(np.abs(acceleration), 0.995)), float(np.sqrt(np.mean(acceleration**2))))
    level = level if level > 0.02 * abs(friction) else max(abs(friction), 1e-3 * greatest)
    return Scale(
        level, max(viscous, 0.0), max(mass, 0.0), offset, gain, greatest, fastest,
        strongest, span, finest, max(one.period for one in records), usual,
    )  # fmt: skip


def _reverses(speed: np.ndarray, fastest: float) -> bool:
    return bool((speed > SLIDING_SHARE * fastest).any() and (speed < -SLIDING_SHARE * fastest).any())


def list_constants(scale: Scale, records: Sequence[SlideRecord]) -> dict[str, float]:
    """Values that are not fitted (`law.CONSTANTS`)."""
    reach = max(float(np.abs(one.position).max()) for one in records)
    return {"reference_load": scale.load, "reach": reach}


def start_values(structure: Structure, scale: Scale, records: Sequence[SlideRecord]) -> dict[str, float]:
    """A start for every parameter of `structure`."""
    own = {name: _START[name](scale) for name in structure.names if name in _START}
    if structure.elements:
        for i, (limit, point) in enumerate(_start_elements(structure.elements, scale, records), 1):
            own[f"limit_{i}"], own[f"break_point_{i}"] = limit, point
    limits = list_bounds(structure, scale)
    return {name: float(np.clip(own[name], *_shrink_bounds(*limits[name]))) for name in structure.names}


def widen(values: Values, structure: Structure, scale: Scale, records: Sequence[SlideRecord]) -> dict[str, float]:
    """A start for `structure`, which has one term more, or twice the elements, than the one that has `values`."""
    start = start_values(structure, scale, records)
    known = {name: value for name, value in values.items() if name in start}
    old = sum(name.startswith("limit_") for name in values)
    if structure.elements > old > 0:
        for i in range(1, old + 1):
            for j, share in enumerate(SHARES):
                number = i + j * old
                known[f"limit_{number}"] = values[f"limit_{i}"] / len(SHARES)
                known[f"break_point_{number}"] = share * values[f"break_point_{i}"]
    limits = list_bounds(structure, scale)
    return {name: float(np.clip(value, *_shrink_bounds(*limits[name]))) for name, value in (start | known).items()}


def list_bounds(structure: Structure, scale: Scale) -> dict[str, tuple[float, float]]:
    """Least and greatest value of every parameter of `structure`."""
    return {name: _find_bound(name, scale) for name in structure.names}


def _find_bound(name: str, s: Scale) -> tuple[float, float]:
    if name.startswith("limit_") or name == "static_force":
        return 1e-5 * s.level, WIDE * s.level
    if name.startswith("break_point_"):
        return min(1e-2 * s.finest, 1e-6 * s.span), 2.0 * s.span
    return _BOUNDS[name](s)


_BOUNDS: Mapping[str, Callable[[Scale], tuple[float, float]]] = {
    "stiffness": lambda s: (0.1 * s.level / s.span, 1e8 * s.level / s.span),
    "viscous": lambda s: (0.0, WIDE * s.force / s.speed),
    "exponent": lambda s: (0.1, 3.0),
    "beta": lambda s: (0.05, 3.0),
    "stribeck_velocity": lambda s: (1e-4 * s.speed, 5.0 * s.speed),
    "attraction": lambda s: (0.01, 10.0 / s.period),
    "damping": lambda s: (0.0, 1e3 * s.force / s.speed),
    "viscous_asymmetry": lambda s: (-0.95, 0.95),
    "level_asymmetry": lambda s: (-0.95, 0.95),
    "shape_1": lambda s: (-0.5, 0.5),
    "shape_2": lambda s: (-0.4, 0.4),
    "fall": lambda s: (1e-3, 0.99),
    "load_scale": lambda s: (0.02 * s.load, 50.0 * s.load),
    "preload": lambda s: (0.0, WIDE * s.load),
    "mass": lambda s: (0.0, WIDE * max(s.mass, s.force / s.acceleration)),
    "offset": lambda s: (-5.0 * s.force, 5.0 * s.force),
    "load_gain": lambda s: (-5.0 * s.force / s.load, 5.0 * s.force / s.load),
    "delay": lambda s: (-MOST_DELAY * s.period, MOST_DELAY * s.period),
}
_START: Mapping[str, Callable[[Scale], float]] = {
    "static_force": lambda s: s.level,
    "stiffness": lambda s: 100.0 * s.level / s.span,
    "viscous": lambda s: max(s.viscous, 0.02 * s.level / s.speed),
    "exponent": lambda s: 1.0,
    "beta": lambda s: 0.8,
    "stribeck_velocity": lambda s: 0.1 * s.speed,
    "attraction": lambda s: 0.1 / s.period,
    "damping": lambda s: 0.02 * s.level / s.speed,
    "viscous_asymmetry": lambda s: 0.01,
    "level_asymmetry": lambda s: 0.01,
    "shape_1": lambda s: 0.01,
    "shape_2": lambda s: 0.01,
    "fall": lambda s: 0.3,
    "load_scale": lambda s: s.load,
    "preload": lambda s: 0.3 * s.load,
    "mass": lambda s: max(s.mass, 1e-2 * s.force / s.acceleration),
    "offset": lambda s: s.offset,
    "load_gain": lambda s: s.load_gain,
    "delay": lambda s: 0.1 * s.period,
}


def _shrink_bounds(low: float, high: float) -> tuple[float, float]:
    """The bounds without their ends, where a search has slope."""
    return low + 1e-6 * (high - low) if low else 0.0, high - 1e-6 * (high - low)


def _start_elements(count: int, scale: Scale, records: Sequence[SlideRecord]) -> list[tuple[float, float]]:
    """Limit [N] and break point [m] of `count` elements, from the virgin curve of the loops where there are any."""
    for record in sorted(records, key=lambda one: -float(np.ptp(one.position))):
        rigid = (
            scale.mass * record.acceleration + scale.offset + (scale.load_gain * record.load if record.loaded else 0.0)
        )
        try:
            curve = from_loops(record.path, record.force - rigid)
            model = maxwell_slip.fit(curve, BEST_SPACING.place(curve, count))
        except InputError:
            continue
        if model.limits.size == count:
            return list(zip(map(float, model.limits), map(float, model.limits / model.stiffness), strict=True))
    points = np.geomspace(1e-3, 1e-1, count) * scale.span if count > 1 else np.array([1e-2 * scale.span])
    return [(scale.level / count, float(point)) for point in points]
