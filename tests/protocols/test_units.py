"""Units: what people write is converted as pint does, what is none is refused in one sentence."""

import math

import pytest

from plant_sim.effects.catalogue import load_effects
from protocols.files.parameters import Parameter, load_defaults
from protocols.files.unit_table import CONVERSIONS
from protocols.files.units import from_si, have_same_quantity, parse_unit, to_si
from tests.protocols.test_parameters import ROUNDING, SHIPPED, find_refusal


@pytest.mark.parametrize(
    ("value", "unit", "si"),
    [
        (2.35, "bar", 2.35e5),
        (10.8, "Nm/bar", 1.08e-4),
        (2.67, "Nm/(bar (rad/s)^gamma)", 2.67e-5),
        (2.0e-4, "m^3/(s bar)", 2.0e-9),
        (1.0e-6, "m^3/bar", 1.0e-11),
        (2.5, "bar/V", 2.5e5),
        (1.0, "V/bar", 1.0e-5),
        (0.012, "bar/Nm", 1200.0),
        (70.0, "degC", 343.15),
        (-273.15, "degC", 0.0),
        (60.0, "rpm", 2.0 * math.pi),
        (0.1, "K", 0.1),
        (-25.1, "Nm", -25.1),
    ],
)
def test_si_values_are_those_computed_by_hand(value: float, unit: str, si: float) -> None:
    assert to_si(value, unit) == pytest.approx(si, rel=ROUNDING)
    assert Parameter("x", value, unit, 0.0, (-1e3, 1e3), "here").si == to_si(value, unit)


@pytest.mark.parametrize(
    ("unit", "factor", "offset"),
    [
        ("%", 0.01, 0.0),
        ("kg m^2/s", 1.0, 0.0),
        ("mbar", 100.0, 0.0),
        ("psi", 6894.757293168362, 0.0),  # lbf/in^2
        ("l/min", 1e-3 / 60.0, 0.0),
        ("kNm", 1e3, 0.0),
        ("Nms", 1.0, 0.0),
        ("Nm/deg", 180.0 / math.pi, 0.0),
        ("degF", 5.0 / 9.0, 273.15 - 32.0 * 5.0 / 9.0),
        ("°C", 1.0, 273.15),
        ("bar/degC", 1e5, 0.0),  # of a difference
        ("counts/rev", 1.0, 0.0),  # a number of lines, no angle
        ("cycles", 1.0, 0.0),
    ],
)
def test_what_people_write_is_a_unit(unit: str, factor: float, offset: float) -> None:
    assert to_si(0.0, unit) == pytest.approx(offset, rel=ROUNDING)
    assert to_si(1.0, unit) - to_si(0.0, unit) == pytest.approx(factor, rel=1e-12)
    assert from_si(to_si(3.0, unit), unit) == pytest.approx(3.0, rel=1e-12)


@pytest.mark.parametrize("unit", CONVERSIONS)
def test_the_table_has_what_pint_gives(unit: str) -> None:
    assert CONVERSIONS[unit] == parse_unit(unit)


def test_the_table_has_every_unit_that_is_delivered() -> None:
    shipped = {parameter.unit for path in SHIPPED for parameter in load_defaults(path).values()}
    assert shipped | {parameter.unit for effect in load_effects().values() for parameter in effect.parameters} <= set(
        CONVERSIONS
    )


@pytest.mark.parametrize(
    "unit",
    ["blub", "", " ", "m" * 1000, "10 bar", "km^999999999", "m^m", "Nm)", "bar;", "__import__('os')", "0", "-", "Bar"],
)
def test_what_is_no_unit_is_refused_in_one_sentence(unit: str) -> None:
    find_refusal(lambda: to_si(1.0, unit), "is unknown", "products and quotients such as kg m^2/s")


def test_a_unit_that_is_nearly_one_is_hinted_at() -> None:
    find_refusal(lambda: to_si(1.0, "Bar"), "unit 'Bar' is unknown; did you mean bar or mbar")


@pytest.mark.parametrize("unit", ["Grad", "Grad/s", "grad", "Mbar", "Mm", "Ms", "kN*Mm", "MA", "MV", "mPa", "mil"])
def test_what_can_be_misread_is_refused_with_what_to_write(unit: str) -> None:
    find_refusal(lambda: to_si(1.0, unit), f"unit {unit!r} is not allowed", "can be misread; write")


def test_a_viscosity_in_mpa_s_is_what_it_says() -> None:
    assert to_si(10.0, "mPa s") == pytest.approx(0.01, rel=1e-15)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("kN·m", 1e3),
        ("N⋅m", 1.0),
        ("cNm", 0.01),
        ("daNm", 10.0),
        ("Ncm", 0.01),
        ("mNm", 1e-3),
        ("Nmm", 1e-3),
        ("MNm", 1e6),
    ],
)
def test_products_are_read_however_they_are_written(unit: str, factor: float) -> None:
    assert to_si(1.0, unit) == pytest.approx(factor, rel=1e-15)
    assert have_same_quantity(unit, "Nm")


@pytest.mark.parametrize(
    ("unit", "other", "same"),
    [
        ("rpm", "rad/s", True),
        ("mbar", "bar", True),
        ("Nm", "J", True),
        ("Hz", "1/s", True),
        ("degF", "degC", True),
        ("Hz", "rad/s", False),
        ("Nm", "bar", False),
        ("1", "%", True),
        ("cycles", "rad", False),
    ],
)
def test_units_of_one_quantity(unit: str, other: str, same: bool) -> None:
    assert have_same_quantity(unit, other) is same
