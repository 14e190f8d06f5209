"""What the metadata of a run say of columns that nobody measured."""

from typing import Any

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.recordings.not_measured import find_source, read_not_measured
from protocols.errors import InputError
from protocols.files.run import Run


@pytest.mark.parametrize(
    "metadata",
    [
        {},
        {"import": None},
        {"import": "x"},
        {"import": {}},
        {"import": {"not_measured": [1]}},
        {"import": {"not_measured": 3}},
    ],
)
def test_a_run_that_does_not_say_it_has_none(metadata: dict[str, Any]) -> None:
    assert read_not_measured(Run({}, metadata)) == {}


def test_constants_and_formulas_are_told() -> None:
    given = {"oil_temperature_degc": 60.0, "slip_speed_rad_s": "a_1 - b_1", "odd_1": [1.0]}
    assert read_not_measured(Run({}, {"import": {"not_measured": given}})) == {
        "oil_temperature_degc": 60.0, "slip_speed_rad_s": "a_1 - b_1",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("formula", "source"),
    [("2 * slip_speed_rad_s", "slip_speed_rad_s"), ("low_pass(slip_speed_rad_s,50)", "slip_speed_rad_s"), (60.0, ""),
     ("2 * old_slip_speed_rad_s", ""), ("slip", "")],
)  # fmt: skip
def test_the_source_of_a_formula_is_a_whole_name(formula: float | str, source: str) -> None:
    assert find_source({"demand_rad_s": formula}, "demand_rad_s", {"slip_speed_rad_s"}) == source
    assert find_source({}, "demand_rad_s", {"slip_speed_rad_s"}) == ""


def test_a_model_is_not_compared_with_what_was_computed_from_its_outputs() -> None:
    """A pressure from the torque: no model of the rig does without it."""
    run = ch.simulate(profile="engagement", seconds=1.0, seed=1)
    computed = Run(run.columns, {"import": {"not_measured": {"cylinder_pressure_bar": "clutch_torque_nm / 8"}}})
    with pytest.raises(
        InputError,
        match=r"cylinder_pressure_bar is .* by its import map, so it is not measured independently of clutch_torque_nm",
    ):
        ch.find_discrepancy([computed])


def test_a_column_computed_from_raw_ones_is_compared() -> None:
    """The slip of two shafts is a measurement: the run is refused for its length alone, which comes later."""
    run = ch.simulate(profile="engagement", seconds=1.0, seed=1)
    short = {name: np.asarray(values)[:2] for name, values in run.columns.items()}
    computed = Run(short, {"import": {"not_measured": {"slip_speed_rad_s": "input_rad_s - output_rad_s"}}})
    with pytest.raises(InputError) as refused:
        ch.find_discrepancy([computed])
    assert "not measured independently" not in str(refused.value)
