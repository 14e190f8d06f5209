"""Course pieces: parts of an experiment of about a second, which are combined to a course shorter than the fixed ones.

Each piece first ramps to its own pressure and speed and stays in contact, so that no time is lost by filling between pieces.
They are played in the order of LIBRARY. Only the piece "refill" opens the clutch before the end.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from clutch_hil.identify.courses.clutch_courses import LEAST, MOST, MULTISINE_SEED, ClutchCourse, Span
from plant_sim.rigs.multisine import Multisine
from protocols.files.units import RPM

Piece = Callable[[ClutchCourse], None]

_SPEED = 200 * RPM  # initial speed of a course
_SLOW, _FAST = 1.0, 22.0  # rad/s, slips of a sweep: the range of the maps (fig 6.12), with a margin for overshoot
_LEVELS = (LEAST, 0.6, 0.9, 1.2, 1.5, MOST)  # bar above contact
_MIDDLE = 1.05  # bar above contact: 3.4 bar in the thesis, where the dynamics were measured


def _sweep(course: ClutchCourse, level: float) -> None:
    """Play a sweep of the slip from fast to slow and back."""
    course.approach(level, _FAST)
    for share in np.abs(np.linspace(1.0, -1.0, 17))[1:].tolist():
        course.to(0.08, speed=_SLOW + (_FAST - _SLOW) * share**1.7)


def _play_crawl(course: ClutchCourse, level: float) -> None:
    """Play two slow slips."""
    course.approach(level, 3.0)
    course.to(0.25)
    course.to(0.05, speed=_SLOW)
    course.to(0.25)


def _play_stairs(course: ClutchCourse, speed: float) -> None:
    """Play four pressure steps."""
    course.approach(LEAST, speed)
    for level in (LEAST, 0.85, 1.35, MOST):
        course.approach(level, speed)
        course.to(0.15)


def _play_triangle(course: ClutchCourse, speed: float) -> None:
    """Play a pressure triangle, up and down."""
    course.approach(LEAST, speed)
    course.set_pressure_above(0.6, MOST)
    course.set_pressure_above(0.6, LEAST)


def _play_slip_sine(course: ClutchCourse, level: float) -> None:
    """Play two periods of a 5 Hz sine of the slip."""
    course.approach(level, 100 * RPM)
    for k in range(1, 41):
        course.to(0.01, speed=100 * RPM + 50 * RPM * math.sin(2.0 * math.pi * k / 20))


def _play_multisine(course: ClutchCourse, lines: Sequence[int], amplitude: float, samples: int) -> None:
    """Play one period of a pressure multisine, with rows every 5 ms."""
    course.approach(_MIDDLE, _SPEED)
    wave = Multisine(np.array(lines), amplitude=amplitude, samples=samples).draw_period(
        np.random.default_rng(MULTISINE_SEED)
    )
    for value in wave.tolist():
        course.set_pressure_above(0.005, _MIDDLE + value)


def _hold(course: ClutchCourse) -> None:
    """Hold high pressure and speed, to heat the oil."""
    course.approach(MOST, _FAST)
    course.to(1.0)


def _play_refill(course: ClutchCourse) -> None:
    """Open the clutch, speed up, and fill the empty cylinder again."""
    course.release(0.45)
    course.to(0.1, speed=_SPEED - 8.0)
    course.to(0.1, speed=_SPEED)
    course.fill(LEAST)


# Pieces by name, in the order in which they are played
LIBRARY: Mapping[str, Piece] = {
    **{f"crawl at {level:g} bar": partial(_play_crawl, level=level) for level in _LEVELS},
    **{f"sweep at {level:g} bar": partial(_sweep, level=level) for level in _LEVELS},
    **{f"slip sine at {level:g} bar": partial(_play_slip_sine, level=level) for level in (0.6, _MIDDLE, 1.5)},
    **{f"stairs at {speed:g} rad/s": partial(_play_stairs, speed=speed) for speed in (3.0, 10.0, _FAST)},
    **{f"triangle at {speed:g} rad/s": partial(_play_triangle, speed=speed) for speed in (3.0, 10.0, _FAST)},
    "slow multisine": partial(_play_multisine, lines=range(1, 26), amplitude=0.05, samples=200),
    "fast multisine": partial(_play_multisine, lines=range(2, 21), amplitude=0.06, samples=100),
    "hold": _hold,
    "refill": _play_refill,
}


def compose(pieces: Sequence[str], span: Span) -> tuple[ClutchCourse, list[tuple[float, float]]]:
    """Return a course of these pieces in the order of the library, and begin and end of each piece [s]."""
    course, counts = ClutchCourse(span, _SPEED), Counter(pieces)
    course.fill(LEAST)
    times = []
    for name, play in LIBRARY.items():
        for _ in range(counts[name]):
            begin = course.seconds
            play(course)
            times.append((begin, course.seconds))
    course.release()
    return course, times
