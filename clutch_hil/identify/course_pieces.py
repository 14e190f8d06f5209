"""Course pieces: short parts of an experiment, from which `clutch-hil identify --design` puts together the next one.

Each begins and ends with an open clutch, so that they may follow each other in any order. Pressures are in bar above contact.
"""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from clutch_hil.identify.courses import ClutchCourse, Span
from plant_sim.rigs.multisine import Multisine
from protocols.files.units import RPM

_REST = 0.3  # s after a release: it takes 0.2 s
_SPEED = 200 * RPM  # at the beginning and the end of each piece
_LOW, _MIDDLE, _HIGH = 0.45, 1.05, 1.7  # bar above contact: within the range of the maps, 0.35 to 1.85


def _begin(course: ClutchCourse, pressure: float) -> None:
    course.fill(pressure)
    course.to(0.3)


def _end(course: ClutchCourse) -> None:
    course.release(_REST)
    course.to(0.2, speed=_SPEED)


def staircase(course: ClutchCourse) -> None:
    """Six steps of the pressure at 200 rpm."""
    _begin(course, 0.35)
    for level in (0.65, 0.95, 1.25, 1.55, 1.85):
        course.above(0.05, level)
        course.to(0.5)
    _end(course)


def _sweep(course: ClutchCourse, pressure: float) -> None:
    _begin(course, pressure)
    for share in np.abs(np.linspace(1.0, -1.0, 21))[1:].tolist():
        course.to(0.1, speed=1.0 + 24.0 * share**1.7)
    _end(course)


def sweep_low(course: ClutchCourse) -> None:
    """A sweep of the slip down to 1 rad/s and back at a low pressure."""
    _sweep(course, _LOW)


def sweep_middle(course: ClutchCourse) -> None:
    """A sweep of the slip down to 1 rad/s and back at a middle pressure."""
    _sweep(course, _MIDDLE)


def sweep_high(course: ClutchCourse) -> None:
    """A sweep of the slip down to 1 rad/s and back at a high pressure."""
    _sweep(course, _HIGH)


def slip_sine(course: ClutchCourse) -> None:
    """A sine of the slip of 5 Hz, ten periods."""
    _begin(course, _MIDDLE)
    course.to(0.2, speed=100 * RPM)
    for k in range(1, 201):
        course.to(0.01, speed=100 * RPM + 50 * RPM * math.sin(2.0 * math.pi * k / 20))
    _end(course)


def multisine(course: ClutchCourse) -> None:
    """A multisine of the pressure of 1 to 25 Hz, three periods."""
    _begin(course, _MIDDLE)
    wave = Multisine(np.arange(1, 26), amplitude=0.05, samples=200).period(np.random.default_rng(615)).tolist()
    for value in wave * 3:
        course.above(1.0 / 200, _MIDDLE + value)
    _end(course)


def fills(course: ClutchCourse) -> None:
    """Two fills from an empty cylinder."""
    for level in (0.6, 1.3):
        _begin(course, level)
        _end(course)


def heating(course: ClutchCourse) -> None:
    """A hold at a high pressure and speed that warms the oil."""
    _begin(course, 1.6)
    course.to(6.0, speed=23.0)
    _end(course)


def coasting(course: ClutchCourse) -> None:
    """Speeding down and up with an open clutch."""
    for speed in (5.0, 25.0, 5.0):
        course.to(0.2, speed=speed)
        course.to(0.3)
    course.to(0.2, speed=_SPEED)


Piece = Callable[[ClutchCourse], None]
PIECES: Mapping[str, Piece] = {
    piece.__name__: piece
    for piece in (staircase, sweep_low, sweep_middle, sweep_high, slip_sine, multisine, fills, heating, coasting)
}


def compose(names: Sequence[str], span: Span) -> ClutchCourse:
    """A course of these pieces, one after the other."""
    course = ClutchCourse(span, _SPEED)
    for name in names:
        PIECES[name](course)
    return course
