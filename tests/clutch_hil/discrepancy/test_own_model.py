"""The model in docs/examples does what docs/own_model.md says."""

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from clutch_hil.discrepancy.model_file import write_model
from clutch_hil.discrepancy.models.named import declare_parameters, find_model
from clutch_hil.discrepancy.result import NAMED
from clutch_hil.discrepancy.search import investigate
from clutch_hil.fitting.model import Candidate
from plant_sim.effects.catalogue import find_effect
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.files.runs import read_run
from tests.clutch_hil.discrepancy.least_squares import compute_error, fit_least_squares

DOCS = Path(__file__).parents[3] / "docs"
NOISE = 0.05  # degC, of the example
SURE = 3e-3  # relative: area found; measured 7e-4


@pytest.fixture(scope="module")
def heater() -> ModuleType:
    specification = importlib.util.spec_from_file_location("heater", DOCS / "examples" / "heater.py")
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def test_each_candidate_changes_nothing_while_it_is_off(heater: ModuleType) -> None:
    model, run = heater.Heater(), heater.measure_heater(1, (50, 10))
    base = {name: p.value for name, p in model.parameters.items()}
    plain = model.simulate(run, base, {})["temperature_degc"]
    for candidate in model.candidates:
        off = model.simulate(run, base, candidate.list_off_values())["temperature_degc"]
        np.testing.assert_array_equal(off, plain, candidate.name)


def test_radiation_explains_the_runs_and_its_rivals_do_not(heater: ModuleType) -> None:
    model, runs = heater.Heater(), [heater.measure_heater(1, (50, 10, 90)), heater.measure_heater(2, (20, 80, 0))]
    held_out = [heater.measure_heater(3, (70, 30, 110, 0))]
    outcome = {c.name: fit_least_squares(model, runs, c.list_typical_values()) for c in model.candidates}
    errors = {name: compute_error(model, held_out, *values) for name, values in outcome.items()}
    assert min(errors, key=lambda name: errors[name]) == "radiation"
    assert errors["radiation"] == pytest.approx(NOISE, rel=0.05)
    assert sorted(errors.values())[1] > 10.0 * NOISE
    assert outcome["radiation"][1]["radiation.area"] == pytest.approx(0.03, rel=SURE)


def test_a_model_file_switches_effects_on(heater: ModuleType) -> None:
    model, run = heater.Heater(), heater.measure_heater(1, (50, 10))
    base = {name: p.value for name, p in model.parameters.items()}
    whole = ParameterSet(
        {**model.parameters, **{n: p for c in model.candidates for n, p in c.declare_parameters().items()}}
    )
    extended = heater.Heater(whole.with_values({"radiation.area": 0.02}))
    assert "radiation" not in {c.name for c in extended.candidates}
    np.testing.assert_array_equal(
        extended.simulate(run, base, {})["temperature_degc"],
        model.simulate(run, base, {"radiation.area": 0.02})["temperature_degc"],
    )


def test_the_script_writes_runs_with_the_model_s_columns(
    heater: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import runpy
    import sys

    monkeypatch.setattr(sys, "argv", ["heater.py", str(tmp_path)])
    runpy.run_path(str(DOCS / "examples" / "heater.py"), run_name="__main__")
    model = heater.Heater
    for name in ("one", "two", "held_out"):
        run = read_run(tmp_path / f"{name}.parquet", ("time_s", *model.inputs, *(o.column for o in model.outputs)))
        assert len(run["time_s"]) == 600


def test_the_workflow_names_radiation_and_the_model_file_has_it(heater: ModuleType, tmp_path: Path) -> None:
    """By PATH.py:CLASS and on the runs of docs/own_model.md: convection, which leads alone, is not left beside it."""
    rig = f"{DOCS / 'examples' / 'heater.py'}:Heater"
    model = find_model(rig)
    runs = {"one": heater.measure_heater(1, (50, 10, 90)), "two": heater.measure_heater(2, (20, 80, 0))}
    result = investigate(model, runs, {"held out": heater.measure_heater(3, (70, 30, 110, 0))})
    assert (result.verdict, result.effects) == (NAMED, ["radiation"])
    assert result.gap["temperature_degc"].after < 1.1 * NOISE
    write_model(result, declare_parameters(model), tmp_path / "model.toml")
    extended = find_model(rig, tmp_path / "model.toml")
    assert "radiation" not in {c.name for c in extended.candidates}


def test_the_page_shows_the_example_as_it_is(heater: ModuleType) -> None:
    page = (DOCS / "own_model.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert eval(block, vars(heater)) == heater.Heater.candidates[0]


def test_a_model_from_before_the_move_is_told_where_things_are_now(tmp_path: Path) -> None:
    """As the example of 2026-11-24 began; every import that has moved is told at once."""
    (tmp_path / "mine.py").write_text(
        "import numpy as np\n"
        "from plant_sim.discrepancy.model import Candidate, Output\n"
        "from plant_sim.effects.effect import Strength\n"
        "from protocols.parameters import Parameter, ParameterSet\n"
        "from protocols.runs import Run, write_run\n",
        encoding="utf-8",
    )
    with pytest.raises(InputError) as refused:
        find_model(f"{tmp_path / 'mine.py'}:Mine")
    assert str(refused.value).endswith(
        "No module named 'plant_sim.discrepancy', in line 2; plant_sim.discrepancy.model is now clutch_hil.fitting.model;"
        " protocols.parameters is now protocols.files.parameters; protocols.runs is now protocols.files.runs"
    )


def test_a_file_named_as_a_module_of_python_takes_no_place(tmp_path: Path) -> None:
    before = sys.modules["json"]
    (tmp_path / "json.py").write_text((DOCS / "examples" / "heater.py").read_text(encoding="utf-8"), encoding="utf-8")
    assert find_model(f"{tmp_path / 'json.py'}:Heater").name == "heater"
    assert sys.modules["json"] is before


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("import sys; sys.exit(3)", r"one\.py cannot be loaded: SystemExit: 3"),
        ("raise ValueError('one\\ntwo')", r"one\.py cannot be loaded: ValueError: one two"),
        ("class One:\n    def __init__(self):\n        exit(3)", "cannot be made without arguments: SystemExit: 3"),
        ("class Two: ...", r"has no class 'One'; known are Two"),
    ],
)
def test_a_file_that_gives_no_model_is_told_in_one_sentence(text: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        find_model(f"{tmp_path / 'one.py'}:One")


def test_a_model_that_looks_for_something_else_is_told_only_that(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("import no_such_module\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"No module named 'no_such_module', in line 1$"):
        find_model(f"{tmp_path / 'mine.py'}:Mine")


def test_an_effect_of_the_catalogue_is_a_candidate() -> None:
    assert Candidate.of(find_effect("torque_sensor_offset")).list_off_values() == {"torque_sensor_offset.offset": 0.0}
