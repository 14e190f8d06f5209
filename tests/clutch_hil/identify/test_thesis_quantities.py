"""Quantities of the thesis from a clutch's parameters: values of the nominal rig, and intervals by propagation."""

import numpy as np
import pytest

from clutch_hil.identify.thesis_quantities import (
    Propagation,
    Quantity,
    compute_maps,
    compute_quantities,
    compute_slope,
    compute_torque,
    find_highest_pressure,
    format_table,
    list_pressures,
)
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.clutch_unit import viscosity_ratio
from protocols.files.units import RPM, ZERO_CELSIUS
from rt_controller.loop.parameter_sets import load_controller_parameters

NOMINAL = wet_clutch.load_nominal()
VALUES = {name: p.value for name, p in NOMINAL.items()}
NAMES = ["clutch.coulomb_slope", "clutch.coulomb_intercept", "clutch.stribeck_speed", "hydraulics.conductance"]
DEVIATIONS = np.array([0.02, 0.06, 0.05, 1e-6])
CORRELATION = np.eye(4)
CORRELATION[0, 1] = CORRELATION[1, 0] = -0.99
COVARIANCE = CORRELATION * np.outer(DEVIATIONS, DEVIATIONS)
KNOWN = Propagation(VALUES, NAMES, COVARIANCE)
OFFSET = "pressure_sensor_offset.offset"


@pytest.fixture(scope="module")
def quantities() -> dict[tuple[str, str], Quantity]:
    pressure = load_controller_parameters()
    gains = pressure["pressure.proportional_gain"].value, pressure["pressure.integral_gain"].value
    result = compute_quantities(KNOWN, NOMINAL, gains, (65.0, 95.0), 4.0)
    return {(q.name, q.at.partition(",")[0]): q for q in result}


def test_maps_above_the_pressures_of_the_runs_are_extrapolated() -> None:
    gains = 0.45, 6.0
    shown = find_highest_pressure(
        [{"cylinder_pressure_bar": np.append(np.full(5000, 3.05), 9.0)}], {**VALUES, OFFSET: 0.1}
    )
    assert shown == pytest.approx(2.95)
    at = [q.at for q in compute_quantities(KNOWN, NOMINAL, gains, (65.0, 95.0), shown) if q.name == "M_C"]
    assert at[:3] == ["2.700 bar", "2.800 bar", "2.900 bar"]
    assert all(one.endswith("bar, extrapolated") for one in at[3:])


@pytest.mark.parametrize("beta_inf", [0.704, 1.0])
def test_a_narrow_stribeck_onset_overflows_nothing(beta_inf: float) -> None:
    """Pressures far below the onset, in scales of it: exp(1000) is no double, and 0 times infinity is no number."""
    values = VALUES | {"clutch.beta_inf": beta_inf, "clutch.beta_onset": 12.0, "clutch.beta_scale": 0.01}
    with np.errstate(over="raise", invalid="raise"):
        _, _, beta = compute_maps(values, np.array([2.0, 11.0]))
    assert beta.tolist() == [1.0, 1.0]


@pytest.mark.parametrize("highest", [-1.0, 2.3, 4.2, 4.39])
def test_maps_are_at_the_pressures_of_the_thesis(highest: float) -> None:
    assert list_pressures(2.35, highest) == pytest.approx([2.7, 2.8, 2.9, 3.0, 3.2, 3.4, 3.6, 3.8, 4.0, 4.2])


@pytest.mark.parametrize(("highest", "further"), [(4.61, 2), (5.01, 4), (11.4, 10), (40.0, 10)])
def test_maps_go_on_to_the_highest_pressure_of_the_runs(highest: float, further: int) -> None:
    """A clutch of 10 bar had a table that ended 1.85 bar above contact."""
    pressures = list_pressures(2.35, highest)
    assert (len(pressures), pressures[-1]) == (10 + further, highest)
    assert np.diff(pressures)[9:] == pytest.approx((highest - 4.2) / further)
    result = compute_quantities(KNOWN, NOMINAL, (0.45, 6.0), (65.0, 95.0), highest)
    for name, map_ in zip(("M_C", "C_v", "beta"), compute_maps(VALUES, pressures), strict=True):
        assert [q.value for q in result if q.name == name] == pytest.approx(list(map_))
    assert not any("extrapolated" in q.at for q in result)
    thesis = compute_quantities(KNOWN, NOMINAL, (0.45, 6.0), (65.0, 95.0), 4.2)
    assert [q for q in result if q.where == "Table 6.3"] == [q for q in thesis if q.where == "Table 6.3"]


def test_friction_coefficients_say_of_which_geometry_they_are(quantities: dict[tuple[str, str], Quantity]) -> None:
    """No run shows the plates: a clutch with four times their number has four times the coefficient that is computed."""
    of_friction = [q for (name, _), q in quantities.items() if name.startswith("mu")]
    assert len(of_friction) == 4
    assert all(q.at.endswith("if 2 contacts of 58 mm") for q in of_friction)


def test_the_numbers_of_the_rig_page_come_out() -> None:
    coulomb, viscous, beta = compute_maps(VALUES, np.array([3.4]))[:, 0]
    assert coulomb == pytest.approx(11.62, abs=0.005)  # docs/rig.md
    assert viscous == pytest.approx(2.588, abs=5e-4)
    assert beta == pytest.approx(0.7078, abs=5e-5)
    stiff = {**VALUES, "piston.stack_stiffness": 1e12}
    assert compute_torque(stiff, np.array([3.4]), 20.0, 70.0)[0] == pytest.approx(16.74, abs=0.01)
    assert compute_slope(stiff, 3.4, 200 * RPM, 70.0) == pytest.approx(14.8, abs=2.0)


@pytest.mark.parametrize("celsius", [25.0, 30.0, 30.5, 70.0])
def test_cold_oil_has_the_viscous_torque_that_the_plant_gives_it(celsius: float) -> None:
    """Below T_0 + 1 K the law of eq. 6.3 has no logarithm; the plant keeps the value there, and so do the maps."""
    rig = wet_clutch.Rig(NOMINAL)
    coulomb, viscous, beta = compute_maps(VALUES, np.array([3.4]))[:, 0]
    share = 1.0 + (beta - 1.0) * np.exp(-VALUES["clutch.stribeck_speed"] / 20.0)
    plant = coulomb * share + viscous * viscosity_ratio(celsius + ZERO_CELSIUS, rig.record[0]) * 20.0 ** (1.0 / 3.0)
    stiff = {**VALUES, "piston.stack_stiffness": 1e12}
    assert compute_torque(stiff, np.array([3.4]), 20.0, celsius)[0] == pytest.approx(plant, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "at", "value", "within"),
    [
        ("a_M", "200 rpm", 14.8, 2.0),  # Table 6.3 is of other measurements than Table 6.4, which the rig has
        ("p_contact of the line", "200 rpm", 2.35, 0.1),
        ("mu", "200 rpm", 0.1128, 0.015),
        ("M_C", "3.400 bar", 11.62, 0.01),
        ("beta", "2.700 bar", 1.0, 1e-9),
        ("C", "", 69.0, 1e-9),
        ("lag s_n/C", "3.400 bar", 12.1, 0.1),
        ("fill volume", "for a clearance of 1 mm", 11.31, 0.01),
        ("fill time", "0 to 3.400 bar", 85.0, 15.0),
    ],
)
def test_quantities_of_the_nominal_rig(
    quantities: dict[tuple[str, str], Quantity], name: str, at: str, value: float, within: float
) -> None:
    assert quantities[name, at].value == pytest.approx(value, abs=within)


def test_an_interval_contains_the_correlation(quantities: dict[tuple[str, str], Quantity]) -> None:
    slope = np.array([3.4, 1.0])  # of M_C in its line's slope and intercept
    deviation = np.sqrt(slope @ COVARIANCE[:2, :2] @ slope)
    assert quantities["M_C", "3.400 bar"].half == pytest.approx(1.96 * deviation, rel=1e-6)
    assert quantities["V_S", ""].half == pytest.approx(1.96 * 0.05, rel=1e-6)
    assert quantities["C", ""].half == 0.0
    assert quantities["fill time", "0 to 3.400 bar"].half > 0.0


def test_propagation_is_that_of_a_draw() -> None:
    """Half widths against the spread of 4000 rigs drawn from the same covariance."""
    pressure = np.array([2.8, 3.4, 4.2])

    def torque(v: dict[str, float]) -> np.ndarray:
        return compute_torque(v, pressure, 5.0, 70.0)

    _, half = KNOWN(torque)  # type: ignore[arg-type]
    drawn = np.random.default_rng(1).multivariate_normal([VALUES[n] for n in NAMES], COVARIANCE, 4000)
    spread = np.std([torque({**VALUES, **dict(zip(NAMES, row, strict=True))}) for row in drawn], axis=0)
    assert half == pytest.approx(1.96 * spread, rel=0.05)


def test_the_temperature_law_is_given_where_the_runs_were(quantities: dict[tuple[str, str], Quantity]) -> None:
    assert [at for name, at in quantities if name == "mu(T)"] == ["70 degC", "80 degC", "90 degC"]
    values = [q.value for (name, _), q in quantities.items() if name == "mu(T)"]
    assert values == sorted(values, reverse=True)
    assert values[0] == pytest.approx(quantities["mu", "200 rpm"].value)


def test_the_table_has_a_line_for_each(quantities: dict[tuple[str, str], Quantity]) -> None:
    lines = format_table(list(quantities.values()))
    assert len(lines) == len(quantities) + 1
    assert any("Table 6.4" in line and "M_C" in line for line in lines)
