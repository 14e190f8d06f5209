"""Courses: experiments that identify a clutch, generated from its contact pressure, in a safe order.

The first finds the contact pressure by a slow staircase. The other five are those of the thesis, 24 s or less each. Together
they excite every parameter that can be identified from pressures, torques, slip and temperature.

References      Janssens 2010, figs 6.11 (pressure staircase and triangle), 6.12 (Stribeck sweeps at nine pressures), 6.14 (sine
                of the slip), 6.15 (multisine of the pressure), 6.8 (heating)
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from clutch_hil.bench.experiments import PRESSURE_RATE, RELEASE_TIME, STEP, Course
from plant_sim.profiles.profile import COLUMNS, PRESSURE_COLUMN, PRESSURE_LIMIT
from plant_sim.rigs.multisine import Multisine
from protocols.can.size import find_database, read_size
from protocols.files.units import RPM

# Seed of the multisine's phases: the same in every course, so that runs can be repeated; the value is arbitrary
MULTISINE_SEED = 615
LEAST, MOST = 0.35, 1.85  # bar above contact: the range of the maps of the thesis, 2.7 to 4.2 bar at 2.35 bar
HIGHEST = PRESSURE_LIMIT - 0.05  # bar: below the controller's pressure limit, with a margin for the regulator
# bar above contact: scaled by the pressure range of the bench's CAN database
_FARTHEST = MOST * read_size(find_database()).pressure
# Largest share of the motor's torque limit for the clutch: the motor must hold the speed against it
TORQUE_SHARE = 0.75
_LEVELS = (0.35, 0.5, 0.7, 0.9, 1.1, 1.3, 1.5, 1.7, 1.85)  # bar above contact: nine, as fig 6.12 has
_SPEED = 200 * RPM  # of the experiments at constant speed (6.3)
_SPEED_RATE = 100.0  # rad/s^2: 0.05 kg m^2 take 5 Nm
_ROUNDED = 0.001  # s, resolution of the times in a profile file
_FILL_ABOVE = 0.15  # bar above contact, of a gentle fill


@dataclass(frozen=True)
class Span:
    """Pressures allowed for a clutch: its `contact` pressure [bar], and the `reach` of the experiments above it [bar].

    slope: torque over pressure above contact [Nm/bar], 0 where it is not known.
    """

    contact: float
    reach: float = MOST
    slope: float = 0.0

    @classmethod
    def of_line(cls, slope: float, contact: float, torque: float) -> "Span":
        """Return the span of a clutch with `slope` [Nm/bar] above `contact` [bar] that may transmit `torque` [Nm]."""
        return cls(contact, min(_FARTHEST, torque / slope, HIGHEST - contact), slope)


class ClutchCourse(Course):
    """A course within the `span` of a clutch. Pressures are given in bar above contact and scaled so that MOST is its reach."""

    def __init__(self, span: Span, speed: float) -> None:
        self._span = span
        super().__init__(speed)

    def set_pressure_above(self, seconds: float, pressure: float, **values: float) -> None:
        """Ramp to a pressure [bar] above contact within `seconds` [s], scaled by reach/MOST."""
        self.to(seconds, pressure=self._span.contact + pressure * self._span.reach / MOST, **values)

    def approach(self, pressure: float, speed: float) -> None:
        """Ramp to a pressure [bar] above contact and a speed [rad/s], as fast as both may change."""
        target = self._span.contact + pressure * self._span.reach / MOST
        change = (
            abs(target - self._now["pressure"]) / PRESSURE_RATE,
            2.0 * abs(speed - self._now["speed"]) / _SPEED_RATE,
        )
        self.to(max(*change, STEP), pressure=target, speed=speed)

    def release(self, rest: float = RELEASE_TIME) -> None:
        """Set the demand to 0 within a sample, and wait for `rest` [s].

        From more than MOST above contact the pressure is ramped down first: without that load the motor would overspeed.
        """
        if self._now["pressure"] > (top := self._span.contact + MOST) + 1e-9:
            self.to((self._now["pressure"] - top) / PRESSURE_RATE, pressure=top)
        super().release(rest)

    @property
    def seconds(self) -> float:
        """Duration so far [s]."""
        return self.rows[-1][0]

    def fill(self, pressure: float) -> None:
        """Fill gently, then go to a pressure [bar] above contact."""
        self.set_pressure_above(STEP, _FILL_ABOVE)
        self.to(0.4)
        self.set_pressure_above(max(pressure - _FILL_ABOVE, 0.0) / PRESSURE_RATE + STEP, pressure)


def scale(span: Span) -> Course:
    """A slow staircase of the pressure at 200 rpm: where the torque begins (Table 6.3)."""
    course = ClutchCourse(span, _SPEED)
    course.set_pressure_above(STEP, -0.25)
    for level in np.linspace(-0.25, min(1.75, HIGHEST - span.contact), 11).tolist():
        course.set_pressure_above(0.3, level)
        course.to(0.6)
    course.release()
    return course


def make_stribeck(span: Span) -> Course:
    """Nine sweeps of the slip, 25 to 1 rad/s and back, each at another pressure (fig 6.12)."""
    course = ClutchCourse(span, 25.0)
    course.fill(_LEVELS[0])
    shares = np.abs(np.linspace(1.0, -1.0, 25))[1:]
    for level in _LEVELS:
        course.set_pressure_above(0.15, level)
        for share in shares.tolist():
            course.to(0.095, speed=1.0 + 24.0 * share**1.7)
    course.release(0.3)
    return course


def make_staircase(span: Span) -> Course:
    """Pressure staircase up and down, then triangles, at 200 rpm (fig 6.11)."""
    course = ClutchCourse(span, _SPEED)
    course.fill(LEAST)
    up = np.linspace(LEAST, MOST, 8).tolist()
    for level in up + up[-2::-1]:
        course.set_pressure_above(0.05, level)
        course.to(0.6)
    for level in (MOST, LEAST, 1.3, 0.7, MOST, LEAST):
        course.set_pressure_above(1.7, level)
    course.release()
    return course


def make_dynamics(span: Span) -> Course:
    """Multisine of the pressure at 200 rpm, then a sine of the slip of 5 Hz (figs 6.14, 6.15)."""
    course = ClutchCourse(span, _SPEED)
    course.fill(1.05)
    course.to(0.8)
    source = Multisine(np.arange(1, 26), amplitude=0.05, samples=200)
    wave = source.draw_period(np.random.default_rng(MULTISINE_SEED))
    for _ in range(8):
        for value in wave.tolist():
            course.set_pressure_above(1.0 / 200, 1.05 + value)
    course.set_pressure_above(0.1, 1.05)
    course.to(0.4, speed=100 * RPM)
    for k in range(1, 20 * 40 + 1):
        course.to(0.01, speed=100 * RPM + 50 * RPM * math.sin(2.0 * math.pi * k / 20))
    course.to(0.3)
    course.release()
    return course


def make_fills(span: Span) -> Course:
    """Six fills from an empty cylinder to other pressures; speeding up and down while it is open: springs, volumes, inertia."""
    course = ClutchCourse(span, 25.0)
    for level in (0.5, 0.8, 1.1, 1.4, 1.7, 1.0):
        course.to(20.0 / _SPEED_RATE, speed=5.0)
        course.to(0.8)
        course.fill(level)
        course.to(0.7)
        course.to(10.0 / _SPEED_RATE, speed=15.0)
        course.to(0.5)
        course.release(0.5)
        course.to(10.0 / _SPEED_RATE, speed=25.0)
    course.to(RELEASE_TIME)
    return course


def make_heating(span: Span) -> Course:
    """A long hold at a high pressure and speed, then a lower one: oil that warms and cools (fig 6.8, eq. 6.3)."""
    course = ClutchCourse(span, 23.0)
    course.fill(1.6)
    course.to(11.0)
    course.set_pressure_above(0.3, 0.9)
    course.to(0.2, speed=12.0)
    course.to(9.5)
    course.release()
    return course


# Experiments by name, with the initial oil temperature [degC] of a simulated rig
COURSES: Mapping[str, tuple[Callable[[Span], Course], float]] = {
    "stribeck": (make_stribeck, 70.0),
    "staircase": (make_staircase, 70.0),
    "dynamics": (make_dynamics, 72.0),
    "fills": (make_fills, 60.0),
    "heating": (make_heating, 95.0),
}
SCALE: tuple[Callable[[Span], Course], float] = (scale, 70.0)


def write_course(course: Course, title: str) -> str:
    """Return the text of a course's profile file."""
    rows, before = [], -1.0
    for time, torque, speed, pressure in course.rows:
        before = max(round(time, 3), round(before + _ROUNDED, 3))  # two rows a sample apart may be rounded to one time
        rows.append(f"{before:.3f},{torque:g},{speed:.4g},{pressure:.5g}")
    head = f"# {title}\n{','.join((*COLUMNS, PRESSURE_COLUMN))}\n"
    return head + "\n".join(rows) + "\n"
