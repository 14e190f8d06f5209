"""Samples of parameters for a sweep: a grid, random points or a Latin hypercube. A sample has values by dotted name."""

from collections.abc import Callable, Iterable, Mapping
from itertools import product
from math import isfinite

import numpy as np

from clutch_hil.bench.arguments import take_list, take_mapping, take_number, take_whole
from protocols.errors import InputError

Sample = dict[str, float]
Ranges = Mapping[str, tuple[float, float]]
MOST_SAMPLES = 1_000_000  # samples, or runs, of a sweep: five days of one CPU for the profile engagement


def grid(values: Mapping[str, Iterable[float]]) -> list[Sample]:
    """Return every combination of `values`, the last name varying fastest. Raises InputError."""
    levels = {name: take_list(name, one) for name, one in take_mapping("values", values).items()}
    for name, one in levels.items():
        if not one:
            raise InputError(f"{name} has no values; one or more are needed")
    check_count(int(np.prod([len(one) for one in levels.values()], dtype=float)))
    numbers = [[take_number(name, value) for value in one] for name, one in levels.items()]
    return [dict(zip(levels, point, strict=True)) for point in product(*numbers)]


def random(ranges: Ranges, count: int, seed: int = 1) -> list[Sample]:
    """Return `count` points, each value uniform in its (low, high) and independent of the others. Raises InputError."""
    seed = take_whole("seed", seed, 0)
    return _scale_points(ranges, count, lambda size: np.random.default_rng(seed).random((count, size)))


def latin_hypercube(ranges: Ranges, count: int, seed: int = 1) -> list[Sample]:
    """Return `count` points with the values of each parameter spread evenly over its (low, high). Raises InputError.

    References: McKay, Beckman, Conover 1979, Technometrics 21(2), by scipy.stats.qmc.
    """
    from scipy.stats import qmc  # loading takes one second of CPU; only a sweep needs it

    seed = take_whole("seed", seed, 0)
    return _scale_points(ranges, count, lambda size: qmc.LatinHypercube(size, rng=seed).random(count))


def _scale_points(ranges: Ranges, count: int, points: Callable[[int], np.ndarray]) -> list[Sample]:
    """Return samples in `ranges` from `points(number of names)`, which returns values from 0 to 1, shape (count, names)."""
    count = take_whole("count", count, 1, MOST_SAMPLES)
    if not take_mapping("ranges", ranges):
        raise InputError("no ranges are given; one or more are needed, such as {'friction_level.level': (0.8, 1.2)}")
    for name, span in ranges.items():
        pair = [take_number(f"range of {name}", value) for value in take_list(f"range of {name}", span)]
        if len(pair) != 2 or pair[0] > pair[1] or not isfinite(pair[1] - pair[0]):
            raise InputError(f"range of {name} is {span}; a pair (low, high) of numbers is needed, low at most high")
    low, high = np.array(list(ranges.values())).T
    return [dict(zip(ranges, map(float, point), strict=True)) for point in low + (high - low) * points(len(ranges))]


def check_count(count: int, what: str = "samples") -> None:
    """Raise InputError unless a sweep can have `count` samples, or runs."""
    if not 1 <= count <= MOST_SAMPLES:
        raise InputError(f"{count} {what} are not possible; allowed are 1 to {MOST_SAMPLES}")
