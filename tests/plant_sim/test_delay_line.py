"""A delay line gives a ramp back late by the delay, whatever the step is, also after its last step."""

from types import SimpleNamespace

import numpy as np
import pytest

from plant_sim.blocks.delay_line import AT_END, AT_MID_STEP, LEAST_STEP, begin_step, read_delayed

EXACT = 1e-9  # s: rounding of some ten thousand steps


@pytest.mark.parametrize("step", [1e-4, LEAST_STEP, 4.9e-5, 2e-5, 7e-6])
@pytest.mark.parametrize(("size", "delay"), [(1024, 0.05), (1024, 3.3e-3), (1024, 1e-5), (32, 1.5e-3)])
@pytest.mark.parametrize("age", [AT_END, AT_MID_STEP])
def test_a_ramp_is_late_by_the_delay(step: float, size: int, delay: float, age: float) -> None:
    past, x = np.zeros(size), SimpleNamespace(taken=0.0, step=0.0)
    for k in range(round(0.06 / step)):
        now = (k + 1 - age) * step
        begin_step.py_func(x, step)
        late = read_delayed.py_func(past, x, now, delay, age, step)
        at_end = read_delayed.py_func(past, x, now + age * step, delay, age, 0.0)
        if now > delay + 2.0 * LEAST_STEP + step:
            assert late == pytest.approx(now - delay, abs=EXACT)
            assert at_end == pytest.approx(now + age * step - delay, abs=EXACT)
