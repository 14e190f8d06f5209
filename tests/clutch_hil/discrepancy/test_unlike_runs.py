"""Unlike runs: an effect in a few runs alone, fitted or held out, is not reported as nothing or as an effect of all runs."""

import numpy as np
import pytest

from clutch_hil.discrepancy.decision import DISAGREEMENT
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.result import NONE_OF_THESE, NOTHING
from clutch_hil.discrepancy.search import investigate
from clutch_hil.discrepancy.unlike_runs import describe_held_out, note_unlike
from tests.clutch_hil.discrepancy.clutch_runs import list_baseline, record_runs

CANDIDATES = ["backlash"]


@pytest.mark.parametrize("offset", [0.0, 0.5])
def test_a_held_out_run_that_disagrees_is_not_nothing(offset: float) -> None:
    runs, zero = record_runs({}), {"torque_sensor_offset.offset": offset}
    found = investigate(WetClutch(), {"a": runs[0]}, {"b": runs[1], "c": record_runs(zero)[2]}, CANDIDATES)
    assert found.verdict == (NONE_OF_THESE if offset else NOTHING)
    if offset:
        assert found.surrogate is not None
        assert found.surrogate["sentence"].startswith(
            "run c, not fitted, cannot be predicted: clutch_torque_nm is off by 0.5"
        )
        assert {(claim.block, claim.output) for claim in found.where} == {("sensors", "clutch_torque_nm")}
        assert found.confidence < 0.9


def test_a_held_out_run_at_the_floor_is_no_matter_of_words() -> None:
    run = record_runs({})[0]
    floors = {output.column: 0.1 for output in WetClutch.outputs}
    assert (
        describe_held_out(WetClutch(), {"a": run}, np.array([0.9 * DISAGREEMENT]), (list_baseline(), {}), floors) == ""
    )


@pytest.mark.parametrize(
    ("powers", "told"),
    [
        ([70.0, 3.8, 4.5, 4.0], "85% of what disagrees in 4 runs is in run a:"),
        ([9.0, 0.1, 8.0, 0.0], "99% of what disagrees in 4 runs is in runs a, c:"),
        ([57.0, 61.0, 108.0, 52.0], ""),
        ([0.0, 0.0, 0.0, 0.0], ""),
    ],
)
def test_runs_that_hold_most_of_a_disagreement_are_noted(powers: list[float], told: str) -> None:
    notes = note_unlike(["a", "b", "c", "d"], np.array(powers))
    assert [note[: len(told)] for note in notes] == ([told] if told else [])
