"""Units of a user's file and words: a parameter may have another than the declared; a refused number is told one that fits."""

import math
from pathlib import Path

import pytest

from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.other_units import _OTHERS, describe_other_unit, parse_number, refuse_unit_alone
from protocols.files.parameters import load_overlay
from protocols.files.units import have_same_quantity, parse_unit

RIG = wet_clutch.load_nominal()


@pytest.mark.parametrize(
    ("name", "value", "hint"),
    [
        ("piston.contact_pressure", 235000.0, "; 235000 Pa would be 2.35 bar"),
        ("piston.contact_pressure", 235.0, "; 235 kPa would be 2.35 bar"),
        ("piston.contact_pressure", 0.235, "; 0.235 MPa would be 2.35 bar"),
        ("valve.frequency", 8000.0, "; 8000 rpm would be 837.8 rad/s"),
        ("valve.frequency", 2.0, "; 2 Hz would be 12.57 rad/s"),
        ("clutch.stribeck_speed", 110.0, "; 110 rpm would be 11.52 rad/s"),
        ("piston.clearance", 1.0, "; 1 mm would be 0.001 m"),
        ("piston.area", 113.1, "; 113.1 cm^2 would be 0.01131 m^2"),
        ("motor.inertia", 500.0, "; 500 kg cm^2 would be 0.05 kg m^2"),
        ("hydraulics.conductance", 12.0, "; 12 l/(min bar) would be 0.0002 m^3/(s bar)"),
        ("oil.sump_temperature", 343.15, "; 343.15 K would be 70 degC"),
        ("piston.contact_pressure", -1.0, ""),
        ("piston.contact_pressure", math.inf, ""),
        ("piston.contact_pressure", math.nan, ""),
        ("clutch.beta_inf", 70.0, "; 70 % would be 0.7"),
        ("clutch.beta_inf", -70.0, ""),
    ],
)
def test_a_refused_value_is_told_the_unit_in_which_it_fits(name: str, value: float, hint: str) -> None:
    low, high = RIG[name].bounds
    if name == "valve.frequency" and value == 8000.0:
        high = 1000.0
    else:
        with pytest.raises(InputError) as refused:
            RIG.with_values({name: value})
        assert str(refused.value).endswith(f"is outside {low:g}..{high:g}{hint}")
    assert describe_other_unit(value, RIG[name].unit, low, high) == hint


def test_the_factors_are_those_of_pint() -> None:
    for unit, others in _OTHERS.items():
        for other, factor in others.items():
            ratio = parse_unit(other)[0] / parse_unit(unit)[0]
            in_turns = (unit, other) == ("rad/s", "Hz")  # pint knows no angle in Hz; on a data sheet it is turns
            assert factor == pytest.approx(2.0 * math.pi if in_turns else ratio, rel=1e-12)
            assert in_turns or have_same_quantity(unit, other)


@pytest.mark.parametrize(
    ("line", "value"),
    [
        ('piston.contact_pressure = "34 psi"', 34.0 * 0.06894757293168362),
        ('piston.contact_pressure = "235kPa"', 2.35),
        ('piston.contact_pressure = " 2.35 bar "', 2.35),
        ('piston.contact_pressure = { value = 0.235, unit = "MPa" }', 2.35),
        ('valve.frequency = "8 Hz"', 16.0 * math.pi),
        ('valve.frequency = "+4.8e2 rpm"', 16.0 * math.pi),
        ('piston.clearance = ".9 mm"', 9e-4),
        ('piston.area = "113 cm^2"', 0.0113),
        ('oil.sump_temperature = "343.15 K"', 70.0),
        ('clutch.beta_inf = "70 %"', 0.7),
    ],
)
def test_a_file_may_give_a_parameter_in_another_unit(tmp_path: Path, line: str, value: float) -> None:
    name = line.partition(" ")[0]
    changed = load_overlay(write_line(tmp_path, line), RIG)
    assert changed[name].value == pytest.approx(value, rel=1e-12)
    assert changed[name].unit == RIG[name].unit
    assert changed[name].bounds == RIG[name].bounds


def test_bounds_and_uncertainty_are_in_the_unit_of_the_value(tmp_path: Path) -> None:
    line = 'oil.sump_temperature = { value = 343.15, unit = "K", uncertainty = 2.0, bounds = [293.15, 373.15] }'
    changed = load_overlay(write_line(tmp_path, line), RIG)["oil.sump_temperature"]
    assert (changed.value, changed.uncertainty, *changed.bounds) == pytest.approx((70.0, 2.0, 20.0, 100.0), rel=1e-12)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (
            'piston.contact_pressure = "34 Nm"',
            "piston.contact_pressure is given in 'Nm'; its unit is 'bar'; allowed are also Pa, kPa, MPa",
        ),
        (
            'piston.contact_pressure = { value = 34, unit = "Nm" }',
            "given in 'Nm'; its unit is 'bar'; allowed are also Pa",
        ),
        ("piston.contact_pressure = { value = 34, unit = 3 }", "given in 3; its unit is 'bar'; allowed are also Pa"),
        ('piston.contact_pressure = "34"', "parameter piston.contact_pressure is '34'; a number is needed, in bar,"),
        ('piston.contact_pressure = "psi"', "is 'psi'; a number is needed, in bar,"),
        ('piston.contact_pressure = "nan bar"', "is 'nan bar'; a number is needed, in bar,"),
        ('piston.contact_pressure = "1e400 bar"', "= inf bar is outside"),
        ('piston.contact_pressure = "-34 psi"', "= -2.34422 bar is outside"),
        ('piston.contact_pressure = { value = "34 psi", unit = "bar" }', "is '34 psi'; a number is needed, in bar,"),
        ('piston.contact_pressure = { value = true, unit = "psi" }', "is True; a number is needed, in bar,"),
        (f'piston.contact_pressure = "{"1" * 5000} bar"', "; a number is needed, in bar,"),
        (
            'piston.contact_pressure = { unit = "psi" }',
            "contact_pressure has the unit 'psi' and no value; give a value in it",
        ),
        ('oil.sump_temperature = "158 degF"', "is given in 'degF'; its unit is 'degC'; allowed is also K"),
    ],
)
def test_a_unit_that_does_not_fit_is_refused(tmp_path: Path, line: str, sentence: str) -> None:
    with pytest.raises(InputError) as refused:
        load_overlay(write_line(tmp_path, line), RIG)
    assert sentence in str(refused.value)
    assert str(refused.value).startswith(str(tmp_path))


def write_line(tmp_path: Path, line: str) -> Path:
    """A user's file with one entry, `group.name = ...`."""
    group, _, entry = line.partition(".")
    (path := tmp_path / "rig.toml").write_text(f"[{group}]\n{entry}\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2.35", 2.35),
        ("34 psi", 34.0 * 0.06894757293168362),
        ("34psi", 34.0 * 0.06894757293168362),
        ("235kPa", 2.35),
        ("2.35 bar", 2.35),
        ("1e1", 10.0),
        ("abc", None),
        ("", None),
        ("psi", None),
        ("nan bar", None),
    ],
)
def test_a_word_may_have_a_number_with_its_unit(text: str, value: float | None) -> None:
    read = parse_number("piston.contact_pressure", text, lambda: "bar")
    assert read is None if value is None else read == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("text", ["34 Nm", "1 e1", "0x10", "5e"])
def test_a_word_with_a_unit_that_does_not_fit_is_refused(text: str) -> None:
    with pytest.raises(
        InputError, match=r"^piston.contact_pressure is given in '.*'; its unit is 'bar'; allowed are also Pa,"
    ):
        parse_number("piston.contact_pressure", text, lambda: "bar")


def test_the_declared_unit_is_looked_up_only_where_a_unit_is_given() -> None:
    def ask_the_bench() -> str:
        raise InputError("no bench runs")

    assert parse_number("piston.contact_pressure", "2.35", ask_the_bench) == 2.35
    with pytest.raises(InputError, match="no bench runs"):
        parse_number("piston.contact_pressure", "34 psi", ask_the_bench)


@pytest.mark.parametrize("word", ["psi", "Hz", "K", "degC", "%", "ms"])
def test_a_unit_in_a_word_of_its_own_is_told_how_to_write_it(word: str) -> None:
    with pytest.raises(
        InputError, match=f"^'{word}' is a unit without a number; write both as one word, such as NAME=34{word}$"
    ):
        refuse_unit_alone(word)


def test_a_name_is_no_unit() -> None:
    for name in (*RIG, "internal_leakage", "1", ""):
        refuse_unit_alone(name)
