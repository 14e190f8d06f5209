"""Checks of inputs by what the outputs tell of them: a load or a position that is late, frozen or off its zero."""

import numpy as np
import pytest

from clutch_hil.recordings.checks.finding import Finding
from clutch_hil.recordings.checks.inputs import find_late_inputs, find_still_inputs, find_zero_of_inputs
from clutch_hil.recordings.checks.knowledge import Implied, Knowledge, Recorded

PERIOD, ROWS = 2e-3, 6000
TIME = PERIOD * np.arange(ROWS)
RANDOM = np.random.default_rng(1)
LOAD = 5.0 + 3.0 * np.sin(1.3 * TIME) + np.sin(3.7 * TIME)
POSITION = 0.01 * np.sin(2.0 * TIME) + 0.004 * np.sin(5.1 * TIME)
SPEED = np.gradient(POSITION, PERIOD)
MEASURED_LOAD = LOAD + 0.02 * RANDOM.standard_normal(ROWS)
MEASURED_POSITION = POSITION + 1e-6 * RANDOM.standard_normal(ROWS)


def make_run(
    load: np.ndarray = MEASURED_LOAD, position: np.ndarray = MEASURED_POSITION, friction: float = 2.0
) -> Recorded:
    """Inputs as given; the force is that of LOAD and POSITION, with a friction of 40 % more than the baseline's."""
    force = friction * np.sign(SPEED) + 0.05 * RANDOM.standard_normal(ROWS)
    sentence = np.where(
        np.abs(SPEED) > 0.3 * np.abs(SPEED).max(), 1.4 * LOAD + 0.1 * RANDOM.standard_normal(ROWS), np.nan
    )
    implied = {
        "load_n": Implied("force_n", 0.1, values=sentence),
        "position_m": Implied("force_n", 0.05, friction=force, speed=np.gradient(position, PERIOD)),
    }
    columns = {"time_s": TIME, "load_n": load, "position_m": position, "force_n": force}
    known = {name: Knowledge(unit) for name, unit in (("load_n", "N"), ("position_m", "m"), ("force_n", "N"))}
    return Recorded("a run", columns, known, ("position_m", "load_n"), implied=implied)


def check_run(run: Recorded) -> list[Finding]:
    return [f for check in (find_late_inputs, find_still_inputs, find_zero_of_inputs) for f in check(run)]


def delay_values(values: np.ndarray, by: float) -> np.ndarray:
    return np.interp(TIME - by, TIME, values)


def freeze(values: np.ndarray, first: int, last: int) -> np.ndarray:
    return np.where((np.arange(ROWS) < first) | (np.arange(ROWS) > last), values, values[first])


def test_sound_inputs_are_told_nothing() -> None:
    assert check_run(make_run()) == []


@pytest.mark.parametrize(
    ("change", "check", "hard", "message"),
    [
        ({"load": delay_values(MEASURED_LOAD, 0.5)}, "delay", True, "s behind its course computed from force_n"),
        ({"load": delay_values(MEASURED_LOAD, -0.4)}, "delay", True, "s before its course computed from force_n"),
        ({"load": delay_values(MEASURED_LOAD, 0.18)}, "delay", False, "s behind its course"),
        ({"load": freeze(MEASURED_LOAD, 2000, 4000)}, "frozen", True, "load_n, rows 2000 to 4000, keeps"),
        ({"load": np.minimum(MEASURED_LOAD, 5.0)}, "frozen", True, "or is at its end"),
        ({"load": np.full(ROWS, 5.0)}, "dead", False, "is 5 N throughout, but by force_n it should move by"),
        ({"load": MEASURED_LOAD + 8.0}, "offset", False, "check its zero"),
        ({"position": freeze(MEASURED_POSITION, 500, 5500)}, "frozen", True, "reverses"),
        ({"position": freeze(MEASURED_POSITION, 1800, 2200)}, "frozen", False, "1 times in all such stretches"),
        ({"position": delay_values(MEASURED_POSITION, 0.4)}, "delay", True, "position_m, rows 0 to 5999, is 0.4"),
        ({"position": delay_values(MEASURED_POSITION, -0.2)}, "delay", False, "s before its course computed from force_n"),
    ],
)  # fmt: skip
def test_an_input_that_is_not_what_the_force_tells(
    change: dict[str, np.ndarray], check: str, hard: bool, message: str
) -> None:
    finding = check_run(make_run(**change))[0]
    assert (finding.check, finding.hard) == (check, hard), str(finding)
    assert message in str(finding)


def test_demands_and_friction_below_the_noise_tell_nothing() -> None:
    steps = np.repeat([2.0, 5.0, 3.0], ROWS // 3)  # a load that was set
    assert find_still_inputs(make_run(load=steps)) == []
    weak = make_run(position=freeze(MEASURED_POSITION, 500, 5500), friction=0.05)
    assert find_still_inputs(weak) == []
