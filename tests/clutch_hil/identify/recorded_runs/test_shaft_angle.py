"""Recordings of a rig without an encoder, whose slip is measured by a tachometer."""

from pathlib import Path

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.bench.in_memory import simulate
from clutch_hil.identify.recorded_runs.run_evidence import read_evidence
from clutch_hil.identify.recorded_runs.shaft_angle import complete_angle, differentiate_angle, is_integrated
from protocols.files.run import Run
from protocols.files.runs import REQUIRED, write_run

ANGLE = "shaft_angle_rad"


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate("engagement", seconds=12.0, seed=7)


@pytest.fixture(scope="module")
def without(run: Run) -> Run:
    return Run({name: run[name] for name in REQUIRED if name != ANGLE}, {})


def test_the_angle_is_the_integral_of_the_slip(run: Run, without: Run) -> None:
    completed = complete_angle(without.columns)
    # rad: half a sample at the 10 rad/s of the run is 0.005; lines in place of means, and counts, stay within four times that
    assert np.max(np.abs(completed[ANGLE] - run[ANGLE] + run[ANGLE][0])) < 0.02
    assert is_integrated(completed)
    assert not is_integrated(run.columns)
    assert not is_integrated(without.columns | {ANGLE: np.zeros_like(run[ANGLE])})
    assert complete_angle(run.columns) is run.columns
    assert set(complete_angle({"time_s": np.arange(3.0)})) == {"time_s"}


def test_a_sound_rig_without_an_encoder_lacks_nothing_and_is_told_to_have_none(
    run: Run, without: Run, tmp_path: Path
) -> None:
    write_run(without, file := tmp_path / "run.csv")
    for one in (without, file):
        result = ch.find_discrepancy([one]).result
        assert result.verdict == "nothing_missing"
        assert [finding.column for finding in result.checks if finding.check == "derived"] == [ANGLE]
    assert not [finding for finding in ch.find_discrepancy([run]).result.checks if finding.check == "derived"]


def test_an_identification_reads_it_too(without: Run, tmp_path: Path) -> None:
    write_run(without, file := tmp_path / "run.csv")
    for one in (without, file):
        (columns,) = read_evidence([one], "wet_clutch", REQUIRED).measured.values()
        assert is_integrated(columns)


@pytest.mark.parametrize("column", ["slip_speed_rad_s", "cylinder_pressure_bar"])
def test_without_a_slip_or_another_column_it_is_refused(run: Run, column: str) -> None:
    left = Run({name: run[name] for name in REQUIRED if name not in (ANGLE, column)}, {})
    lacking = ANGLE if column == "slip_speed_rad_s" else column
    for refuse in (lambda: ch.find_discrepancy([left]), lambda: read_evidence([left], "wet_clutch", REQUIRED)):
        with pytest.raises(ch.InputError, match=f"lacks the column ({lacking}|{column})"):
            refuse()


@pytest.mark.parametrize("rate", [100, 200, 250, 499, 500, 1000, 2000])
def test_the_derivative_of_an_angle_is_its_speed(rate: int) -> None:
    time = np.arange(2 * rate) / rate
    speed = differentiate_angle(time, 5.0 * time + 0.3 * np.sin(4.0 * time))
    inside = slice(max(1, round(0.013 * rate)), -max(1, round(0.013 * rate)))  # beside them the angle goes on straight
    # the third derivative is 19.2 rad/s^3 at most, of which T^2/6 is lost, or half the square of the Gaussian's width
    least = 19.2 * max(0.5 * 2e-3**2, 1.0 / (6.0 * rate**2)) + 1e-6
    np.testing.assert_allclose(speed[inside], (5.0 + 1.2 * np.cos(4.0 * time))[inside], atol=least)
    assert speed[[0, -1]] == pytest.approx(5.0 + 1.2 * np.cos(4.0 * time[[0, -1]]), abs=0.05)
