"""Course pieces: parts of an experiment of about a second, from which a shorter one than the fixed courses is put together.

Each piece goes to its own pressure and speed first and stays in contact, so that no time is lost with filling between two of
them. They follow each other in the order of LIBRARY: pressures rise, and the clutch is opened at the end only.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from clutch_hil.identify.courses import LEAST, MOST, MULTISINE_SEED, ClutchCourse, Span
from plant_sim.rigs.multisine import Multisine
from protocols.files.units import RPM

Piece = Callable[[ClutchCourse], None]

_SPEED = 200 * RPM  # in which a course begins
_SLOW, _FAST = 1.0, 22.0  # rad/s of slip: the range of the maps (fig 6.12), with room to overshoot
_LEVELS = (LEAST, 0.6, 0.9, 1.2, 1.5, MOST)  # bar above contact
_MIDDLE = 1.05  # bar above contact: 3.4 bar where the thesis shows the dynamics


def _sweep(course: ClutchCourse, level: float) -> None:
    """Slip from fast to slow and back."""
    course.approach(level, _FAST)
    for share in np.abs(np.linspace(1.0, -1.0, 17))[1:].tolist():
        course.to(0.08, speed=_SLOW + (_FAST - _SLOW) * share**1.7)


def _play_crawl(course: ClutchCourse, level: float) -> None:
    """Two slow slips."""
    course.approach(level, 3.0)
    course.to(0.25)
    course.to(0.05, speed=_SLOW)
    course.to(0.25)


def _play_stairs(course: ClutchCourse, speed: float) -> None:
    """Four steps of the pressure."""
    course.approach(LEAST, speed)
    for level in (LEAST, 0.85, 1.35, MOST):
        course.approach(level, speed)
        course.to(0.15)


def _play_triangle(course: ClutchCourse, speed: float) -> None:
    """Pressure up and down."""
    course.approach(LEAST, speed)
    course.set_pressure_above(0.6, MOST)
    course.set_pressure_above(0.6, LEAST)


def _play_slip_sine(course: ClutchCourse, level: float) -> None:
    """Two periods of 5 Hz."""
    course.approach(level, 100 * RPM)
    for k in range(1, 41):
        course.to(0.01, speed=100 * RPM + 50 * RPM * math.sin(2.0 * math.pi * k / 20))


def _play_multisine(course: ClutchCourse, lines: Sequence[int], amplitude: float, samples: int) -> None:
    """One period of a multisine of the pressure, rows every 5 ms."""
    course.approach(_MIDDLE, _SPEED)
    wave = Multisine(np.array(lines), amplitude=amplitude, samples=samples).draw_period(
        np.random.default_rng(MULTISINE_SEED)
    )
    for value in wave.tolist():
        course.set_pressure_above(0.005, _MIDDLE + value)


def _hold(course: ClutchCourse) -> None:
    """High pressure and speed, which warm the oil."""
    course.approach(MOST, _FAST)
    course.to(1.0)


def _play_refill(course: ClutchCourse) -> None:
    """Open, speed up, and fill again from an empty cylinder."""
    course.release(0.45)
    course.to(0.1, speed=_SPEED - 8.0)
    course.to(0.1, speed=_SPEED)
    course.fill(LEAST)


# The pieces by name, in the order in which they are played
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
    """A course of these pieces, in the order of the library, and when each begins and ends [s]."""
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
