"""Experiments: pressure profiles that identify a clutch. `python -m clutch_hil.bench.experiments` writes them.

Each consists of straight lines. The docstring of its function is the first line of its file in `profiles`; a test compares
files and functions. All but the cold start command the cylinder pressure at a set slip, as chapter 6 of Janssens 2010 does.

References      Janssens 2010, figs 6.11 (torque over pressure), 6.12 (torque over slip), 6.14 (sine of the slip),
                6.15 (multisine of the pressure); Pintelon & Schoukens 2012, ch. 4 (multisine)
"""

import math
from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np

from plant_sim.profiles.profile import COLUMNS, FILL_PRESSURE, FOLDER, PRESSURE_COLUMN
from plant_sim.rigs.multisine import Multisine
from protocols.files.units import RPM

PRESSURE = 3.4  # bar, where the dynamics of the thesis were identified (figs 6.14, 6.15)
PRESSURE_RATE = 4.0  # bar/s: the pressure overshoots by 0.08 bar, after a step by 0.16 bar
STEP = 0.001  # s, one sample at 1 kHz
IDLE_TIME = 0.3  # s before the first demand: the controller needs a request for idle first
FILL_TIME = 0.2  # s at the fill pressure; the fill takes 0.13 s
SETTLING_TIME = 1.0  # s after a rise; the pressure error is below 5 mbar after 0.55 s
REVERSAL_TIME = 0.05  # s from one direction of slip to the other: 0.05 kg m^2 take 40 Nm from 20 to -20 rad/s
RELEASE_TIME = 0.5  # s after the last demand; the release takes 0.2 s


class Course:
    """Rows of a profile over time: straight lines between set-points."""

    def __init__(self, speed: float) -> None:
        self._time, self._now = 0.0, {"torque": 0.0, "speed": speed, "pressure": 0.0}
        self.rows = [self._make_row()]
        self.to(IDLE_TIME)

    def to(self, seconds: float, **values: float) -> None:
        """Ramp to torque [Nm], speed [rad/s] or pressure [bar] within `seconds` [s]; other set-points are unchanged."""
        self._time += seconds
        self._now |= values
        self.rows.append(self._make_row())

    def close(self, hold: float, pressure: float) -> None:
        """Fill, ramp to `pressure` [bar] at PRESSURE_RATE, and hold for `hold` [s]."""
        self.to(STEP, pressure=FILL_PRESSURE)
        self.to(FILL_TIME)
        self.to(max((pressure - FILL_PRESSURE) / PRESSURE_RATE, STEP), pressure=pressure)
        self.to(hold)

    def release(self, rest: float = RELEASE_TIME) -> None:
        """Set the demand to 0 within a sample, and wait for `rest` [s]."""
        self.to(STEP, torque=0.0, pressure=0.0)
        self.to(rest)

    def _make_row(self) -> tuple[float, ...]:
        return self._time, self._now["torque"], self._now["speed"], self._now["pressure"]


def make_stribeck_staircase() -> Course:
    """3.4 bar, slip in steps of 1 s from 25 to 1 rad/s and back: torque over slip, both ways (fig 6.12)."""
    down = (25.0, 20.0, 15.0, 10.0, 7.0, 5.0, 3.0, 2.0, 1.0)  # rad/s, denser where the Stribeck curve bends
    course = Course(down[0])
    course.close(SETTLING_TIME, PRESSURE)
    for speed in down[1:] + down[-2::-1]:
        course.to(0.1, speed=speed)  # the motor's 0.05 kg m^2 need less than 3 Nm
        course.to(0.9)
    course.release()
    return course


def make_slip_sine() -> Course:
    """3.4 bar, slip of 100 rpm and a sine of 60 rpm: 0.5 Hz for the curve, 5 Hz for the lag of friction (fig 6.14)."""
    course = Course(100 * RPM)
    course.close(SETTLING_TIME, PRESSURE)
    for frequency, periods in ((0.5, 2), (5.0, 20)):  # Hz
        for k in range(1, 20 * periods + 1):  # 20 rows a period: the straight lines lose 0.4 % of the sine
            course.to(0.05 / frequency, speed=100 * RPM + 60 * RPM * math.sin(2.0 * math.pi * k / 20))
    course.to(0.5)
    course.release()
    return course


def make_multisine() -> Course:
    """3.4 bar, 200 rpm, multisine of 1 to 30 Hz, 30 mbar a line: 2 realisations of 5 periods of 1 s (fig 6.15)."""
    # Rows every 5 ms: straight lines between them act as sinc^2, 7 % at 30 Hz, which is part of the recorded demand.
    source = Multisine(np.arange(1, 31), amplitude=0.03, samples=200)
    random = np.random.default_rng(615)
    course = Course(200 * RPM)
    course.close(SETTLING_TIME, PRESSURE)
    for _ in range(2):
        for value in np.tile(source.draw_period(random), 5):
            course.to(0.005, pressure=PRESSURE + float(value))
    course.to(0.3, pressure=PRESSURE)
    course.release()
    return course


def hold_and_release() -> Course:
    """3.4 bar held for 1 s, released, and again after 0.4, 0.8, 1.6 and 3.2 s: what the rest between two fills changes."""
    course = Course(100 * RPM)
    for rest in (0.4, 0.8, 1.6, 3.2, RELEASE_TIME):
        course.close(SETTLING_TIME, PRESSURE)
        course.release(rest)
    return course


def make_seal_hysteresis_triangle() -> Course:
    """200 rpm, pressure up and down at 0.5 bar/s, 2.6 to 4.2 bar, inner loops on both branches, a small one (fig 6.11)."""
    rate = 0.5  # bar/s: the pressure loop of 10 Hz lags by 8 mbar
    corners = (2.6, 4.2, 2.6, 3.6, 3.0, 3.6, 4.2, 3.2, 3.8, 3.2, 2.6, 3.0, 2.6)
    course = Course(200 * RPM)
    course.close(SETTLING_TIME, corners[0])
    for before, after in pairwise(corners):
        course.to(abs(after - before) / rate, pressure=after)
    course.release()
    return course


def make_cold_start() -> Course:
    """Torque in gentle steps for oil of 40 degC: touch, 3, 8 and 14 Nm, a faster slip, and release."""
    course = Course(100 * RPM)
    for torque, rise, hold in ((3.0, 0.5, 2.0), (8.0, 0.5, 2.5), (14.0, 0.5, 2.5)):
        course.to(rise, torque=torque)
        course.to(hold)
    course.to(1.0, speed=150 * RPM)
    course.to(2.0)
    course.to(0.5, torque=0.0)
    course.release()
    return course


def make_drift() -> Course:
    """Seven engagements of 2 s at 3.4 bar and 200 rpm: what changes from one to the next."""
    course = Course(200 * RPM)
    for _ in range(7):
        course.close(2.0, PRESSURE)
        course.release()
    return course


def make_reversals() -> Course:
    """Slip there and back: flips at 3.4 bar from 5, 10 and 20 rad/s, slow sines of 2 and 6 rad/s at 2.6 bar."""
    course = Course(5.0)
    course.close(0.7, PRESSURE)
    for speed in (5.0, 10.0, 20.0):
        course.to(0.1, speed=speed)
        for sign in (-1.0, 1.0, -1.0, 1.0):
            # The torque turns within the 0.1 s in which the controller tolerates a motor torque that contradicts the estimate.
            course.to(REVERSAL_TIME, speed=sign * speed)
            course.to(0.5)
    course.to(0.2, speed=2.0, pressure=FILL_PRESSURE)
    course.to(0.5)
    for amplitude, frequency, periods in ((2.0, 1.0, 2), (6.0, 0.5, 2)):
        for k in range(1, 20 * periods + 1):
            course.to(0.05 / frequency, speed=amplitude * math.cos(2.0 * math.pi * k / 20))
    course.release()
    return course


def make_pressure_steps() -> Course:
    """Steps of 0.2 to 1.2 bar every 0.4 s at 25, 10 and 3 rad/s, after a fill each: delay, lag and gain of the valve."""
    levels = (3.4, 3.2, 3.8, 2.8, 4.0, 3.0, 3.4, 4.0, 2.8, 3.6)
    course = Course(25.0)
    for speed in (25.0, 10.0, 3.0):
        course.to(0.2, speed=speed)
        course.close(0.6, levels[0])
        for level in levels[1:]:
            course.to(STEP, pressure=level)
            course.to(0.4)
        course.release(0.6)
    return course


def make_crawl() -> Course:
    """Slip of 4 rad/s at 3.8 bar and at 3 bar, then 9 rad/s: ripples that go with the angle, and whether load scales them."""
    course = Course(4.0)
    course.close(0.5, 3.8)
    course.to(5.0)
    course.to(0.3, pressure=3.0)
    course.to(5.0)
    course.to(0.3, speed=9.0)
    course.to(3.0)
    course.release()
    return course


def make_long_hold() -> Course:
    """3.8 bar and 24 rad/s held for 12 s, opened for 1, 3 and 0.5 s, each time closed again: what heat and rest change."""
    course = Course(24.0)
    course.close(12.0, 3.8)
    for rest in (1.0, 3.0, RELEASE_TIME):
        course.release(rest)
        course.close(0.6, 3.8)
    course.release()
    return course


def open_sweep() -> Course:
    """Slip up to 25 rad/s and back with the clutch open, closed at 2.6 bar, and open again: drag, and offsets of sensors."""
    course = Course(0.0)
    for _ in range(2):
        course.to(2.0, speed=25.0)
        course.to(0.5)
        course.to(2.0, speed=1.0)
        course.to(0.3, speed=15.0)
        course.close(1.0, FILL_PRESSURE)
        course.release()
    return course


def make_loads_and_slips() -> Course:
    """Nine pairs of 2.8, 3.4 and 4 bar with 4, 12 and 25 rad/s, in an order that does not go with time, then again."""
    order = (
        (3.4, 12.0),
        (2.8, 25.0),
        (4.0, 4.0),
        (2.8, 12.0),
        (3.4, 25.0),
        (2.8, 4.0),
        (4.0, 25.0),
        (3.4, 4.0),
        (4.0, 12.0),
    )
    course = Course(order[0][1])
    for _ in range(2):
        course.close(0.5, order[0][0])
        for pressure, speed in order:
            course.to(0.2, pressure=pressure, speed=speed)
            course.to(0.8)
        course.release()
    return course


def make_broadband() -> Course:
    """Multisines of the pressure, 0.3 to 20 Hz, and of the slip, 0.2 to 8 Hz, together about 3.4 bar and 14 rad/s."""
    random = np.random.default_rng(86)
    course = Course(14.0)
    for _ in range(2):
        pressure = Multisine(np.unique(np.geomspace(3, 200, 24).round()).astype(int), amplitude=0.05, samples=1000)
        speed = Multisine(np.unique(np.geomspace(2, 80, 16).round()).astype(int), amplitude=1.5, samples=1000)
        values = zip(pressure.draw_period(random), speed.draw_period(random), strict=True)
        course.close(0.5, PRESSURE)
        for p, w in values:
            course.to(0.01, pressure=PRESSURE + float(p), speed=14.0 + float(w))
        course.release()
    return course


EXPERIMENTS: Mapping[str, Callable[[], Course]] = {
    make.__name__.removeprefix("make_"): make
    for make in (
        make_stribeck_staircase,
        make_slip_sine,
        make_multisine,
        hold_and_release,
        make_seal_hysteresis_triangle,
        make_cold_start,
        make_drift,
        make_reversals,
        make_pressure_steps,
        make_crawl,
        make_long_hold,
        open_sweep,
        make_loads_and_slips,
        make_broadband,
    )
}


def write_text(name: str) -> str:
    """Return the contents of the file of an experiment."""
    make = EXPERIMENTS[name]
    rows = (f"{time:.3f},{torque:g},{speed:.4g},{pressure:.5g}" for time, torque, speed, pressure in make().rows)
    head = f"# {make.__doc__}\n# Written by python -m clutch_hil.bench.experiments.\n{','.join((*COLUMNS, PRESSURE_COLUMN))}\n"
    return head + "\n".join(rows) + "\n"


if __name__ == "__main__":
    for name in EXPERIMENTS:
        (FOLDER / f"{name}.csv").write_text(write_text(name), encoding="utf-8")
    print(f"wrote {len(EXPERIMENTS)} profiles to {FOLDER}")
