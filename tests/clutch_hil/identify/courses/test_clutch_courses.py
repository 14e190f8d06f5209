"""Courses of a clutch on a bench that carries more pressure than the shipped one."""

import numpy as np
import pytest

from clutch_hil.bench.experiments import PRESSURE_RATE, RELEASE_TIME, STEP
from clutch_hil.identify.courses.clutch_courses import COURSES, HIGHEST, MOST, ClutchCourse, Span, write_course
from clutch_hil.identify.frequency_response import _find_excited


def test_the_shipped_bench_reaches_as_far_as_the_maps_of_the_thesis() -> None:
    assert pytest.approx(4.45) == HIGHEST
    assert Span.of_line(10.0, 2.0, 300.0).reach == pytest.approx(MOST)
    assert Span.of_line(10.0, 3.5, 300.0).reach == pytest.approx(0.95)
    assert Span.of_line(10.0, 2.0, 5.0).reach == pytest.approx(0.5)


@pytest.mark.parametrize(("reach", "first"), [(MOST, 0.0), (7.4, 2.35 + MOST)])
def test_from_far_above_contact_the_pressure_goes_down_before_the_clutch_opens(reach: float, first: float) -> None:
    course = ClutchCourse(Span(2.35, reach), 25.0)
    course.fill(MOST)
    course.release()
    time, pressure = np.array(course.rows)[:, 0], np.array(course.rows)[:, 3]
    top = int(np.argmax(pressure))
    assert pressure[top] == pytest.approx(2.35 + reach)
    assert pressure[top + 1] == pytest.approx(first)
    assert pressure[-2:] == pytest.approx([0.0, 0.0])
    assert time[-1] - time[top] == pytest.approx((reach - MOST) / PRESSURE_RATE + STEP + RELEASE_TIME)


def test_with_a_large_reach_no_course_opens_the_clutch_from_far_above_contact() -> None:
    for make, _ in COURSES.values():
        pressure = np.array(make(Span(4.0, 7.4)).rows)[:, 3]
        before = pressure[:-1][(pressure[1:] == 0.0) & (pressure[:-1] > 0.0)]
        assert len(before)
        assert before.max() <= 4.0 + MOST + 1e-9


def test_the_times_of_every_course_increase_whatever_the_reach() -> None:
    """Rows one sample apart were rounded to one time, and the profile was refused."""
    for reach in np.linspace(0.5, 8.0, 76):
        for make, _ in COURSES.values():
            course = make(Span(3.5, float(reach)))
            times = [float(line.partition(",")[0]) for line in write_course(course, "t").splitlines()[2:]]
            assert np.all(np.diff(times) > 0.0), (make.__name__, reach)
            assert times == pytest.approx([row[0] for row in course.rows], abs=0.00151)


def test_a_demand_that_stands_still_excites_no_line() -> None:
    frequency = np.fft.rfftfreq(100, 0.01)
    assert not _find_excited(frequency, np.zeros_like(frequency), 1e-3).any()
    power = np.where(frequency == 5.0, 1.0, 0.0)
    assert frequency[_find_excited(frequency, power, 1e-3)].tolist() == [5.0]
