"""Runs that have the same samples: as copies, as text, as pieces; and runs that only look alike."""

import numpy as np
import pytest

from clutch_hil.recordings.checks.repeated import find_repeated

ROWS = 4000
TIME = 1e-3 * np.arange(ROWS)
Run = dict[str, np.ndarray]


def make_run(seed: int, noise: float = 0.005) -> Run:
    """A course that every run has, with noise of its own [bar, 10 Nm]; its first quarter is at rest."""
    random = np.random.default_rng(seed)
    course = np.where(TIME < 1.0, 0.0, np.sin(3.0 * TIME))
    return {
        "time_s": TIME,
        "valve_voltage_v": np.round(course, 2),
        "pressure_bar": 2.5 + course + noise * random.standard_normal(ROWS),
        "torque_nm": 10.0 * course + 10.0 * noise * random.standard_normal(ROWS),
    }


def cut(run: Run, first: int, last: int) -> Run:
    """Its rows `first` to `last`, with a time that begins at 0."""
    return {
        name: values[first : last + 1] - (values[first] if name == "time_s" else 0.0) for name, values in run.items()
    }


def as_text(run: Run, decimals: int) -> Run:
    return {name: np.round(values, decimals) for name, values in run.items()}


def drop_values(run: Run) -> Run:
    torque = run["torque_nm"].copy()
    torque[100:130] = np.nan
    return {**run, "torque_nm": torque}


ONE = make_run(1)


@pytest.mark.parametrize(
    ("first", "second", "rows", "those"),
    [
        (ONE, ONE, (0, 3999), (0, 3999)),
        (ONE, as_text(ONE, 6), (0, 3999), (0, 3999)),
        (ONE, as_text(ONE, 3), (0, 3999), (0, 3999)),
        (ONE, {name: ONE[name] for name in ("torque_nm", "time_s")}, (0, 3999), (0, 3999)),
        (ONE, cut(ONE, 1500, 2499), (0, 999), (1500, 2499)),
        (cut(ONE, 1500, 2499), ONE, (1500, 2499), (0, 999)),
        (cut(ONE, 0, 2499), cut(ONE, 1500, 3999), (0, 999), (1500, 2499)),
        (cut(ONE, 1500, 3999), cut(ONE, 0, 2499), (1500, 2499), (0, 999)),
        (drop_values(ONE), drop_values(ONE), (0, 3999), (0, 3999)),
        (make_run(1, 0.0), make_run(1, 0.0), (0, 3999), (0, 3999)),
    ],
)  # fmt: skip
def test_what_is_given_twice_is_told_with_its_rows(
    first: Run, second: Run, rows: tuple[int, int], those: tuple[int, int]
) -> None:
    (finding,) = find_repeated([("a", first), ("b", second)])
    assert (finding.check, finding.run, finding.hard, finding.rows) == ("repeated", "b", True, rows)
    assert f"are rows {those[0]} to {those[1]} of run a:" in finding.text


@pytest.mark.parametrize(
    "other",
    [
        make_run(2),
        cut(make_run(2), 0, 1999),
        as_text(make_run(2), 2),
        {**ONE, "torque_nm": make_run(2)["torque_nm"]},
        {**ONE, "torque_nm": ONE["torque_nm"] + np.where(TIME > 3.9, 1.0, 0.0)},
        {name: values + 1e-3 for name, values in ONE.items()},
        {"time_s": TIME, "speed_rad_s": ONE["torque_nm"]},
        {name: np.zeros(ROWS) for name in ONE},
        cut(ONE, 100, 140),
        {name: values[:0] for name, values in ONE.items()},
    ],
)  # fmt: skip
def test_what_only_looks_alike_is_evidence_of_its_own(other: Run) -> None:
    assert find_repeated([("a", ONE), ("b", other)]) == []
    assert find_repeated([("b", other), ("a", ONE)]) == []


def test_simulations_without_noise_may_begin_alike_and_rest_alike() -> None:
    still = make_run(1, 0.0)
    later = {**still, "torque_nm": np.where(TIME > 2.0, 0.9, 1.0) * still["torque_nm"]}
    at_rest = {name: np.full(ROWS, 2.0) for name in still}
    assert find_repeated([("a", still), ("b", later), ("c", at_rest), ("d", at_rest)]) == []


def test_each_run_is_told_once() -> None:
    findings = find_repeated([("a", ONE), ("b", make_run(2)), ("c", ONE), ("d", cut(ONE, 1000, 3000))])
    assert [(finding.run, finding.text.split(":")[0]) for finding in findings] == [
        ("c", "are rows 0 to 3999 of run a"), ("d", "are rows 1000 to 3000 of run a"),
    ]  # fmt: skip
