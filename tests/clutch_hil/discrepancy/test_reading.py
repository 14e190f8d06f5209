"""Readings: a baseline whose equations can be read in two ways is re-fitted in the one that the runs show."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.discrepancy.model_file import read_model, write_model
from clutch_hil.discrepancy.result import NAMED, NOTHING
from clutch_hil.discrepancy.search import investigate
from clutch_hil.fitting.model import Columns, Values
from protocols.files.parameters import Parameter, ParameterSet
from tests.clutch_hil.fitting.test_fit import NOISE, PARAMETERS, SOURCE, TRUE_GAIN, Amplifier

RECTIFIED = "a negative voltage is given as a positive one"


class Ambiguous(Amplifier):
    """An amplifier of which its data sheet does not say what it makes of a negative voltage."""

    parameters = ParameterSet({**PARAMETERS, "sign.lost": Parameter("sign.lost", 0.0, "1", 0.0, (0.0, 1.0), SOURCE)})
    readings: Mapping[str, Values] = {
        "a negative voltage is given as such": {"sign.lost": 0.0},
        RECTIFIED: {"sign.lost": 1.0},
    }

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
        u = run["input_v"]
        given = np.abs(u) if parameters["sign.lost"] else u
        return super().simulate({**run, "input_v": given}, parameters, effects)


def record_run(lost: float, effects: Values, offset: float = 0.0) -> dict[str, Columns]:
    """Three runs, the input about `offset` [V]."""
    result: dict[str, Columns] = {}
    for seed in range(1, 4):
        random, time = np.random.default_rng(seed), 1e-3 * np.arange(4000)
        run = {"time_s": time, "input_v": offset + np.sin(2.0 * time + seed) + 0.3 * np.sin(7.3 * time)}
        y = Ambiguous().simulate(run, {"gain.value": TRUE_GAIN, "sign.lost": lost}, effects)["output_v"]
        result[f"run-{seed}"] = run | {"output_v": y + NOISE * random.standard_normal(len(time))}
    return result


def declare_all() -> ParameterSet:
    """All parameters, effects off."""
    off = {name: p for candidate in Ambiguous.candidates for name, p in candidate.declare_parameters().items()}
    return ParameterSet({**Ambiguous.parameters, **off})


@pytest.mark.parametrize("lost", [0.0, 1.0])
@pytest.mark.parametrize(
    ("effects", "verdict", "named"), [({}, NOTHING, []), ({"offset.volts": 0.3}, NAMED, ["offset"])]
)
def test_neither_reading_is_taken_for_an_effect(
    lost: float, effects: dict[str, float], verdict: str, named: list[str], tmp_path: Path
) -> None:
    result = investigate(Ambiguous(), record_run(lost, effects))
    assert (result.verdict, result.effects) == (verdict, named)
    assert (f"the baseline alone fits these runs better where {RECTIFIED}" in result.notes) == bool(lost)
    write_model(result, declare_all(), tmp_path / "model.toml")
    assert read_model(tmp_path / "model.toml", declare_all())["sign.lost"].value == lost


def test_a_model_of_one_reading_takes_the_other_for_something_missing() -> None:
    assert investigate(Amplifier(), record_run(1.0, {})).verdict != NOTHING


def test_where_the_runs_do_not_tell_it_is_the_first() -> None:
    result = investigate(Ambiguous(), record_run(1.0, {}, offset=3.0))
    assert (result.verdict, result.notes) == (NOTHING, [])
