"""Models of the discrepancy workflow on measured rigs: what fits before and after, on runs that were not fitted.

Skipped where the data are not on the machine. Errors are in N, root mean square, as the data's README has them.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.discrepancy.models.pneumatic_cylinder import PneumaticCylinder
from clutch_hil.discrepancy.models.position_axis import PositionAxis
from clutch_hil.discrepancy.models.tribometer import Tribometer
from clutch_hil.discrepancy.result import NAMED
from clutch_hil.discrepancy.search import investigate
from clutch_hil.fitting.model import Columns
from clutch_hil.recordings.import_map import ImportMap, load_map
from clutch_hil.thesis.measured_data import MissingDataError, find_measured_file
from protocols.files.parameters import ParameterSet
from tests import needs
from tests.clutch_hil.discrepancy.least_squares import compute_error, compute_residual, fit_least_squares

CLOSE = 0.05  # of an error: least squares end where they end; measured within 0.01 of the numbers below
ASYMMETRY = {"direction_asymmetry.asymmetry": -0.09, "direction_asymmetry.viscous_part": 0.9}
README_LOW_PASS = 40.0  # Hz: with it the errors are those of the data's README


def find_path(name: str) -> Path:
    try:
        return find_measured_file(name)
    except MissingDataError:
        needs.skip("data")


# --- EMPS: a position axis --------------------------------------------------------------------------------------------


def read_emps(of: ImportMap) -> tuple[Columns, Columns]:
    """The run that is fitted and the one with pulses."""
    one, pulses = (of.read(find_path(f"emps/{name}.mat")).columns for name in ("DATA_EMPS", "DATA_EMPS_PULSES"))
    return one, pulses


@pytest.fixture(scope="module")
def axis_runs() -> tuple[Columns, Columns]:
    return read_emps(load_map("emps"))


def test_emps_has_the_published_inertia_and_friction(axis_runs):
    """Janot, Gautier and Brunot 2019: 95.1 kg, 203.5 Ns/m, 20.4 N, there with an offset."""
    parameters, _ = fit_least_squares(PositionAxis(), axis_runs[:1])
    assert parameters["table.mass"] == pytest.approx(95.11, rel=0.01)
    assert parameters["friction.viscous"] == pytest.approx(203.5, rel=0.02)
    assert parameters["friction.coulomb"] == pytest.approx(20.39, rel=0.02)
    assert parameters["motor.delay"] == pytest.approx(0.32, abs=0.05)  # ms


@pytest.mark.parametrize(
    ("effects", "estimation", "held_out"),
    [
        ({}, 3.84, 4.60),
        ({"torque_sensor_offset.offset": -1.0}, 2.16, 3.28),
        ({"direction_asymmetry.asymmetry": -0.01, "direction_asymmetry.viscous_part": 0.8}, 1.61, 2.90),
    ],
    ids=["baseline", "offset", "direction"],
)
def test_emps_errors_are_those_of_the_readme(effects, estimation, held_out):
    """There 3.8 and 4.7, 2.2 and 3.4, 1.6 and 3.0; with its filter, and without a delay between force and motion."""
    own = load_map("emps")
    one, pulses = read_emps(replace(own, sampling=replace(own.sampling, low_pass_hz=README_LOW_PASS)))
    nominal = PositionAxis.list_nominal_parameters()
    at_once = replace(nominal["motor.delay"], value=0.0, uncertainty=0.0)
    model = PositionAxis(ParameterSet({**nominal, "motor.delay": at_once}))
    outcome = fit_least_squares(model, [one], effects)
    assert compute_error(model, [one], *outcome) == pytest.approx(estimation, rel=CLOSE)
    assert compute_error(model, [pulses], *outcome) == pytest.approx(held_out, rel=CLOSE)


def test_viscous_friction_of_emps_depends_on_the_direction(axis_runs):
    """Its Coulomb friction does not; 2.9 N are left in the run that was not fitted, of 4.6 N."""
    model = PositionAxis()
    assert compute_error(model, axis_runs[1:], *fit_least_squares(model, axis_runs[:1])) == pytest.approx(
        4.62, rel=CLOSE
    )
    outcome = fit_least_squares(model, axis_runs[:1], ASYMMETRY)
    assert outcome[1]["direction_asymmetry.viscous_part"] > 0.9
    assert compute_error(model, axis_runs[1:], *outcome) == pytest.approx(2.94, rel=CLOSE)


def test_emps_ripples_over_2_5_mm_of_its_screw(axis_runs):
    model = PositionAxis()
    parameters, effects = fit_least_squares(model, axis_runs[:1], ASYMMETRY)
    left = {"motor_force_n": compute_residual(model, axis_runs[0], parameters, effects)}
    ripple = next(c for c in model.candidates if c.name == "position_ripple")
    start = model.suggest_starts(ripple, axis_runs[0], left)[0]
    assert start["position_ripple.period"] == pytest.approx(2.50, abs=0.01)
    _, effects = fit_least_squares(model, axis_runs[:1], ASYMMETRY | start)
    assert effects["position_ripple.period"] == pytest.approx(2.50, abs=0.01)
    assert effects["position_ripple.amplitude"] == pytest.approx(1.0, rel=CLOSE)  # N; ahead 1.0, back 1.4


def test_emps_position_zero_differs_between_its_two_runs(axis_runs):
    """So the ripple's phase cannot be carried over; period and amplitude can."""
    model = PositionAxis()
    start = ASYMMETRY | {"position_ripple.period": 2.502, "position_ripple.amplitude": 0.9}
    phases = []
    for run in axis_runs:
        outcome = [fit_least_squares(model, [run], start | {"position_ripple.phase": phase}) for phase in (-1.7, 2.5)]
        best = min(outcome, key=lambda one: compute_error(model, [run], *one))[1]
        assert best["position_ripple.period"] == pytest.approx(2.50, abs=0.01)
        phases.append(best["position_ripple.phase"])
    assert abs(np.angle(np.exp(1j * (phases[1] - phases[0])))) > 1.0  # rad; measured 1.7


# --- micro-tribometer -------------------------------------------------------------------------------------------------


def test_microtribometer_lacks_presliding():
    """Coulomb 1.2 N, Dahl and an offset 0.12 N in the README."""
    data, of = find_path("microtribometer/test_data_2.txt"), load_map("microtribometer")
    fit_on, held_out = (of.cut(begin, begin + 100.0).read(data).columns for begin in (8.8, 108.8))
    model = Tribometer()
    before = compute_error(model, [held_out], *fit_least_squares(model, [fit_on]))
    presliding = {"presliding.angle": 1e-5, "presliding.spread": 1.0}
    after = compute_error(model, [held_out], *fit_least_squares(model, [fit_on], presliding))
    with_offset = compute_error(
        model, [held_out], *fit_least_squares(model, [fit_on], presliding | {"torque_sensor_offset.offset": 0.1})
    )
    assert before == pytest.approx(1.359, rel=CLOSE)
    assert after == pytest.approx(0.153, rel=CLOSE)
    assert with_offset == pytest.approx(0.115, rel=CLOSE)


# --- pneumatic cylinder -----------------------------------------------------------------------------------------------


def test_o_ring_friction_grows_with_pressure():
    """Fitted at 1 and 3 bar, held out at 5 and 7."""
    of = load_map("pneumatic_seal")
    runs = [of.read(find_path(f"pneumatic_seal_friction/O-ring_{bar}bar.csv")).columns for bar in (1, 3, 5, 7)]
    model = PneumaticCylinder()
    before = compute_error(model, runs[2:], *fit_least_squares(model, runs[:2]))
    seal = fit_least_squares(
        model, runs[:2], {"piston_seal_friction.pressure_slope": 0.5, "piston_seal_friction.travel": 4e-4}
    )
    assert before == pytest.approx(2.967, rel=CLOSE)
    assert compute_error(model, runs[2:], *seal) == pytest.approx(2.20, rel=CLOSE)
    assert seal[1]["piston_seal_friction.pressure_slope"] == pytest.approx(0.84, rel=CLOSE)


# --- the workflow -----------------------------------------------------------------------------------------------------


def test_the_workflow_names_what_each_rig_lacks(axis_runs):
    """And closes the gap, in runs it has not fitted, to what the fits above reach."""
    record, of = find_path("microtribometer/test_data_2.txt"), load_map("microtribometer")
    cycles = [of.cut(begin, begin + 100.0).read(record).columns for begin in (8.8, 108.8)]
    seal = load_map("pneumatic_seal")
    strokes = [seal.read(find_path(f"pneumatic_seal_friction/O-ring_{bar}bar.csv")).columns for bar in (1, 3, 5, 7)]
    cases = (
        # the zero of the axis was set anew between the two files, so the ripple's phase does not carry over: without it 2.94
        (PositionAxis(), axis_runs[:1], axis_runs[1:], ["direction_asymmetry", "position_ripple"], 3.11),
        (Tribometer(), cycles[:1], cycles[1:], ["presliding"], 0.150),
        (PneumaticCylinder(), strokes[:2], strokes[2:], ["piston_seal_friction"], 1.37),
    )
    for model, fitted_runs, held_out, effects, after in cases:
        named = [dict(zip("ab", runs, strict=False)) for runs in (fitted_runs, held_out)]
        result = investigate(model, named[0], {f"held out {n}": run for n, run in named[1].items()})
        assert (result.verdict, result.effects) == (NAMED, effects)
        assert result.gap[model.output.column].after == pytest.approx(after, rel=CLOSE)
