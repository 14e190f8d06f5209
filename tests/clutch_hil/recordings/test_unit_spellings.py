"""Spellings of units by tools and languages."""

import pytest

from clutch_hil.recordings.channel import simplify_unit
from protocols.files.units import to_si


@pytest.mark.parametrize(
    ("written", "unit"),
    [
        ("C", "degC"), ("[Grad C]", "degC"), ("Volt", "V"), ("Amps", "A"), ("Bar", "bar"), ("PSI", "psi"),
        ("RPM", "rpm"), ("U/min", "rpm"), ("rev/min", "rpm"), ("Grad", "deg"), ("Degrees", "deg"), ("Grad/s", "deg/s"),
        ("N-m", "Nm"), ("Prozent", "%"), ("m/s2", "m/s^2"), ("m3/h", "m^3/h"), ("KN", "kN"), ("(kPa)", "kPa"), ("Kpa", "kPa"),
        ("sec", "s"), ("--", "1"), ("bar(g)", "bar"), ("barg", "bar"), ("PSIG", "psi"), ("mBar", "mbar"), ("DegC", "degC"),
        ("°c", "degC"), ("deg F", "degF"), ("ft-lb", "ft*lbf"), ("Newtonmeter", "Nm"), ("Rad/s", "rad/s"), ("min-1", "1/min"),
        ("Â°C", "degC"), ("øC", "degC"), ("¡C", "degC"), ("\ufffdC", "degC"), ("Â° F", "degF"), ("1/Minute", "1/min"),
        ("tr/mn", "rpm"), ("mkp", "kgf*m"), ("cm kg", "kgf*cm"), ("kp", "kgf"), ("%%", "%"), ("秒", "s"), ("N・m", "Nm"),
    ],
)  # fmt: skip
def test_spellings_of_tools_and_languages_are_known(written: str, unit: str) -> None:
    assert to_si(1.0, simplify_unit(written)) == to_si(1.0, unit)


@pytest.mark.parametrize("unit", ["mbar", "Nm", "mPa", "MPa", "mV", "kN", "us", "degC", "rad/s", "1/min", "foo", "min"])
def test_other_units_stay_as_they_are(unit: str) -> None:
    assert simplify_unit(unit) == unit
