"""The controller's torque estimator and feedforward: parity with the plant's law, the thesis's values, symmetry."""

from math import exp

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant_sim.blocks import clutch, oil
from plant_sim.rigs import wet_clutch
from protocols.files.units import to_si
from rt_controller.law.estimator import MODEL as LAYOUT
from rt_controller.law.estimator import coulomb_torque, friction_state, plate_pressure, viscosity_ratio, viscous_torque
from rt_controller.law.feedforward import inverse_model
from rt_controller.law.record import make_record
from rt_controller.loop.node import load_controller_parameters

BAR, KELVIN = 1e5, 273.15
PARITY = 1e-12  # relative to 1 or to the value: rounding of two orders of operation, no more
EXPONENTIAL = 1e-13  # two half steps against one: rounding of exp
PRINTED = 5e-3  # Nm: the thesis's coefficients have three digits

VALUES = load_controller_parameters().list_si("model")
MODEL = make_record(LAYOUT, VALUES)
RIG = {group: wet_clutch.load_nominal().list_si(group) for group in ("clutch", "oil", "piston")}

pressures = st.floats(0.5, 6.0).map(lambda bar: bar * BAR)
slips = st.one_of(st.just(0.0), st.floats(1e-3, 30.0), st.floats(-30.0, -1e-3))
temperatures = st.floats(36.0, 150.0).map(lambda celsius: celsius + KELVIN)
states = st.floats(-1.2, 1.2)
steps = st.floats(0.0, 0.1)


def compute_torque_parts(model, state: float, pressure: float, slip: float, temperature: float) -> tuple[float, float]:
    """Coulomb part M_C m and viscous part [Nm] of the controller's torque: eq. 6.9, before level and viscous correction."""
    return coulomb_torque(model, pressure) * state, viscous_torque(model, pressure, slip, temperature)


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
    assert sum(compute_torque_parts(MODEL, state, pressure, slip, temperature)) == pytest.approx(
        theirs, rel=PARITY, abs=PARITY
    )


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


def test_friction_state_decays_with_s_n_over_c() -> None:
    s_n = 1 + (0.704 + 0.296 * exp(-(3.4 - 2.71) / 0.158) - 1) * exp(-11.52 / 20.0)
    after = friction_state(MODEL, s_n + 0.1, 3.4 * BAR, 20.0, s_n / 69.0)
    assert after == pytest.approx(s_n + 0.1 * exp(-1), abs=1e-12)
    assert s_n / 69.0 == pytest.approx(0.0121, abs=5e-5)  # docs/rig.md prints 12.1 ms


@given(states, pressures, slips, temperatures, steps)
def test_torque_is_odd_in_slip(state: float, pressure: float, slip: float, temperature: float, step: float) -> None:
    there = friction_state(MODEL, state, pressure, slip, step)
    back = friction_state(MODEL, -state, pressure, -slip, step)
    assert back == -there
    forward = compute_torque_parts(MODEL, there, pressure, slip, temperature)
    backward = compute_torque_parts(MODEL, back, pressure, -slip, temperature)
    assert backward == (-forward[0], -forward[1])


@given(st.floats(2.5, 4.5), st.floats(0.5, 30.0))
def test_steady_torque_is_the_stribeck_curve_plus_the_viscous_part(bar: float, slip: float) -> None:
    m = friction_state(MODEL, 0.0, bar * BAR, slip, 10.0)
    coulomb, viscous = 10.8 * bar - 25.1, 2.67 * bar - 6.49
    beta = min(1.0, 0.704 + (1 - 0.704) * exp(-(bar - 2.71) / 0.158))
    s = coulomb * (1 + (beta - 1) * exp(-11.52 / slip))
    f = viscous * slip ** (1 / 3)
    assert sum(compute_torque_parts(MODEL, m, bar * BAR, slip, 70.0 + KELVIN)) == pytest.approx(s + f, rel=1e-9)


def test_values_that_the_rigs_page_prints() -> None:
    p, omega, temperature = 3.4 * BAR, 20.0, 70.0 + KELVIN
    m = friction_state(MODEL, 0.0, p, omega, 10.0)
    coulomb, viscous = compute_torque_parts(MODEL, m, p, omega, temperature)
    assert m == pytest.approx(0.8357, abs=5e-5)
    assert coulomb / m == pytest.approx(11.62, abs=PRINTED)
    assert viscous / 20 ** (1 / 3) == pytest.approx(2.588, abs=PRINTED / 10)
    assert coulomb + viscous == pytest.approx(16.74, abs=PRINTED)


def test_at_small_slip_the_state_is_one_and_at_large_slip_it_is_beta() -> None:
    assert friction_state(MODEL, 0.0, 3.4 * BAR, 0.01, 10.0) == pytest.approx(1.0, abs=1e-12)
    assert friction_state(MODEL, 0.0, 3.4 * BAR, 1e6, 10.0) == pytest.approx(0.7078, abs=5e-5)


@given(states, pressures, steps)
def test_without_slip_the_state_is_held(state: float, pressure: float, step: float) -> None:
    assert friction_state(MODEL, state, pressure, 0.0, step) == state


def test_below_contact_there_is_no_torque() -> None:
    assert compute_torque_parts(MODEL, 1.0, 2.3 * BAR, 20.0, 343.15) == (0.0, 0.0)


def test_cold_oil_raises_the_viscous_part_alone_and_the_whole_follows_eq_6_3() -> None:
    cold, warm = (compute_torque_parts(MODEL, 0.8357, 3.4 * BAR, 200 * 0.104719755, c + KELVIN) for c in (50.0, 70.0))
    assert cold[0] == warm[0]
    mu = {50.0: -0.0145 * 1.30103 + 0.143, 70.0: -0.0145 * 1.60206 + 0.143}  # log10 of 20 and 40
    assert sum(cold) / sum(warm) == pytest.approx(mu[50.0] / mu[70.0], abs=2e-3)
    assert viscosity_ratio(MODEL, 70.0 + KELVIN) == 1.0


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
