"""The power-shift rig: torque through the ratios, energy, and what two clutches on one driveline do to each other."""

import numpy as np
import pytest

from plant_sim.rigs import power_shift, wet_clutch
from plant_sim.rigs.power_shift import PowerShift, Rig
from protocols.errors import InputError

PERIOD, SUBSTEPS = 1e-3, 10  # s; steps of 0.1 ms
OIL = 343.15  # K, 70 degC
LIMIT = 40.0  # Nm, of the motor
OPEN, SLIPPING, CLOSED = 0.0, 3.0 / 2.5, 4.2 / 2.5  # V at the valve for 0, 3 and 4.2 bar
ROUNDING = 1e-9  # share of the motor's work that may be lost: 2e-14 measured, sums of 40 000 steps
LOCKED = 0.01  # rad/s, slip of a closed clutch: 0.001 measured, m of eq. 6.9 hunts around zero slip
GRADE_HELD = 0.010  # rise over run, below the rolling resistance of 0.015


def make_rig(**changed: float) -> Rig:
    """The rig with driveline parameters changed, or others by dotted name with `__` for dots."""
    names = {name.replace("__", ".") if "__" in name else f"driveline.{name}": v for name, v in changed.items()}
    return Rig(power_shift.load_nominal().with_values(names))


def run(
    rig: Rig, state: PowerShift, voltages: tuple[float, float], speed: float, seconds: float, limit: float = LIMIT
) -> tuple[PowerShift, dict[str, np.ndarray]]:
    """The state after `seconds`, and driveline, torques and slips of every millisecond on the way."""
    rows = []
    for _ in range(round(seconds / PERIOD)):
        state = rig.advance(state, voltages, speed, limit, PERIOD, SUBSTEPS)
        a, b = state.a.read(), state.b.read()
        message = {
            "torque_a": a.clutch_torque,
            "torque_b": b.clutch_torque,
            "slip_a": a.slip_speed,
            "slip_b": b.slip_speed,
        }
        rows.append(state.read()._asdict() | message)
    return state, {name: np.array([row[name] for row in rows]) for name in rows[0]}


def compute_energy(state: PowerShift) -> float:
    """What the motor gave, less what was stored and lost [J]: what the integration made of nothing."""
    d = state.read()
    stored = 0.5 * 0.05 * d.input_speed**2 + 0.5 * 15.0 * d.output_speed**2
    return d.input_work - d.road_work - d.heat_a - d.heat_b - stored


def test_work_is_kinetic_energy_road_and_heat() -> None:
    whole = make_rig(grade=0.02)
    state = whole.make_rest_state(20.0, 0.0, OIL)
    before = compute_energy(state)
    for voltages in ((SLIPPING, OPEN), (SLIPPING, SLIPPING), (OPEN, CLOSED), (OPEN, OPEN)):
        state, _ = run(whole, state, voltages, 20.0, 1.0)
    d = state.read()
    assert d.heat_a > 10.0
    assert d.heat_b > 10.0
    assert abs(compute_energy(state) - before) < ROUNDING * d.input_work


def test_torque_goes_through_the_ratios_and_is_balanced_on_both_shafts() -> None:
    whole = make_rig()
    state, _ = run(whole, whole.make_rest_state(20.0, 0.0, OIL), (SLIPPING, SLIPPING), 20.0, 1.0)
    d, a, b = state.read(), state.a.read(), state.b.read()
    assert a.clutch_torque > 5.0
    assert b.clutch_torque > 5.0
    assert d.output_torque == 3.0 * a.clutch_torque + 2.0 * b.clutch_torque
    assert d.input_acceleration == pytest.approx((d.motor_torque - a.clutch_torque - b.clutch_torque) / 0.05)
    assert d.output_acceleration == pytest.approx((d.output_torque - d.road_torque) / 15.0)


def test_slips_follow_from_the_two_shafts() -> None:
    whole = make_rig()
    state, seen = run(whole, whole.make_rest_state(20.0, 0.0, OIL), (SLIPPING, OPEN), 20.0, 1.5)
    np.testing.assert_array_equal(seen["slip_a"], seen["input_speed"] - 3.0 * seen["output_speed"])
    np.testing.assert_array_equal(seen["slip_b"], seen["input_speed"] - 2.0 * seen["output_speed"])
    turned = np.trapezoid(np.r_[20.0, seen["slip_a"]], dx=PERIOD)
    assert state.a.read().angle == pytest.approx(turned, rel=1e-5)  # the encoder of a clutch counts its slip


def test_against_a_standing_vehicle_a_clutch_is_the_wet_clutch_rig() -> None:
    """A vehicle too heavy to move is the fixed output of the single rig."""
    whole, single = make_rig(vehicle_inertia=1e5), wet_clutch.Rig(wet_clutch.load_nominal())
    state, alone = whole.make_rest_state(20.0, 0.0, OIL), single.make_rest_state(20.0, OIL)
    for k in range(500):
        voltage = SLIPPING if k < 300 else OPEN
        state = whole.advance(state, (voltage, OPEN), 20.0, LIMIT, PERIOD, SUBSTEPS)
        alone = single.advance(alone, voltage, 20.0, LIMIT, PERIOD, SUBSTEPS)
        clutch, expected = state.a.read(), alone.read()
        assert clutch.pressure == expected.pressure
        assert clutch.slip_speed == pytest.approx(expected.slip_speed, rel=1e-9)
        assert clutch.clutch_torque == pytest.approx(expected.clutch_torque, rel=1e-9)
        assert clutch.temperature == pytest.approx(
            expected.temperature, abs=1e-4
        )  # heat of mean instead of middle slip


def test_with_both_clutches_open_the_vehicle_coasts_to_rest_and_stays() -> None:
    whole = make_rig(drag_area=0.0)
    begin = 2.0  # rad/s
    rate = 9.80665 / 0.3 * 0.015  # rad/s^2: g/r c_r, whatever the mass
    state, seen = run(whole, whole.make_rest_state(20.0, begin, OIL), (OPEN, OPEN), 20.0, 5.0)
    expected = np.maximum(begin - rate * seen["time"], 0.0)
    np.testing.assert_allclose(seen["output_speed"], expected, atol=1e-9)
    assert state.read().output_speed == 0.0
    assert state.read().input_speed == 20.0


def test_drag_slows_with_the_square_of_speed() -> None:
    whole = make_rig(rolling_resistance=0.0, drag_area=20.0)
    _, seen = run(whole, whole.make_rest_state(0.0, 8.0, OIL), (OPEN, OPEN), 0.0, 2.0)
    k = 0.5 * 1.204 * 20.0 * 0.3**3 / 15.0  # 1/rad: dw/dt = -k w^2
    np.testing.assert_allclose(
        seen["output_speed"], 8.0 / (1.0 + 8.0 * k * seen["time"]), rtol=1e-4
    )  # Euler over 0.1 ms


@pytest.mark.parametrize(("grade", "stays"), [(GRADE_HELD, True), (-GRADE_HELD, True), (0.05, False), (-0.05, False)])
def test_a_vehicle_at_rest_holds_on_a_slight_grade_and_rolls_down_a_steep_one(grade: float, stays: bool) -> None:
    whole = make_rig(grade=grade)
    state, _ = run(whole, whole.make_rest_state(0.0, 0.0, OIL), (OPEN, OPEN), 0.0, 0.5)
    speed = state.read().output_speed
    assert speed == 0.0 if stays else speed * grade < -0.001


def test_one_closed_clutch_ties_the_shafts_by_its_ratio() -> None:
    whole = make_rig()
    state, _ = run(whole, whole.make_rest_state(15.0, 4.0, OIL), (OPEN, CLOSED), 15.0, 3.0)
    state, seen = run(whole, state, (OPEN, CLOSED), 15.0, 0.5)
    assert np.abs(seen["slip_b"]).max() < LOCKED
    assert np.all(seen["torque_a"] == 0.0)


def test_two_closed_clutches_fight_each_other() -> None:
    """Tie-up: the input cannot turn at both gears' speeds, so the lower gear brakes and the higher drives."""
    whole = make_rig()
    state, _ = run(whole, whole.make_rest_state(18.0, 6.0, OIL), (OPEN, SLIPPING), 15.0, 0.5)
    _, seen = run(whole, state, (CLOSED, CLOSED), 15.0, 0.5, limit=5.0)
    end = slice(-100, None)
    assert np.all(seen["slip_a"][end] < 0.0)
    assert np.all(seen["slip_b"][end] > 0.0)
    assert seen["torque_a"][end].mean() < -5.0
    assert seen["torque_b"][end].mean() > 5.0
    assert seen["output_acceleration"][end].mean() < -1.0  # 3 Nm of brake for 2 of drive


def test_an_effect_in_one_clutch_leaves_the_other_alone() -> None:
    slowly, plain = make_rig(b__friction_level__level=0.5), make_rig()
    torques = []
    for whole in (slowly, plain):
        state, _ = run(whole, whole.make_rest_state(20.0, 0.0, OIL), (SLIPPING, SLIPPING), 20.0, 0.4)
        torques.append((state.a.read().clutch_torque, state.b.read().clutch_torque))
    (a, b), (a_plain, b_plain) = torques
    assert a == pytest.approx(a_plain, rel=0.01)
    assert b == pytest.approx(0.5 * b_plain, rel=0.01)


def test_effects_of_turning_and_of_temperature_see_their_clutch() -> None:
    def position(celsius: float, **effect: float) -> float:
        whole = make_rig(**effect)
        return (
            run(whole, whole.make_rest_state(25.0, 0.0, celsius + 273.15), (OPEN, SLIPPING), 25.0, 0.12)[0]
            .b.read()
            .position
        )

    assert position(70.0, b__centrifugal_pressure__coefficient=3e-4) > position(70.0) + 1e-5  # m
    assert position(70.0, b__oil_viscosity__share=1.0) == pytest.approx(position(70.0), abs=1e-9)
    assert position(40.0, b__oil_viscosity__share=1.0) < position(40.0) - 1e-5


def test_each_clutch_heats_its_own_oil() -> None:
    whole = make_rig()
    state, _ = run(whole, whole.make_rest_state(20.0, 0.0, OIL), (SLIPPING, OPEN), 20.0, 1.0)
    assert state.a.read().temperature > OIL + 0.2
    assert state.b.read().temperature == OIL
    assert state.read().heat_b == 0.0


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"a.backlash.gap": 0.01}, "effect a.backlash acts between motor and clutch"),
        ({"b.shaft_compliance.compliance": 1e-3}, "effect b.shaft_compliance acts between motor and clutch"),
        ({"b.motor_torque_ripple.amplitude": 0.1}, "effect b.motor_torque_ripple acts between motor and clutch"),
        ({"a.piston_seal_friction.force": 1e3, "a.piston_seal_friction.travel": 1e-6}, "clutch a: the rig is too fast"),
        ({"driveline.grade": 2.0}, "parameter driveline.grade = 2 is outside -0.5..0.5"),
        ({"valve.gain": 2.0}, "parameter 'valve.gain' is unknown"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(values: dict[str, float], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Rig(power_shift.load_nominal().with_values(values))


def test_parameters_carry_the_prefix_of_their_clutch() -> None:
    parameters = power_shift.load_nominal().with_values({"a.valve.gain": 2.4})
    assert parameters["b.valve.gain"].value == 2.5
    own = power_shift.select_clutch_parameters(parameters, "a")
    assert set(own) == set(wet_clutch.load_nominal())
    assert own["valve.gain"].name == "valve.gain"
    assert own["valve.gain"].value == 2.4
