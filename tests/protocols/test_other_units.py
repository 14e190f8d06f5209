"""A number that a parameter refuses is told the unit in which it would fit."""

import math

import pytest

from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.other_units import _OTHERS, describe_other_unit
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
        ("clutch.beta_inf", 70.0, ""),
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
