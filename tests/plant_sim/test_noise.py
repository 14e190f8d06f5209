"""Noise drawn by compiled code: NumPy's numbers, in NumPy's order, and nothing kept."""

import numpy as np
from numba import njit

from plant_sim.node.noise import draw, find_address
from tests.memory import measure_growth


@njit
def draw_numbers(source, numbers):
    draw(source, numbers)


def test_numbers_are_those_of_the_generator_however_many_at_once() -> None:
    generator, other = np.random.default_rng(5), np.random.default_rng(5)
    source = find_address(generator)
    for count in (1, 4, 4, 64, 3):
        numbers = np.zeros(count)
        draw_numbers(source, numbers)
        np.testing.assert_array_equal(numbers, other.standard_normal(count))
    assert generator.standard_normal() == other.standard_normal()  # Python goes on where compiled code ended


def test_nothing_beyond_the_array_is_written() -> None:
    generator, numbers = np.random.default_rng(5), np.zeros(10)
    draw_numbers(find_address(generator), numbers[3:7])
    assert np.flatnonzero(numbers).tolist() == [3, 4, 5, 6]


def test_drawing_keeps_no_memory() -> None:
    generator, numbers = np.random.default_rng(5), np.zeros(4)
    source = find_address(generator)

    def draw(count: int) -> None:
        for _ in range(count):
            draw_numbers(source, numbers)

    assert measure_growth(draw, 1, 1000) < 1000  # bytes: a generator handed over to Numba keeps 62 a call
