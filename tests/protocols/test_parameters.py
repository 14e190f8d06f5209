"""Parameter files: what is shipped, SI values, a user's changes, and one sentence for everything that is wrong."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from protocols.errors import InputError
from protocols.files.parameters import Parameter, ParameterSet, load_defaults, load_overlay

ROUNDING = 1e-12  # relative: a factor and an offset in doubles

ROOT = Path(__file__).parents[2]
PLANT = ROOT / "plant_sim" / "parameters" / "janssens2010.toml"
CONTROLLER = ROOT / "rt_controller" / "parameters" / "controller.toml"
SHIPPED = [PLANT, *sorted((ROOT / "rt_controller" / "parameters").glob("*.toml"))]

# Janssens 2010, Tables 6.3 to 6.5 and eqs. 6.5 and 6.7, in the units printed there; both sides believe them.
THESIS = {
    "contact_pressure": (2.35, "bar"),  # Table 6.3, -b_M/a_M
    "coulomb_slope": (10.8, "Nm/bar"),  # Table 6.4
    "coulomb_intercept": (-25.1, "Nm"),
    "viscous_slope": (2.67, "Nm/(bar (rad/s)^gamma)"),
    "viscous_intercept": (-6.49, "Nm/(rad/s)^gamma"),
    "beta_inf": (0.704, "1"),  # Table 6.5
    "beta_onset": (2.71, "bar"),
    "beta_scale": (0.158, "bar"),
    "stribeck_speed": (11.52, "rad/s"),  # eq. 6.5
    "viscous_exponent": (1 / 3, "1"),
    "attraction": (69.0, "1/s"),  # eq. 6.7
}
# Table 6.1: A, B, T_0
OIL = {"slope": (-0.0145, "1"), "offset": (0.143, "1"), "origin": (30.0, "degC")}
FITTED_LINE = (14.8, -34.7)  # Nm/bar, Nm: Table 6.3, a_M and b_M

DEFAULTS = """
[clutch]
coulomb_slope = { value = 10.8, unit = "Nm/bar", uncertainty = 0.3, bounds = [1.0, 100.0], source = "Table 6.4" }
beta_onset = { value = 2.71, unit = "bar", uncertainty = 0.03, bounds = [1.0, 10.0], source = "Table 6.5" }
[oil]
reference = { value = 70, unit = "degC", uncertainty = 0, bounds = [35, 150], source = "sec. 6.4.3" }
"""
WHOLE = 'value = 1.0, unit = "bar", uncertainty = 0.1, bounds = [0.0, 2.0], source = "here"'


@pytest.fixture
def user(tmp_path: Path) -> Path:
    return tmp_path / "user.toml"


@pytest.fixture
def defaults(tmp_path: Path) -> ParameterSet:
    path = tmp_path / "defaults.toml"
    path.write_text(DEFAULTS, encoding="utf-8")
    return load_defaults(path)


def change_by(user: Path, defaults: ParameterSet, text: str) -> ParameterSet:
    user.write_text(text, encoding="utf-8")
    return load_overlay(user, defaults)


def find_refusal(call: Callable[[], Any], *sentence: str) -> str:
    with pytest.raises(InputError) as refused:
        call()
    message = str(refused.value)
    assert "\n" not in message
    for text in sentence:
        assert text in message
    return message


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.name)
def test_a_shipped_file_loads_and_every_number_has_a_unit_and_a_source(path: Path) -> None:
    parameters = load_defaults(path)
    assert len(parameters) > 0
    for name, parameter in parameters.items():
        assert parameter.name == name
        assert parameter.unit.strip()
        assert parameter.source.strip()
        assert parameter.uncertainty >= 0.0
        assert parameter.bounds[0] < parameter.bounds[1]
        assert math.isfinite(parameter.si)


def test_the_shipped_files_are_those_of_plant_controller_and_guard() -> None:
    assert {path.name for path in SHIPPED} >= {"janssens2010.toml", "controller.toml", "limits.toml"}


@pytest.mark.parametrize("name", THESIS)
def test_plant_and_controller_have_the_thesis_s_clutch(name: str) -> None:
    group = "piston" if name == "contact_pressure" else "clutch"
    for parameter in (load_defaults(PLANT)[f"{group}.{name}"], load_defaults(CONTROLLER)[f"model.{name}"]):
        value, unit = THESIS[name]
        assert parameter.value == pytest.approx(value, rel=ROUNDING)
        assert parameter.unit == unit
        assert parameter.source.startswith("[T]")


@pytest.mark.parametrize("name", OIL)
def test_plant_and_controller_have_the_thesis_s_oil(name: str) -> None:
    for parameter in (load_defaults(PLANT)[f"oil.{name}"], load_defaults(CONTROLLER)[f"model.oil_{name}"]):
        assert (parameter.value, parameter.unit) == OIL[name]


def test_the_piston_has_the_thesis_s_area_and_contact_pressure() -> None:
    plant = load_defaults(PLANT)
    assert (plant["piston.area"].value, plant["piston.area"].unit) == (1.131e-2, "m^2")  # Table 6.2
    slope, intercept = FITTED_LINE
    assert plant["piston.contact_pressure"].value == pytest.approx(-intercept / slope, abs=0.01)  # printed to 0.01 bar


def test_a_group_is_given_in_si_by_short_name(defaults: ParameterSet) -> None:
    assert defaults.list_si("clutch") == pytest.approx({"coulomb_slope": 1.08e-4, "beta_onset": 2.71e5}, rel=ROUNDING)
    assert defaults.list_si("oil") == pytest.approx({"reference": 343.15}, rel=ROUNDING)


def test_a_group_does_not_take_one_whose_name_begins_alike() -> None:
    parameters = load_defaults(CONTROLLER)
    assert len(parameters.list_si("model")) == sum(name.split(".")[0] == "model" for name in parameters)
    assert parameters.list_si("mod") == {}


def test_values_for_a_run_file_are_in_the_declared_unit(defaults: ParameterSet) -> None:
    assert defaults.as_values() == {"clutch.coulomb_slope": 10.8, "clutch.beta_onset": 2.71, "oil.reference": 70.0}


# A user's file


def test_a_bare_number_changes_a_value_in_its_declared_unit(user: Path, defaults: ParameterSet) -> None:
    changed = change_by(user, defaults, "[clutch]\ncoulomb_slope = 11.5\n[oil]\nreference = 80\n")
    assert changed["clutch.coulomb_slope"] == dataclasses.replace(defaults["clutch.coulomb_slope"], value=11.5)
    assert changed["oil.reference"].si == pytest.approx(353.15, rel=ROUNDING)
    assert changed["clutch.beta_onset"] == defaults["clutch.beta_onset"]


def test_a_table_changes_the_fields_it_names(user: Path, defaults: ParameterSet) -> None:
    text = '[clutch]\ncoulomb_slope = { value = 12, unit = "Nm/bar", source = "run 7", bounds = [2, 20] }\n'
    expected = Parameter("clutch.coulomb_slope", 12.0, "Nm/bar", 0.3, (2.0, 20.0), "run 7")
    assert change_by(user, defaults, text)["clutch.coulomb_slope"] == expected


def test_a_table_may_leave_the_value_as_it_is(user: Path, defaults: ParameterSet) -> None:
    changed = change_by(user, defaults, "[clutch.coulomb_slope]\nuncertainty = 0.1\n")
    assert changed["clutch.coulomb_slope"] == dataclasses.replace(defaults["clutch.coulomb_slope"], uncertainty=0.1)


def test_an_empty_file_changes_nothing(user: Path, defaults: ParameterSet) -> None:
    assert dict(change_by(user, defaults, "")) == dict(defaults)


@pytest.mark.parametrize("value", [1.0, 100.0])
def test_a_value_on_its_bound_is_allowed(user: Path, defaults: ParameterSet, value: float) -> None:
    changed = change_by(user, defaults, f"[clutch]\ncoulomb_slope = {value}\n")
    assert changed["clutch.coulomb_slope"].value == value


# What is wrong in either kind of file, told in one sentence


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ("coulomb_slop = 11.0", ["'clutch.coulomb_slop' is unknown", "did you mean clutch.coulomb_slope"]),
        ("zzz = 11.0", ["'clutch.zzz' is unknown", "clutch."]),
        ("coulomb_slope = 0.999", ["clutch.coulomb_slope = 0.999 Nm/bar", "outside 1..100"]),
        ("coulomb_slope = 100.1", ["clutch.coulomb_slope = 100.1 Nm/bar", "outside 1..100"]),
        ("coulomb_slope = nan", ["clutch.coulomb_slope = nan Nm/bar", "outside 1..100"]),
        ("coulomb_slope = inf", ["clutch.coulomb_slope = inf Nm/bar", "outside 1..100"]),
        ("coulomb_slope = -inf", ["clutch.coulomb_slope = -inf Nm/bar", "outside 1..100"]),
        ("coulomb_slope = inf\nbeta_onset = 2", ["clutch.coulomb_slope = inf"]),
        ("coulomb_slope = { value = inf, bounds = [1, inf] }", ["clutch.coulomb_slope = inf Nm/bar", "outside 1..inf"]),
        ("coulomb_slope = '11'", ["clutch.coulomb_slope is '11'", "a number is needed"]),
        ("coulomb_slope = true", ["clutch.coulomb_slope is True", "a number is needed"]),
        ("coulomb_slope = [11]", ["clutch.coulomb_slope is [11]", "a number is needed"]),
        ("coulomb_slope = 2026-01-01", ["clutch.coulomb_slope is", "a number is needed"]),
        ("coulomb_slope = { value = 11, unit = 'Nm' }", ["clutch.coulomb_slope", "'Nm'", "its unit is 'Nm/bar'"]),
        ("coulomb_slope = { unit = 7 }", ["clutch.coulomb_slope", "7", "its unit is 'Nm/bar'"]),
        ("coulomb_slope = { valeu = 11 }", ["clutch.coulomb_slope", "unknown field 'valeu'", "value, unit"]),
        ("coulomb_slope = { bounds = [1, 5] }", ["clutch.coulomb_slope = 10.8 Nm/bar", "outside 1..5"]),
        ("coulomb_slope = { bounds = [100, 1] }", ["clutch.coulomb_slope has bounds [100, 1]", "[low, high]"]),
        ("coulomb_slope = { bounds = [1] }", ["clutch.coulomb_slope has bounds [1]", "[low, high]"]),
        (
            "coulomb_slope = { bounds = [0, 99] }",
            ["coulomb_slope has bounds 0 to 99", "its lower bound must be above 0"],
        ),
        (
            "coulomb_slope = { bounds = [-1, 99] }",
            ["coulomb_slope has bounds -1 to 99", "its lower bound must be above 0"],
        ),
        (f"coulomb_slope = {'1' * 5000}", ["cannot be read", "4300 digits"]),
        (f"coulomb_slope = {'[' * 20_000}{']' * 20_000}", ["cannot be read", "nested too deep"]),
        (f"coulomb_slope = {'{a=' * 5000}1{'}' * 5000}", ["cannot be read", "nested too deep"]),
        ("coulomb_slope = { bounds = 5 }", ["clutch.coulomb_slope has bounds 5", "[low, high]"]),
        ("coulomb_slope = { bounds = [1, 'x'] }", ["clutch.coulomb_slope is 'x'", "a number is needed"]),
        ("coulomb_slope = { bounds = [nan, 99] }", ["clutch.coulomb_slope has bounds [nan, 99]", "[low, high]"]),
        ("coulomb_slope = { uncertainty = -0.1 }", ["clutch.coulomb_slope has uncertainty -0.1", "0 or more"]),
        ("coulomb_slope = { uncertainty = nan }", ["clutch.coulomb_slope has uncertainty nan", "0 or more"]),
        ("coulomb_slope = 11\ncoulomb_slope = 12", ["cannot be read"]),
        ("coulomb_slope = ", ["cannot be read", "line 2"]),
    ],
)
def test_a_wrong_entry_of_a_user_is_told_in_one_sentence(
    user: Path, defaults: ParameterSet, entry: str, sentence: list[str]
) -> None:
    find_refusal(lambda: change_by(user, defaults, f"[clutch]\n{entry}\n"), str(user), *sentence)


@pytest.mark.parametrize("entry", ["'11'", "true"])
def test_a_value_that_is_no_number_is_refused_with_unit_and_allowed_range(
    user: Path, defaults: ParameterSet, entry: str
) -> None:
    text = f"[clutch]\ncoulomb_slope = {entry}\n"
    find_refusal(lambda: change_by(user, defaults, text), "clutch.coulomb_slope", "Nm/bar", "1 <= value <= 100")


def test_an_absurdly_large_integer_is_refused(user: Path, defaults: ParameterSet) -> None:
    find_refusal(lambda: change_by(user, defaults, f"[clutch]\ncoulomb_slope = 1{'0' * 400}\n"), str(user))


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        (WHOLE.replace("1.0", "3.0"), ["clutch.x = 3 bar", "outside 0..2"]),
        (WHOLE.replace('"bar"', '"barr"'), ["'barr' is unknown", "bar"]),
        (WHOLE.replace("1.0", '"one"'), ["clutch.x is 'one'", "a number is needed, in bar, 0 <= value <= 2"]),
        (
            WHOLE.replace("1.0", '"one"').replace("bar", "1"),
            ["clutch.x is 'one'", "a number is needed, 0 <= value <= 2"],
        ),
        (WHOLE.replace("0.1", "-0.1"), ["clutch.x has uncertainty -0.1"]),
        (WHOLE.replace("[0.0, 2.0]", "[0.0]"), ["clutch.x has bounds [0.0]"]),
        (WHOLE.replace(', source = "here"', ""), ["clutch.x", "exactly the fields", "source"]),
        (WHOLE.replace(', unit = "bar"', ""), ["clutch.x", "exactly the fields", "unit"]),
        (WHOLE + ", note = 1", ["clutch.x", "exactly the fields"]),
    ],
)
def test_a_wrong_declaration_is_told_in_one_sentence(tmp_path: Path, entry: str, sentence: list[str]) -> None:
    path = tmp_path / "defaults.toml"
    path.write_text(f"[clutch]\nx = {{ {entry} }}\n", encoding="utf-8")
    find_refusal(lambda: load_defaults(path), str(path), *sentence)


def test_the_declaration_before_it_is_spoilt_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "defaults.toml"
    path.write_text(f"[clutch]\nx = {{ {WHOLE} }}\n", encoding="utf-8")
    assert load_defaults(path)["clutch.x"] == Parameter("clutch.x", 1.0, "bar", 0.1, (0.0, 2.0), "here")


def test_a_bare_number_is_no_declaration(tmp_path: Path) -> None:
    path = tmp_path / "defaults.toml"
    path.write_text("[clutch]\nx = 1.0\n", encoding="utf-8")
    find_refusal(lambda: load_defaults(path), str(path), "clutch.x", "exactly the fields")


@pytest.fixture(params=["defaults", "overlay"])
def load(request: pytest.FixtureRequest, defaults: ParameterSet) -> Callable[[Path], ParameterSet]:
    return load_defaults if request.param == "defaults" else lambda path: load_overlay(path, defaults)


def test_a_missing_file_is_told_in_one_sentence(user: Path, load: Callable[[Path], ParameterSet]) -> None:
    assert find_refusal(lambda: load(user)) == f"parameter file {user} does not exist"


def test_broken_toml_is_told_in_one_sentence_with_its_line(user: Path, load: Callable[[Path], ParameterSet]) -> None:
    user.write_text("[clutch]\n\ncoulomb_slope 11\n", encoding="utf-8")
    find_refusal(lambda: load(user), f"parameter file {user} cannot be read", "line 3")


def test_bytes_that_are_no_text_are_told_in_one_sentence(user: Path, load: Callable[[Path], ParameterSet]) -> None:
    user.write_bytes(b"\xff\xfe\x00")
    find_refusal(lambda: load(user), f"parameter file {user} cannot be read")


def test_a_folder_is_no_parameter_file(tmp_path: Path, load: Callable[[Path], ParameterSet]) -> None:
    find_refusal(lambda: load(tmp_path), f"parameter file {tmp_path} cannot be read")


def test_a_value_outside_a_group_is_told_in_one_sentence(user: Path, load: Callable[[Path], ParameterSet]) -> None:
    user.write_text("coulomb_slope = 11.0\n", encoding="utf-8")
    find_refusal(lambda: load(user), str(user), "coulomb_slope is outside of a [group]")


# Sets do not change


def test_a_parameter_cannot_be_changed(defaults: ParameterSet) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        defaults["clutch.coulomb_slope"].value = 1.0  # type: ignore[misc]


def test_a_set_has_no_way_to_assign_or_delete(defaults: ParameterSet) -> None:
    assert not hasattr(defaults, "__setitem__")
    assert not hasattr(defaults, "__delitem__")


def test_changes_give_a_new_set_and_leave_the_old(user: Path, defaults: ParameterSet) -> None:
    before = dict(defaults)
    assert defaults.with_values({"clutch.coulomb_slope": 12})["clutch.coulomb_slope"].value == 12.0
    assert change_by(user, defaults, "[clutch]\ncoulomb_slope = 13\n")["clutch.coulomb_slope"].value == 13.0
    defaults.as_values()["clutch.coulomb_slope"] = 14.0
    defaults.list_si("clutch")["coulomb_slope"] = 15.0
    assert dict(defaults) == before


def test_a_set_does_not_follow_the_mapping_it_was_made_from(defaults: ParameterSet) -> None:
    source = dict(defaults)
    copy = ParameterSet(source)
    source.clear()
    assert len(copy) == len(defaults) == 3


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("clutch.coulomb_slop", 11.0, "did you mean clutch.coulomb_slope"),
        ("clutch.coulomb_slope", 0.5, "clutch.coulomb_slope = 0.5 Nm/bar is outside 1..100"),
        ("clutch.coulomb_slope", math.nan, "clutch.coulomb_slope = nan Nm/bar is outside"),
        ("clutch.coulomb_slope", "11", "clutch.coulomb_slope is '11'; a number is needed"),
        ("clutch.coulomb_slope", True, "clutch.coulomb_slope is True; a number is needed"),
    ],
)
def test_a_wrong_change_is_told_in_one_sentence(defaults: ParameterSet, name: str, value: Any, sentence: str) -> None:
    find_refusal(lambda: defaults.with_values({name: value}), sentence)


def test_a_known_name_is_in_the_set_and_an_unknown_one_is_not(defaults: ParameterSet) -> None:
    assert "clutch.coulomb_slope" in defaults
    assert "clutch.coulomb_slop" not in defaults
    find_refusal(lambda: defaults["clutch.coulomb_slop"], "did you mean clutch.coulomb_slope")
