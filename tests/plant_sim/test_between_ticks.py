"""Slots of the plant lie between ticks of the kernel."""

import time

import numpy as np
import pytest

from plant_sim.node.plant_service import find_first_slot


@pytest.mark.parametrize("rate", [250, 500, 1000, 2000, 4000, 8000, 10_000])
def test_neither_a_sample_nor_its_answer_meets_a_tick_of_the_kernel(rate: int) -> None:
    """Which comes every 1, 4 or 10 ms; the answer half a period after the sample."""
    period, now = 1_000_000_000 // rate, time.monotonic_ns()
    first = find_first_slot(now, period)
    assert period < first - now < 3 * period
    after = (first + period // 2 * np.arange(200)) % 1_000_000
    assert np.minimum(after, 1_000_000 - after).min() >= min(period, 1_000_000) // 4
