"""Shift courses: experiments that identify a power-shift rig, generated from the contact pressures, in a safe order.

No brake holds the vehicle: a clutch that transmits torque accelerates it, and the slip vanishes. So the direction of the input
alternates, and the vehicle follows. The first course finds the contact pressures by slow staircases. The others are those of
one clutch (clutch_courses.py), for clutch a and for clutch b, and a hand-over by pressures.

References      Janssens 2010, figs 6.11 (staircase), 6.12 (Stribeck sweeps), 6.14 (sine of the slip), 6.15 (multisine), 6.1
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from clutch_hil.bench.experiments import IDLE_TIME, PRESSURE_RATE, STEP
from clutch_hil.identify.courses.clutch_courses import MOST, MULTISINE_SEED, Span
from plant_sim.profiles.shift_profile import COLUMNS, PRESSURE_COLUMNS
from plant_sim.rigs.multisine import Multisine
from protocols.can.two_clutches import CLUTCHES

_LEVELS = (0.35, 0.5, 0.7, 0.9, 1.1, 1.3, 1.5, 1.7, 1.85)  # bar above contact: nine, as fig 6.12 has
_SPEED = 13.0  # rad/s: with 10 rad/s of the vehicle in addition, the slip stays within the guard's 31 rad/s
# rad/s, input speed of the hand-over: the vehicle reaches 3 rad/s, and is then driven in the other direction
_DRIVE = 16.0
_FASTEST = 20.0  # rad/s, first speed of a sweep over the whole friction curve
_SLOWEST = 8.0  # rad/s, first speed of a sweep over the slips that separate M_C from C_v
_SLOW_LEVELS = 3  # number of lower pressures, whose torque hardly drives the vehicle
_SLOW = 1.4  # s, duration of a sweep at one of these
_QUICK = 0.9  # s, duration of a sweep at a higher pressure: the vehicle does not reach the speed of the input
# Shares of the first speed, used to the power of 1.5: they go past 0, because the vehicle moves
_SLOWING = np.linspace(1.0, -0.2, 21)[1:].tolist()
_TURN = 0.15  # s from one direction of the input to the other: an inertia of 0.05 kg m^2 needs 9 Nm
_FILL_ABOVE = 0.15  # bar above contact, of a gentle fill


@dataclass(frozen=True)
class Spans:
    """Pressure span of each clutch, and the gear ratios."""

    of: Mapping[str, Span]
    ratios: tuple[float, float]


class ShiftCourse:
    """Rows of a shift profile over time, within the pressure spans of both clutches.

    Pressures are given in bar above contact and scaled so that MOST is the largest one that the clutch may reach.
    """

    def __init__(self, title: str, spans: Spans, speed: float) -> None:
        """title: a sentence that describes the course. speed: initial speed of the input [rad/s]."""
        self.title = title
        self._spans, self._time, self._speed = spans, 0.0, speed
        self._pressures = dict.fromkeys(CLUTCHES, 0.0)
        self.rows = [self._make_row()]
        self.to(IDLE_TIME)

    def to(self, seconds: float, speed: float | None = None, **above: float) -> None:
        """Ramp to an input speed [rad/s] and pressures of a and b [bar] above contact, linearly within `seconds` [s]."""
        self._time += seconds
        self._speed = self._speed if speed is None else speed
        for clutch, pressure in above.items():
            span = self._spans.of[clutch]
            self._pressures[clutch] = span.contact + pressure * span.reach / MOST
        self.rows.append(self._make_row())

    def fill(self, clutch: str, pressure: float) -> None:
        """Fill a clutch gently, then go to a pressure [bar] above contact."""
        self.to(STEP, **{clutch: _FILL_ABOVE})
        self.to(0.4)
        self.to(max(pressure - _FILL_ABOVE, 0.0) / PRESSURE_RATE + STEP, **{clutch: pressure})

    def release(self, clutch: str, rest: float = 0.4) -> None:
        """Open a clutch and wait for `rest` [s]."""
        self._time += STEP
        self._pressures[clutch] = 0.0
        self.rows.append(self._make_row())
        self.to(rest)

    def _make_row(self) -> tuple[float, ...]:
        return self._time, 0.0, 0.0, self._speed, *self._pressures.values()


def make_scale(spans: Spans) -> ShiftCourse:
    """Return a slow pressure staircase of each clutch with alternating input: it shows where the torque begins (Table 6.3)."""
    course = ShiftCourse("Slow staircases of the pressure of clutch a and b: where the torque begins.", spans, _SPEED)
    for clutch in CLUTCHES:
        course.to(STEP, **{clutch: -0.25})
        course.to(0.5)
        for k in range(10):
            course.to(0.15, **{clutch: -0.25 + 0.2 * k})
            course.to(0.3)
            course.to(_TURN, speed=-_SPEED if k % 2 == 0 else _SPEED)
            course.to(0.3)
        course.release(clutch)
    return course


def make_stribeck(spans: Spans, clutch: str, fastest: float) -> ShiftCourse:
    """Return sweeps of the input from `fastest` [rad/s], in both directions, at nine pressures of a clutch (fig 6.12).

    Sweeps at the lower pressures, whose torque hardly drives the vehicle, are longer.
    """
    title = f"The input slows down from {fastest:g} rad/s at nine pressures of clutch {clutch}."
    course = ShiftCourse(title, spans, fastest)
    course.fill(clutch, _LEVELS[0])
    for k, level in enumerate(_LEVELS):
        course.to(0.1, **{clutch: level})
        seconds = _SLOW if k < _SLOW_LEVELS else _QUICK
        for way in (1.0, -1.0):
            for share in _SLOWING:
                course.to(seconds / len(_SLOWING), speed=way * fastest * math.copysign(abs(share) ** 1.5, share))
            course.to(_TURN, speed=-way * fastest)
    course.release(clutch)
    return course


def make_dynamics(spans: Spans) -> ShiftCourse:
    """Return for each clutch a pressure multisine and a 5 Hz sine of the slip, with alternating input (figs 6.14, 6.15)."""
    course = ShiftCourse("Multisine of the pressure, and sine of the slip, of clutch a and b.", spans, _SPEED)
    source = Multisine(np.arange(1, 26), amplitude=0.05, samples=100)
    wave = source.draw_period(np.random.default_rng(MULTISINE_SEED)).tolist()
    for clutch in CLUTCHES:
        course.fill(clutch, 1.05)
        for k in range(4):
            for value in wave:
                course.to(0.01, **{clutch: 1.05 + value})
            course.to(_TURN, speed=-_SPEED if k % 2 == 0 else _SPEED, **{clutch: 1.05})
        for k in range(4):
            way = 1.0 if k % 2 == 0 else -1.0
            for i in range(1, 81):
                course.to(0.01, speed=way * (11.0 + 4.0 * math.sin(2.0 * math.pi * i / 20)))
            course.to(_TURN, speed=-way * 11.0)
        course.to(_TURN, speed=_SPEED)
        course.release(clutch)
    return course


def make_fills(spans: Spans) -> ShiftCourse:
    """Return for each clutch four fills of the empty cylinder, with alternating input: they excite springs, volumes and
    inertia."""
    course = ShiftCourse("Fills of clutch a and b from an empty cylinder.", spans, _FASTEST)
    for clutch in CLUTCHES:
        for k, level in enumerate((0.6, 1.0, 1.4, 1.7)):
            way = 1.0 if k % 2 == 0 else -1.0
            course.to(0.3, speed=way * 5.0)
            course.to(0.4)
            course.to(0.2, speed=way * _SPEED)
            course.fill(clutch, level)
            course.to(0.4)
            course.release(clutch)
    return course


def make_hand_over(spans: Spans) -> ShiftCourse:
    """Return a hand-over: clutch a drives the vehicle, then clutch b with the same torque, in both directions (fig 6.1)."""
    ratio = spans.ratios[0] / spans.ratios[1]
    torque = 0.5 * min(span.slope * span.reach for span in spans.of.values() if span.slope)  # Nm, of clutch b
    levels = {
        clutch: part * torque / span.slope * MOST / span.reach
        for (clutch, span), part in zip(spans.of.items(), (1.0 / ratio, 1.0), strict=True)
    }
    course = ShiftCourse("The torque passes from clutch a to clutch b, forward and backward.", spans, _DRIVE)
    for way in (1.0, -1.0):
        course.to(0.3, speed=way * _DRIVE)
        course.fill("a", levels["a"])
        course.to(0.2)
        course.to(STEP, b=_FILL_ABOVE)
        course.to(0.5)
        course.to(0.5, b=levels["b"])  # first, because the pressure at which clutch b sets in is not yet known
        course.to(0.4, a=0.0)
        course.release("a", 0.6)
        course.release("b")
    return course


# Experiments by name, with the initial oil temperature [degC] of a simulated rig. The oil is cold in the first sweeps: only the
# viscous part depends on temperature, so 40 and 95 degC separate C_v from M_C and V_S nearly twice as well as 70 and 95 degC
COURSES: Mapping[str, tuple[Callable[[Spans], ShiftCourse], float]] = {
    "stribeck_a": (lambda spans: make_stribeck(spans, "a", _FASTEST), 40.0),
    "stribeck_b": (lambda spans: make_stribeck(spans, "b", _FASTEST), 40.0),
    "crawl_a": (lambda spans: make_stribeck(spans, "a", _SLOWEST), 95.0),
    "crawl_b": (lambda spans: make_stribeck(spans, "b", _SLOWEST), 95.0),
    "dynamics": (make_dynamics, 85.0),
    "fills": (make_fills, 60.0),
    "hand_over": (make_hand_over, 70.0),
}
SCALE: tuple[Callable[[Spans], ShiftCourse], float] = (make_scale, 70.0)


def format_course(title: str, rows: Sequence[tuple[float, ...]]) -> str:
    """Return the text of a course's profile file."""
    lines = (f"{time:.4f},{a:g},{b:g},{speed:.4g},{p:.5g},{q:.5g}" for time, a, b, speed, p, q in rows)
    return f"# {title}\n{','.join((*COLUMNS, *PRESSURE_COLUMNS))}\n" + "\n".join(lines) + "\n"
