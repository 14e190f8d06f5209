"""A mistake in a model of one's own is one sentence before any fit."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.discrepancy.models.model_check import check_declarations, check_simulation
from clutch_hil.fitting.model import Candidate, Output
from plant_sim.effects.effect import Shape, Strength
from protocols.errors import InputError
from protocols.files.parameters import Parameter, ParameterSet

RUN = {"time_s": np.arange(1000) / 100.0, "x": np.linspace(0.0, 1.0, 1000), "y": np.linspace(0.0, 1.0, 1000)}
SIZE = Strength("size", "1", off=0.0, typical=0.1, bounds=(0.0, 1.0), source="a test")
FORM = Shape("form", "1", typical=1.0, bounds=(0.1, 9.0), source="a test")
BENT = Candidate("bent", "line", "bent", "y = x^2", (SIZE, FORM))


class Line:
    """y = gain x + size x^2."""

    name = "line"
    inputs: Any = ("x",)
    outputs: Any = (Output("y", "m", "line", 0.01),)
    parameters: Any = ParameterSet({"line.gain": Parameter("line.gain", 1.0, "1", 0.1, (0.0, 9.0), "a test")})
    candidates: Any = (BENT,)

    def simulate(self, run: Any, parameters: Any, effects: Any) -> Any:
        return {"y": parameters["line.gain"] * run["x"] + effects.get("bent.size", 0.0) * run["x"] ** 2}


def test_a_sound_model_is_accepted() -> None:
    check_declarations(Line(), "line")
    check_simulation(Line(), "line", RUN)


def change_strength(**changes: Any) -> tuple[Candidate, ...]:
    return (replace(BENT, parameters=(replace(SIZE, **changes),)),)


@pytest.mark.parametrize(
    ("attribute", "value", "sentence"),
    [
        ("inputs", "x", r"rig line: inputs is 'x'; a tuple of names is needed, with a comma also behind a single one"),
        ("inputs", ("x", 1), "a tuple of names is needed"),
        ("outputs", Output("y", "m", "line"), "a tuple of Output is needed, with a comma also behind a single one"),
        ("outputs", (), "rig line has no outputs"),
        ("outputs", (Output("y", "m", "line"), Output("y", "m", "b")), "column of two outputs: y"),
        (
            "outputs",
            (Output("y", "m", "line", -1.0),),
            "output y has the resolution -1.0; a number, 0 or more, is needed",
        ),
        ("outputs", (Output("y", "m", "line", "0.05"),), "output y has the resolution '0.05'"),  # type: ignore[arg-type]
        ("outputs", (Output("y", "m", "line", np.nan),), "output y has the resolution nan"),
        ("parameters", {"gain": 1.0}, "parameters is of the type dict; a ParameterSet is needed"),
        ("candidates", BENT, "a tuple of Candidate is needed"),
        ("candidates", (BENT, BENT), "name of two candidates: bent"),
        ("candidates", (replace(BENT, parameters=(FORM,)),), "candidate bent has no Strength"),
        ("candidates", (replace(BENT, parameters=(SIZE, SIZE)),), "name of two parameters: size"),
        (
            "candidates",
            change_strength(typical=2.0),
            "size has typical 2.0 and the bounds 0.0 to 1.0; it must be within",
        ),
        ("candidates", change_strength(off=-1.0), "size has off -1.0 and the bounds 0.0 to 1.0"),
        ("candidates", change_strength(typical=np.inf), "size has typical inf"),
        ("candidates", change_strength(bounds=(0.0,)), r"size has the bounds \(0.0,\); a lowest and a highest value"),
        ("candidates", change_strength(typical=0.0), "size has the same value 0.0 at off and typical"),
    ],
)
def test_what_is_declared_wrongly_is_told(attribute: str, value: Any, sentence: str) -> None:
    model = Line()
    setattr(model, attribute, value)
    with pytest.raises(InputError, match=sentence):
        check_declarations(model, "line")


def fail(run: Any, parameters: Any, effects: Any) -> Any:
    raise KeyError("line.slope")


def fail_beside_an_effect(run: Any, parameters: Any, effects: Any) -> Any:
    return {"y": run["x"] if not effects.get("bent.size") else run["no such"]}


def change_when_off(run: Any, parameters: Any, effects: Any) -> Any:
    return {"y": run["x"] + (1e-9 if "bent.size" in effects else 0.0)}


def return_noise(run: Any, parameters: Any, effects: Any) -> Any:
    return {"y": np.random.default_rng().standard_normal(len(run["x"]))}


@pytest.mark.parametrize(
    ("simulate", "sentence"),
    [
        (fail, "rig line: simulate raises KeyError: 'line.slope', without effects"),
        (fail_beside_an_effect, "simulate raises KeyError: 'no such', with bent at its typical values"),
        (lambda run: run, "simulate raises TypeError: .* without effects"),
        (lambda *_: None, "simulate returns the type NoneType; a dictionary of columns is needed"),
        (lambda *_: np.zeros(1000), "simulate returns the type ndarray"),
        (lambda *_: {"z": np.zeros(1000)}, "simulate does not return y, which is one of the outputs; it returns z"),
        (lambda *_: {"y": np.zeros(999)}, r"y of the shape \(999,\) and the type float64; 1000 numbers are needed"),
        (lambda *_: {"y": 1.0}, r"y of the shape \(\)"),
        (lambda *_: {"y": np.zeros(1000, complex)}, "the type complex128"),
        (lambda *_: {"y": np.append(np.zeros(999), np.nan)}, "simulate returns nan in row 999 of y, without effects"),
        (return_noise, "other values of y when it is called again; it must be deterministic"),
        (change_when_off, "candidate bent changes y although each of its strengths is off"),
    ],
)
def test_what_is_simulated_wrongly_is_told(simulate: Callable[..., Any], sentence: str) -> None:
    model = Line()
    model.simulate = simulate  # type: ignore[method-assign]
    with pytest.raises(InputError, match=sentence):
        check_simulation(model, "line", RUN)


MODEL = """
from tests.clutch_hil.discrepancy.test_model_check import Line

class Mine(Line):
    def simulate(self, run, parameters, effects):
        {body}
"""


def search(folder: Path, body: str) -> ch.Discrepancy:
    (folder / "mine.py").write_text(MODEL.format(body=body), encoding="utf-8")
    x = np.sin(RUN["time_s"])
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(x))
    run = ch.Run({"time_s": RUN["time_s"], "x": x, "y": x + 0.5 * x**2 + noise}, {})
    return ch.find_discrepancy([run], rig=f"{folder / 'mine.py'}:Mine")


def test_a_search_with_a_wrong_model_ends_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"mine\.py:Mine: simulate returns the type NoneType"):
        search(tmp_path, "pass")


def test_a_model_that_fails_at_extreme_values_alone_is_searched(tmp_path: Path) -> None:
    body = (
        "import math; math.sqrt(0.6 - effects.get('bent.size', 0.0)); return super().simulate(run, parameters, effects)"
    )
    assert search(tmp_path, body).result.effects == ["bent"]
