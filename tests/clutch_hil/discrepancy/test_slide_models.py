"""Models of contacts that move straight: the plug-ins are the simulator's, off is off, simulated rigs are served as well."""

from collections.abc import Callable

import numpy as np
import pytest

from clutch_hil.discrepancy.models import position_axis, tribometer
from clutch_hil.discrepancy.models.pneumatic_cylinder import PneumaticCylinder
from clutch_hil.discrepancy.models.position_axis import PositionAxis
from clutch_hil.discrepancy.models.sliding_contact import SlidingContact
from clutch_hil.discrepancy.models.tribometer import Tribometer
from clutch_hil.fitting.model import Columns, Hinting
from clutch_hil.recordings.measured_motion import compute_path, smooth
from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.stribeck import Stribeck
from plant_sim.rigs import position_axis as simulated_axis
from plant_sim.rigs import tribometer as simulated_tribometer
from protocols.errors import InputError
from tests.clutch_hil.discrepancy.least_squares import compute_error, fit_least_squares

EXACT = 1e-12  # relative: some roundings
SINE = 2e-4  # relative: fourth-order differences at 40 samples a period; measured 1e-4
PLAY = 2.0 * 2 * np.pi * 1e-7 / 2e-4 * 1.1  # N: the position is held by a play of 0.1 um; a tenth for its second order
SEEN = 5e-3  # N: what a typical candidate changes at least; the least, a drift over 4 s, changes 0.01
RATE = 200.0  # Hz
RIGS: tuple[type[SlidingContact], ...] = (PositionAxis, Tribometer, PneumaticCylinder)


def run(rig: type[SlidingContact], seconds: float = 4.0) -> Columns:
    """Strokes to and fro, without a measured output."""
    time = np.arange(0.0, seconds, 1.0 / RATE)
    stroke = 0.5 * compute_rig_path(rig) * (1.0 - np.cos(np.pi * time))
    further = {"normal_load_n": np.full(time.size, 5.0), "pressure_bar": 3.0 + 0.1 * np.sin(time)}
    return {"time_s": time, rig.inputs[0]: stroke} | {n: further[n] for n in rig.inputs[1:]}


def compute_rig_path(rig: type[SlidingContact]) -> float:
    """Its stroke [m], from the bounds of pre-sliding, which are half of it."""
    return 2.0 * next(c for c in rig.known if c.name == "presliding").parameters[0].bounds[1]


def simulate_force(rig: type[SlidingContact], **effects: float) -> np.ndarray:
    model = rig()
    base = {name: p.value for name, p in model.parameters.items()}
    values = {name.replace("__", "."): value for name, value in effects.items()}
    return model.simulate(run(rig), base, values)[model.output.column]


@pytest.mark.parametrize("rig", RIGS, ids=lambda rig: rig.name)
def test_a_candidate_that_is_off_changes_nothing(rig: type[SlidingContact]) -> None:
    model, plain = rig(), simulate_force(rig)
    base = {name: p.value for name, p in model.parameters.items()}
    for candidate in model.candidates:
        off = model.simulate(run(rig), base, candidate.list_off_values())[model.output.column]
        np.testing.assert_array_equal(off, plain, candidate.name)


@pytest.mark.parametrize("rig", RIGS, ids=lambda rig: rig.name)
def test_a_typical_candidate_changes_the_force(rig: type[SlidingContact]) -> None:
    model, plain = rig(), simulate_force(rig)
    base = {name: p.value for name, p in model.parameters.items()}
    for candidate in model.candidates:
        shown = model.simulate(run(rig), base, candidate.list_typical_values())[model.output.column]
        assert np.isfinite(shown).all(), candidate.name
        assert np.abs(shown - plain).max() > SEEN, candidate.name


@pytest.mark.parametrize("rig", RIGS, ids=lambda rig: rig.name)
def test_every_start_lies_within_the_bounds(rig: type[SlidingContact]) -> None:
    model = rig()
    assert isinstance(model, Hinting)
    left = {model.output.column: np.sin(1e3 * run(rig)[rig.inputs[0]])}
    for candidate in model.candidates:
        bounds = {f"{candidate.name}.{p.name}": p.bounds for p in candidate.parameters}
        for start in model.suggest_starts(candidate, run(rig) | left, left):
            assert set(start) <= set(bounds)
            assert all(bounds[name][0] <= value <= bounds[name][1] for name, value in start.items()), candidate.name


def test_ripple_has_its_period_along_the_path() -> None:
    ripple = simulate_force(
        Tribometer, position_ripple__amplitude=2.0, position_ripple__period=0.2, position_ripple__phase=0.3
    )
    x = run(Tribometer)["displacement_m"]
    middle = x - 0.5 * np.diff(x, prepend=0.0)
    left = ripple - simulate_force(Tribometer)
    np.testing.assert_allclose(left, 2.0 * np.cos(2 * np.pi * middle / 2e-4 + 0.3), atol=PLAY)


def test_direction_raises_one_side_and_lowers_the_other() -> None:
    plain, leaning = simulate_force(Tribometer), simulate_force(Tribometer, direction_asymmetry__asymmetry=0.1)
    np.testing.assert_allclose(leaning, plain * np.where(plain > 0.0, 1.1, 0.9), rtol=EXACT)


@pytest.mark.parametrize(("viscous_part", "coulomb", "viscous"), [(0.0, 2.0, 0.0), (0.5, 1.0, 1.0), (1.0, 0.0, 2.0)])
def test_direction_asymmetry_is_of_the_part_it_is_given_to(viscous_part: float, coulomb: float, viscous: float) -> None:
    """F_c 20 N, F_v 150 Ns/m; the motion is that of the samples, half a ms later."""
    leaning = simulate_force(
        PositionAxis, direction_asymmetry__asymmetry=0.1, direction_asymmetry__viscous_part=viscous_part
    )
    added, model = leaning - simulate_force(PositionAxis), PositionAxis()
    speed = model._track_motion(run(PositionAxis), model.parameters, 1.0 / RATE).speed
    away = slice(5, 195)  # from the reversals
    wanted = 0.1 * (20.0 * coulomb + 150.0 * viscous * np.abs(speed))
    np.testing.assert_allclose(added[away], wanted[away], rtol=1e-9)


def test_presliding_without_spread_is_one_spring() -> None:
    """Straight to the level at b, then flat."""
    x = np.linspace(0.0, 2e-4, 800)
    pushed = run(Tribometer) | {"displacement_m": x}
    model = Tribometer(Tribometer.list_nominal_parameters().with_values({"motion.flicker": 0.0}))
    base = {name: p.value for name, p in model.parameters.items()}
    shown = model.simulate(pushed, base, {"presliding.angle": 1e-4, "presliding.spread": 1.0})["friction_force_n"]
    np.testing.assert_allclose(shown[5:], 2.5 * np.minimum(x / 1e-4, 1.0)[5:], rtol=1e-9)


def test_seal_friction_grows_with_pressure() -> None:
    """At 3 bar 2 N more for 0.667 N/bar, once its lip has moved through."""
    tight = simulate_force(
        PneumaticCylinder, piston_seal_friction__pressure_slope=2.0 / 3.0, piston_seal_friction__travel=1e-6
    )
    added, pressure = tight - simulate_force(PneumaticCylinder), run(PneumaticCylinder)["pressure_bar"]
    ahead = slice(40, 160)
    np.testing.assert_allclose(added[ahead], 2.0 / 3.0 * pressure[ahead], rtol=EXACT)


def test_presliding_begins_with_the_force_that_was_measured() -> None:
    """A run that begins under friction does not begin with a slack contact."""
    model = Tribometer()
    base = {name: p.value for name, p in model.parameters.items()}
    held = run(Tribometer) | {"displacement_m": np.zeros(800), "friction_force_n": np.full(800, -1.0)}
    shown = model.simulate(held, base, {"presliding.angle": 1e-4, "presliding.spread": 2.0})["friction_force_n"]
    np.testing.assert_allclose(shown, -1.0, rtol=EXACT)


def test_an_effect_that_is_on_belongs_to_the_baseline() -> None:
    whole = Tribometer.list_nominal_parameters().with_values({"torque_sensor_offset.offset": 0.25})
    model = Tribometer(whole)
    assert "torque_sensor_offset" not in {c.name for c in model.candidates}
    base = {name: p.value for name, p in model.parameters.items()}
    shown = model.simulate(run(Tribometer), base, {})["friction_force_n"]
    np.testing.assert_allclose(shown, simulate_force(Tribometer) + 0.25, rtol=EXACT)


def test_motion_of_a_sine_is_its_derivative() -> None:
    time = np.arange(0.0, 2.0, 0.025)
    moved = smooth(np.sin(2 * np.pi * time), 0.025, 0.1)
    inner = slice(2, -2)
    np.testing.assert_allclose(moved.speed[inner], 2 * np.pi * np.cos(2 * np.pi * time)[inner], atol=SINE * 2 * np.pi)
    np.testing.assert_allclose(
        moved.acceleration[inner], -((2 * np.pi) ** 2) * np.sin(2 * np.pi * time)[inner], atol=SINE * 40.0
    )


def test_a_short_run_is_refused_with_what_is_needed() -> None:
    with pytest.raises(InputError, match="position has 4 samples; the window of its derivative needs 5"):
        smooth(np.zeros(4), 0.001, 0.001)


def test_the_last_digit_of_a_dwell_makes_no_motion() -> None:
    flicker = 1e-7 * np.array([0, 1, 0, 1, 1, 0], float)
    assert not compute_path(flicker, 0.01, 1e-7).speed.any()
    stroke = np.linspace(0.0, 1e-5, 50)
    assert (compute_path(stroke, 0.01, 1e-7).speed[5:] > 0.0).all()


def test_a_reversal_stays_at_its_sample() -> None:
    """Also a slow one, which moves by the flicker in 28 ms, and with noise below the flicker."""
    time = np.arange(0.0, 4.0, 1e-3)
    position = 1e-4 * np.sin(np.pi * time) + 1e-8 * np.random.default_rng(1).standard_normal(time.size)
    speed = compute_path(position, 1e-3, 1e-7).speed
    signs, at = np.sign(speed[speed != 0.0]), time[speed != 0.0]
    turned = at[1:][np.diff(signs) != 0.0]
    np.testing.assert_allclose(turned, [0.5, 1.5, 2.5, 3.5], atol=8e-3)


Motion = Callable[[np.ndarray], np.ndarray]


def record_axis(friction: object | None, amplitude: float, hertz: float, seed: int) -> Columns:
    axis = simulated_axis.PositionAxis(friction)  # type: ignore[arg-type]
    trajectory: Motion = lambda t: amplitude * (1.0 - np.cos(2 * np.pi * hertz * t))  # noqa: E731
    return position_axis.to_columns(axis.simulate(trajectory, 6.0, seed=seed))


def test_a_simulated_axis_shows_its_mass_and_friction() -> None:
    record = record_axis(Coulomb(Stribeck(20.0)), 0.05, 0.5, seed=1)
    parameters, _ = fit_least_squares(PositionAxis(), [record])
    assert parameters["table.mass"] == pytest.approx(15.0, rel=0.01)
    assert parameters["friction.coulomb"] == pytest.approx(20.0, rel=0.03)


def test_a_simulated_axis_lacks_presliding() -> None:
    """Its friction is another law, XGMS with ten elements; presliding takes away four fifths of the error, held out."""
    model = PositionAxis()
    one, other = record_axis(None, 0.01, 0.5, seed=1), record_axis(None, 0.002, 1.0, seed=2)
    before = compute_error(model, [other], *fit_least_squares(model, [one]))
    start = {"presliding.angle": 3e-5, "presliding.spread": 2.0}
    after = compute_error(model, [other], *fit_least_squares(model, [one], start))
    assert after < 0.25 * before


def test_a_simulated_tribometer_lacks_presliding() -> None:
    records = []
    for seed, hertz in ((1, 0.2), (2, 0.1)):
        rig = simulated_tribometer.Tribometer(MaxwellSlip(np.full(8, 1e5), np.linspace(0.5, 2.5, 8)), seed=seed)
        drive = rig.make_position_drive(lambda t, hertz=hertz: 0.02 * np.sin(2 * np.pi * hertz * t))
        record = rig.run(drive, 60.0, 20.0, 1e-4, every=50)
        records.append(tribometer.to_columns(record, simulated_tribometer.mean_radius(rig.parameters)))
    model = Tribometer()
    before = compute_error(model, records[1:], *fit_least_squares(model, records[:1]))
    presliding = fit_least_squares(model, records[:1], {"presliding.angle": 1e-4, "presliding.spread": 2.0})
    assert presliding[0]["friction.coefficient"] == pytest.approx(12.0 / 60.0, rel=0.01)
    assert compute_error(model, records[1:], *presliding) < 0.1 * before


@pytest.mark.parametrize("name", ["position_ripple", "shaft_angle_ripple", "motor_torque_ripple"])
def test_a_ripple_is_read_off_the_residual(name: str) -> None:
    """Period and phase are so near that the fit need not look for them; also where the baseline is not fitted yet."""
    model = PositionAxis()
    base = {p: parameter.value for p, parameter in model.parameters.items()}
    candidate = next(c for c in model.candidates if c.name == name)
    wanted = candidate.list_typical_values() | {f"{name}.period": 4.0, f"{name}.phase": 1.0}
    heavier = base | {"table.mass": 80.0, "friction.viscous": 220.0}
    time = np.arange(0.0, 40.0, 1.0 / RATE)
    moved = {"time_s": time, "position_m": 0.125 * (1.0 - np.cos(0.1 * np.pi * time))}
    predicted = model.simulate(moved, base, {})["motor_force_n"]
    measured = moved | model.simulate(moved, heavier, wanted)
    left = {"motor_force_n": measured["motor_force_n"] - predicted}
    result = model.suggest_starts(candidate, measured, left)[0]
    assert result[f"{name}.period"] == pytest.approx(4.0, rel=2e-3)
    assert result[f"{name}.phase"] == pytest.approx(1.0, abs=0.3)
    assert result[f"{name}.amplitude"] == pytest.approx(wanted[f"{name}.amplitude"], rel=0.5)
