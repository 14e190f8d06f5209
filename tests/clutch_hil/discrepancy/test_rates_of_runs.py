"""Rates of runs: times and frequencies of a residual are right at any rate, and for runs of several rates together."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.signal import lfilter

from clutch_hil.discrepancy.models.wet_clutch_sources import _balance_motor
from clutch_hil.discrepancy.report.residuals import Residuals
from clutch_hil.discrepancy.residual_statistics import compute_statistics
from clutch_hil.discrepancy.result import NONE_OF_THESE, NOTHING
from clutch_hil.discrepancy.search import investigate
from clutch_hil.discrepancy.surrogate_term import describe_residual
from clutch_hil.fitting.model import Candidate, Columns, Output, Values
from protocols.files.parameters import ParameterSet

DEMAND, FORCE = "demand_v", "force_n"
RATES = ((100.0,), (300.0,), (1000.0,), (100.0, 300.0), (1000.0, 300.0, 300.0))  # Hz; of 4 ms, 300 Hz has 1.2 rows
SECONDS, NOISE = 30.0, 0.02  # s, N
HUM = 0.5  # N
HUMS = 0.05  # of an autocorrelation: lags of a fortieth of a run, and noise
WEAK_TERM = 0.05  # of R2 for a term as small as the noise; in 60 draws it was 0.958 to 1
STRONG_TERM = 0.02  # of R2 for a term far above the noise; in 30 draws it was 0.993 to 1
HERTZ = 0.5  # Hz, two lines of a spectrum over 2 s
MEMORY, NEAR = 0.1, 0.4  # s, of a residual; relative, from one run in twenty draws it was at most 0.3 off


class Spring:
    """A force of 2 N/V."""

    name = "spring"
    inputs: tuple[str, ...] = (DEMAND,)
    outputs: tuple[Output, ...] = (Output(FORCE, "N", "spring"),)
    parameters = ParameterSet({})
    candidates: tuple[Candidate, ...] = ()

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> Columns:
        """See `Model`."""
        return {FORCE: 2.0 * run[DEMAND]}


def record(rate: float, added: np.ndarray | float = 0.0, seed: int = 0) -> dict[str, np.ndarray]:
    """Record a spring whose demand varies at 1.7 Hz, with a force `added` (n,)."""
    time = np.arange(round(SECONDS * rate)) / rate
    demand = np.sin(2.0 * np.pi * 1.7 * time)
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(time))
    return {"time_s": time, DEMAND: demand, FORCE: 2.0 * demand + added + noise}


def hum(rate: float, hertz: float, phase: float) -> np.ndarray:
    return HUM * np.sin(2.0 * np.pi * hertz * np.arange(round(SECONDS * rate)) / rate + phase)


@pytest.mark.parametrize("rates", RATES)
def test_a_hum_has_its_frequency(rates: Sequence[float]) -> None:
    runs = [record(rate, hum(rate, 31.0, float(k)), k) for k, rate in enumerate(rates)]
    sentence = describe_residual(Spring(), runs, {FORCE: NOISE}, {}, {})["sentence"]
    assert float(sentence.partition("oscillates at ")[2].partition(" Hz")[0]) == pytest.approx(31.0, abs=HERTZ)


@pytest.mark.parametrize("rates", RATES)
def test_statistics_have_their_times_and_frequencies(rates: Sequence[float]) -> None:
    runs = []
    for k, rate in enumerate(rates):
        keep = np.exp(-1.0 / (rate * MEMORY))
        white = np.random.default_rng(7 + k).standard_normal(round(SECONDS * rate))
        runs.append(record(rate, lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white)))
        runs[-1][FORCE] = runs[-1][FORCE] + 0.5 * runs[-1][DEMAND]
    shown = compute_statistics(Spring(), runs, {FORCE: NOISE}, {}, {})["outputs"][FORCE]
    assert shown["autocorrelation_s"] == pytest.approx(MEMORY, rel=NEAR)
    assert shown["coherence"][DEMAND]["hz"] == pytest.approx(1.7, abs=HERTZ)


@pytest.mark.parametrize("rates", RATES)
def test_the_report_has_their_times_and_frequencies(rates: Sequence[float]) -> None:
    runs = {f"{k}": record(rate, hum(rate, 31.0, float(k)), k) for k, rate in enumerate(rates)}
    residuals = Residuals(investigate(Spring(), runs))
    frequency, density = residuals.compute_spectrum(FORCE, "before")
    assert frequency[np.argmax(density)] == pytest.approx(31.0, abs=HERTZ)
    lags, values, _ = residuals.compute_autocorrelation(FORCE, "before")
    np.testing.assert_allclose(values, np.cos(2.0 * np.pi * 31.0 * lags), atol=HUMS)


@pytest.mark.parametrize("rate", [100.0, 300.0, 1000.0])
def test_a_speed_that_the_motor_explains_is_no_error_of_the_drive(rate: float) -> None:
    time = np.arange(round(4.0 * rate)) / rate
    inertia, speed = 0.05, np.sin(2.0 * np.pi * time)
    turning = inertia * 2.0 * np.pi * np.cos(2.0 * np.pi * time)
    still = {"slip_speed_rad_s": np.zeros_like(time), "motor_torque_nm": np.zeros_like(time)}
    left = _balance_motor(
        {"time_s": time}, {"slip_speed_rad_s": speed, "motor_torque_nm": turning}, still, {"motor.inertia": inertia}
    )
    assert np.sqrt(np.mean(left[2:-2] ** 2)) < 0.01 * np.sqrt(np.mean(turning**2))


def test_a_model_without_any_error_has_statistics() -> None:
    run = record(100.0) | {FORCE: 2.0 * record(100.0)[DEMAND]}
    shown = compute_statistics(Spring(), [run], {FORCE: NOISE}, {}, {})["outputs"][FORCE]
    assert shown["coherence"][DEMAND] == {"largest": 0.0, "hz": 0.0}
    assert shown["autocorrelation_s"] is None


@pytest.mark.parametrize("rates", [(300.0, 1000.0, 1000.0), (1000.0, 300.0, 300.0), (2000.0, 200.0, 200.0)])
def test_the_share_of_a_term_is_that_beyond_the_noise_of_each_run(rates: Sequence[float]) -> None:
    runs = [record(rate, seed=k) for k, rate in enumerate(rates)]
    for run in runs:
        run[FORCE] = run[FORCE] + NOISE * run[DEMAND]
    described = describe_residual(Spring(), runs, {FORCE: NOISE}, {}, {})
    assert described["variables"] == [DEMAND]
    assert described["r2"] == pytest.approx(1.0, abs=WEAK_TERM)


@pytest.mark.parametrize(
    ("law", "shape"),
    [
        (lambda x, t: 0.3 * x, f"proportional to {DEMAND}"),
        (lambda x, t: 0.3 * x**2, f"quadratic in {DEMAND}"),
        (lambda x, t: 0.02 * t, "growing with time"),
    ],
)
def test_one_law_is_found_in_runs_of_other_sizes_and_lengths(
    law: Callable[[np.ndarray, np.ndarray], np.ndarray], shape: str
) -> None:
    runs = []
    for k, (size, middle, share) in enumerate(((1.0, 0.0, 1.0), (0.3, 0.0, 0.5), (2.0, 1.0, 0.7))):
        run = {name: values[: round(share * len(values))] for name, values in record(1000.0, seed=k).items()}
        demand = middle + size * run[DEMAND]
        added = 2.0 * (demand - run[DEMAND]) + law(demand, run["time_s"])
        runs.append({**run, "time_s": 40.0 * k + run["time_s"], DEMAND: demand, FORCE: run[FORCE] + added})
    described = describe_residual(Spring(), runs, {FORCE: NOISE}, {}, {})
    assert shape in described["shape"]
    assert described["r2"] == pytest.approx(1.0, abs=STRONG_TERM)


def test_a_search_without_candidates_says_whether_something_is_missing() -> None:
    assert investigate(Spring(), {"a": record(1000.0)}).verdict == NOTHING
    assert investigate(Spring(), {"a": record(1000.0, hum(1000.0, 3.0, 0.0))}).verdict == NONE_OF_THESE
