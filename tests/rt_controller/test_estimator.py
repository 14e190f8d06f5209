"""The controller's torque estimator and feedforward: parity with the plant's law, the thesis's values, symmetry. A test that
has the module as argument can run on mutants (tests/mutation)."""

from math import copysign, exp, log10
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rt_controller.law.estimator
from plant_sim.blocks import clutch, oil
from plant_sim.rigs import wet_clutch
from protocols.files.units import to_si
from rt_controller.law.estimator import MODEL as LAYOUT
from rt_controller.law.estimator import friction_state, plate_pressure, viscosity_ratio
from rt_controller.law.feedforward import inverse_model
from rt_controller.law.record import make_record
from rt_controller.loop.parameter_sets import load_controller_parameters

BAR, KELVIN = 1e5, 273.15
PARITY = 1e-12  # relative to 1 or to the value: rounding of two orders of operation, no more
EXPONENTIAL = 1e-13  # two half steps against one: rounding of exp
PRINTED = 5e-3  # Nm: the thesis's coefficients have three digits

VALUES = load_controller_parameters().list_si("model")
MODEL = make_record(LAYOUT, VALUES)
RIG = {group: wet_clutch.load_nominal().list_si(group) for group in ("clutch", "oil", "piston")}
# Another clutch, for values by hand: 0 Nm of Coulomb torque at 1.5 Pa and of viscous torque at 1 Pa; viscosity 8 at 310 K
MADE = make_record(
    LAYOUT, coulomb_slope=2.0, coulomb_intercept=-3.0, viscous_slope=4.0, viscous_intercept=-4.0, beta_inf=0.5,
    beta_onset=3.0, beta_scale=0.25, stribeck_speed=2.0, viscous_exponent=0.5, attraction=10.0, piston_lag=0.25,
    oil_slope=-2.0, oil_offset=10.0, oil_origin=300.0, oil_reference=310.0, oil_viscous_gain=0.5,
)  # fmt: skip
HAND = 1e-14  # relative: rounding of a formula written in another order

pressures = st.floats(0.5, 6.0).map(lambda bar: bar * BAR)
slips = st.one_of(st.just(0.0), st.floats(1e-3, 30.0), st.floats(-30.0, -1e-3))
temperatures = st.floats(36.0, 150.0).map(lambda celsius: celsius + KELVIN)
states = st.floats(-1.2, 1.2)
steps = st.floats(0.0, 0.1)


@pytest.fixture(scope="module")
def estimator() -> ModuleType:
    return rt_controller.law.estimator


def compute_torque_parts(
    state: float, pressure: float, slip: float, temperature: float, module: Any = rt_controller.law.estimator
) -> tuple[float, float]:
    """Coulomb part M_C m and viscous part [Nm] of the controller's torque: eq. 6.9, before level and viscous correction."""
    coulomb = module.coulomb_torque(MODEL, pressure)
    return coulomb * state, module.viscous_torque(MODEL, pressure, slip, temperature)


def compute_plant_ratio(pressure: float, slip: float) -> float:
    c = RIG["clutch"]
    depth = clutch.stribeck_depth(pressure, c["beta_inf"], c["beta_onset"], c["beta_scale"])
    return float(clutch.stribeck_ratio(depth, slip, c["stribeck_speed"]))


def compute_plant_viscosity_ratio(temperature: float) -> float:
    o = RIG["oil"]
    at, reference = (
        oil.friction_coefficient(value, o["slope"], o["offset"], o["origin"]) for value in (temperature, o["reference"])
    )
    return float(oil.viscosity_ratio(at, reference, o["viscous_gain"]))


def compute_plant_torque(state: float, pressure: float, slip: float, temperature: float) -> float:
    c = RIG["clutch"]
    coulomb = clutch.coulomb_torque(pressure, c["coulomb_slope"], c["coulomb_intercept"])
    viscous = clutch.viscous_factor(pressure, c["viscous_slope"], c["viscous_intercept"])
    viscous *= compute_plant_viscosity_ratio(temperature)
    return float(clutch.torque(coulomb, state, viscous, slip, c["viscous_exponent"]))


def test_controller_ships_with_the_plants_calibration() -> None:
    for name, value in RIG["clutch"].items():
        assert getattr(MODEL, name) == value, name
    assert MODEL.contact_pressure == RIG["piston"]["contact_pressure"]


@given(states, pressures, slips, steps)
def test_friction_state_of_controller_and_plant_agree(state: float, pressure: float, slip: float, step: float) -> None:
    theirs = clutch.relax_state(state, compute_plant_ratio(pressure, slip), slip, RIG["clutch"]["attraction"], step)
    assert friction_state(MODEL, state, pressure, slip, step) == pytest.approx(theirs, rel=PARITY, abs=PARITY)


@given(states, pressures, slips, temperatures)
def test_torque_of_controller_and_plant_agree(state: float, pressure: float, slip: float, temperature: float) -> None:
    theirs = compute_plant_torque(state, pressure, slip, temperature)
    ours = sum(compute_torque_parts(state, pressure, slip, temperature))
    assert ours == pytest.approx(theirs, rel=PARITY, abs=PARITY)


@given(st.floats(-20.0, 200.0).map(lambda celsius: celsius + KELVIN))
def test_viscosity_ratio_of_controller_and_plant_agree_even_outside_the_valid_range(temperature: float) -> None:
    assert viscosity_ratio(MODEL, temperature) == pytest.approx(compute_plant_viscosity_ratio(temperature), rel=PARITY)


def test_parity_would_see_a_part_in_a_billion() -> None:
    other = make_record(LAYOUT, VALUES, stribeck_speed=MODEL.stribeck_speed * (1 + 1e-9))
    theirs = clutch.relax_state(0.1, compute_plant_ratio(3.4 * BAR, 20.0), 20.0, RIG["clutch"]["attraction"], 0.01)
    assert friction_state(other, 0.1, 3.4 * BAR, 20.0, 0.01) != pytest.approx(theirs, rel=PARITY, abs=PARITY)


@given(states, pressures, slips, steps)
def test_one_step_of_two_h_equals_two_of_h(state: float, pressure: float, slip: float, step: float) -> None:
    once = friction_state(MODEL, state, pressure, slip, 2 * step)
    twice = friction_state(MODEL, friction_state(MODEL, state, pressure, slip, step), pressure, slip, step)
    assert twice == pytest.approx(once, rel=EXPONENTIAL, abs=EXPONENTIAL)


def test_friction_state_decays_with_s_n_over_c(estimator: ModuleType) -> None:
    s_n = 1 + (0.704 + 0.296 * exp(-(3.4 - 2.71) / 0.158) - 1) * exp(-11.52 / 20.0)
    after = estimator.friction_state(MODEL, s_n + 0.1, 3.4 * BAR, 20.0, s_n / 69.0)
    assert after == pytest.approx(s_n + 0.1 * exp(-1), abs=1e-12)
    assert s_n / 69.0 == pytest.approx(0.0121, abs=5e-5)  # docs/rig.md prints 12.1 ms


@given(states, pressures, slips, temperatures, steps)
def test_torque_is_odd_in_slip(state: float, pressure: float, slip: float, temperature: float, step: float) -> None:
    there = friction_state(MODEL, state, pressure, slip, step)
    back = friction_state(MODEL, -state, pressure, -slip, step)
    assert back == -there
    forward = compute_torque_parts(there, pressure, slip, temperature)
    backward = compute_torque_parts(back, pressure, -slip, temperature)
    assert backward == (-forward[0], -forward[1])


@given(st.floats(2.5, 4.5), st.floats(0.5, 30.0))
def test_steady_torque_is_the_stribeck_curve_plus_the_viscous_part(bar: float, slip: float) -> None:
    m = friction_state(MODEL, 0.0, bar * BAR, slip, 10.0)
    coulomb, viscous = 10.8 * bar - 25.1, 2.67 * bar - 6.49
    beta = min(1.0, 0.704 + (1 - 0.704) * exp(-(bar - 2.71) / 0.158))
    s = coulomb * (1 + (beta - 1) * exp(-11.52 / slip))
    f = viscous * slip ** (1 / 3)
    assert sum(compute_torque_parts(m, bar * BAR, slip, 70.0 + KELVIN)) == pytest.approx(s + f, rel=1e-9)


def test_values_that_the_rigs_page_prints(estimator: ModuleType) -> None:
    p, omega, temperature = 3.4 * BAR, 20.0, 70.0 + KELVIN
    m = estimator.friction_state(MODEL, 0.0, p, omega, 10.0)
    coulomb, viscous = compute_torque_parts(m, p, omega, temperature, estimator)
    assert m == pytest.approx(0.8357, abs=5e-5)
    assert coulomb / m == pytest.approx(11.62, abs=PRINTED)
    assert viscous / 20 ** (1 / 3) == pytest.approx(2.588, abs=PRINTED / 10)
    assert coulomb + viscous == pytest.approx(16.74, abs=PRINTED)


def test_at_small_slip_the_state_is_one_and_at_large_slip_it_is_beta(estimator: ModuleType) -> None:
    assert estimator.friction_state(MODEL, 0.0, 3.4 * BAR, 0.01, 10.0) == pytest.approx(1.0, abs=1e-12)
    assert estimator.friction_state(MODEL, 0.0, 3.4 * BAR, 1e6, 10.0) == pytest.approx(0.7078, abs=5e-5)


@given(states, pressures, steps)
def test_without_slip_the_state_is_held(state: float, pressure: float, step: float) -> None:
    assert friction_state(MODEL, state, pressure, 0.0, step) == state


def test_below_contact_there_is_no_torque(estimator: ModuleType) -> None:
    assert compute_torque_parts(1.0, 2.3 * BAR, 20.0, 343.15, estimator) == (0.0, 0.0)


def test_cold_oil_raises_the_viscous_part_alone_and_the_whole_follows_eq_6_3(estimator: ModuleType) -> None:
    cold, warm = (
        compute_torque_parts(0.8357, 3.4 * BAR, 200 * 0.104719755, c + KELVIN, estimator) for c in (50.0, 70.0)
    )
    assert cold[0] == warm[0]
    mu = {50.0: -0.0145 * 1.30103 + 0.143, 70.0: -0.0145 * 1.60206 + 0.143}  # log10 of 20 and 40
    assert sum(cold) / sum(warm) == pytest.approx(mu[50.0] / mu[70.0], abs=2e-3)
    assert estimator.viscosity_ratio(MODEL, 70.0 + KELVIN) == 1.0


def test_the_lag_of_the_piston_is_that_of_the_rig() -> None:
    piston = RIG["piston"]
    assert MODEL.piston_lag == pytest.approx(piston["damping"] / piston["stack_stiffness"], rel=1e-15)


@given(st.floats(1e-5, 0.1), st.floats(-100.0, 100.0), st.floats(2.0, 5.0))
def test_pressure_on_the_plates_is_behind_a_ramp_by_its_lag(step: float, rise: float, begin: float) -> None:
    """Ramp of `rise` [bar/s] from rest: present = p - rise lag (1 - exp(-t/lag)), whatever the steps."""
    lag, present = MODEL.piston_lag, begin
    for count in range(5):
        present = plate_pressure(MODEL, present, begin + rise * count * step, begin + rise * (count + 1) * step, step)
        exact = begin + rise * (count + 1) * step - rise * lag * (1.0 - exp(-(count + 1) * step / lag))
        assert present == pytest.approx(exact, abs=1e-11)


@given(steps.filter(lambda step: step > 1e-9), pressures, pressures, pressures)
def test_pressure_on_the_plates_takes_any_step(step: float, present: float, before: float, after: float) -> None:
    once = plate_pressure(MODEL, present, before, after, step)
    half, middle = step / 2.0, (before + after) / 2.0
    twice = plate_pressure(MODEL, plate_pressure(MODEL, present, before, middle, half), middle, after, half)
    assert twice == pytest.approx(once, rel=1e-9, abs=1e-3)
    assert plate_pressure(MODEL, present, before, after, 0.0) == present
    assert plate_pressure(MODEL, present, after, after, 1e6) == after


@given(steps, pressures, pressures, pressures)
def test_without_a_lag_the_pressure_on_the_plates_is_that_in_the_cylinder(
    step: float, present: float, before: float, after: float
) -> None:
    assert plate_pressure(make_record(LAYOUT, VALUES, piston_lag=0.0), present, before, after, step) == after


def test_feedforward_of_eq_6_8_by_hand() -> None:
    # 20^(1/3) = 2.714418; 10 / (10.8 + 2.67 * 2.714418) + 2.35 = 10 / 18.047495 + 2.35 = 2.904094 bar
    assert inverse_model(MODEL, 10.0, 20.0, 1.0, 0.0) / BAR == pytest.approx(2.904094, abs=1e-6)
    assert inverse_model(MODEL, 10.0, -20.0, 1.0, 0.0) == inverse_model(MODEL, 10.0, 20.0, 1.0, 0.0)


def test_feedforward_asks_for_contact_alone_without_demand() -> None:
    assert inverse_model(MODEL, 0.0, 20.0, 1.0, 0.0) == MODEL.contact_pressure


def test_a_weaker_clutch_needs_more_pressure_in_proportion() -> None:
    def above_contact(level: float, viscous: float) -> float:
        return inverse_model(MODEL, 10.0, 20.0, level, viscous) - MODEL.contact_pressure

    assert above_contact(0.8, 0.0) == pytest.approx(above_contact(1.0, 0.0) / 0.8, rel=1e-9)
    # 10 / (10.8 + 1.2 * 2.67 * 2.714418) = 10 / 19.496995 bar
    assert above_contact(1.0, 0.2) / BAR == pytest.approx(10 / 19.496995, abs=1e-6)
    assert above_contact(1.0, 0.2) < above_contact(1.0, 0.0)


def test_units_of_the_calibration_are_si() -> None:
    assert MODEL.coulomb_slope == to_si(10.8, "Nm/bar") == 10.8 / BAR
    assert MODEL.oil_origin == 30.0 + KELVIN


# --- values by hand --------------------------------------------------------------------------------------------------


def by_hand(value: float) -> Any:
    return pytest.approx(value, rel=HAND, abs=0.0)


def test_viscosity_falls_with_the_logarithm_of_the_temperature_above_its_origin(estimator: ModuleType) -> None:
    for above, viscosity in ((100.0, 6.0), (10.0, 8.0), (1.5, 10.0 - 2.0 * log10(1.5)), (1.0, 10.0)):
        assert estimator.viscosity_ratio(MADE, 300.0 + above) == by_hand(1.0 + 0.5 * (viscosity / 8.0 - 1.0))
    for colder in (300.5, 300.0, 250.0):  # where the logarithm would end
        assert estimator.viscosity_ratio(MADE, colder) == 1.125


def test_plates_follow_a_ramp_of_pressure_behind_the_lag(estimator: ModuleType) -> None:
    # rise of 1 in 0.125 s: at last 0.25 / 0.125 behind it; at first 0.5 below it, so 1.5 more than at last
    assert estimator.plate_pressure(MADE, 7.5, 8.0, 9.0, 0.125) == by_hand(9.0 - 2.0 + 1.5 * exp(-0.5))
    assert estimator.plate_pressure(MADE, 7.5, 9.0, 8.5, 0.5) == by_hand(8.5 + 0.25 - 1.75 * exp(-2.0))
    assert estimator.plate_pressure(MADE, 7.5, 9.0, 9.0, 2.0) == by_hand(9.0 - 1.5 * exp(-8.0))


def test_without_a_step_plates_keep_their_pressure_and_without_a_lag_they_have_the_cylinders(
    estimator: ModuleType,
) -> None:
    with np.errstate(all="raise"):  # a division by zero is an error, as in compiled code
        for step in (0.0, -0.5):
            assert estimator.plate_pressure(MADE, 7.5, 8.0, 9.0, step) == 7.5
        for lag in (0.0, -0.5):
            prompt = make_record(LAYOUT, piston_lag=lag)
            for step in (-1.0, 0.0, 0.5, 2.0):
                assert estimator.plate_pressure(prompt, 7.5, 8.0, 9.0, step) == 9.0


def test_the_level_in_sliding_goes_from_one_at_standstill_to_beta(estimator: ModuleType) -> None:
    with np.errstate(all="raise"):
        assert estimator.sliding_level(MADE, 3.5, 0.0) == 1.0
    beta = 0.5 + 0.5 * exp(-2.0)  # at 0.5 above the onset
    for speed in (0.5, 1.0, 8.0):
        for slip in (speed, -speed):
            assert estimator.sliding_level(MADE, 3.5, slip) == by_hand(1.0 - (1.0 - beta) * exp(-2.0 / speed))
    for pressure in (3.0, 2.0):  # at the onset and below there is no Stribeck effect
        assert estimator.sliding_level(MADE, pressure, 8.0) == 1.0


def test_the_friction_state_goes_to_its_level_with_the_sign_of_slip(estimator: ModuleType) -> None:
    for speed in (0.5, 1.0, 8.0):
        level = 1.0 - (0.5 - 0.5 * exp(-2.0)) * exp(-2.0 / speed)
        gone = 1.0 - exp(-10.0 * 0.0625 / level)
        up, down = (estimator.friction_state(MADE, 0.25, 3.5, slip, 0.0625) for slip in (speed, -speed))
        assert up == by_hand(0.25 + (level - 0.25) * gone)
        assert down == by_hand(0.25 - (level + 0.25) * gone)
    assert estimator.friction_state(MADE, 0.25, 3.5, 0.0, 0.0625) == 0.25


def test_what_plates_that_stand_can_reach_is_what_they_reach_turning_slowly_either_way(estimator: ModuleType) -> None:
    rest = exp(-1.0)
    lowest, highest = estimator.reachable_states(MADE, 0.25, 0.1)
    assert (lowest, highest) == (by_hand(1.25 * rest - 1.0), by_hand(1.0 - 0.75 * rest))
    creep = 1e-3  # rad/s: the level is 1
    assert lowest == by_hand(estimator.friction_state(MADE, 0.25, 3.5, -creep, 0.1))
    assert highest == by_hand(estimator.friction_state(MADE, 0.25, 3.5, creep, 0.1))


def test_torque_rises_with_pressure_from_where_plates_touch(estimator: ModuleType) -> None:
    assert [estimator.coulomb_torque(MADE, p) for p in (1.0, 1.5, 1.75, 5.0)] == [0.0, 0.0, 0.5, 7.0]
    for slip in (0.25, 2.25, 4.0):
        for sign in (1.0, -1.0):
            torques = [estimator.viscous_torque(MADE, p, sign * slip, 310.0) for p in (0.5, 1.0, 1.25, 2.5)]
            assert torques == [sign * factor * slip**0.5 for factor in (0.0, 0.0, 1.0, 6.0)]


def test_viscous_torque_is_that_of_the_oil(estimator: ModuleType) -> None:
    assert estimator.viscous_torque(MADE, 2.0, 2.25, 400.0) == 4.0 * 0.875 * 1.5
    assert estimator.viscous_torque(MADE, 2.0, -2.25, 250.0) == -4.0 * 1.125 * 1.5


def test_at_standstill_viscous_torque_is_zero_and_a_recording_does_not_say_minus_zero(estimator: ModuleType) -> None:
    torque = estimator.viscous_torque(MADE, 2.0, 0.0, 310.0)
    assert (torque, copysign(1.0, torque)) == (0.0, 1.0)
