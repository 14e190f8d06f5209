"""The fault matrix: all cases without processes are as they must be; what is wrong is told."""

import numpy as np
import pytest

from benchmarks.fault_cases import AT, SECONDS, Borne, Either, FaultCase, PlantGone, RunEnds, Safe, list_fault_cases
from benchmarks.fault_matrix import RATE, is_disturbed, judge, play_matrix, was_stalled

ROWS = round(SECONDS * RATE)
CASES = list_fault_cases()


def test_there_are_at_least_80_cases_of_every_kind_and_each_has_a_name() -> None:
    assert len(CASES) >= 80
    assert len({case.name for case in CASES}) == len(CASES)
    assert {type(case.outcome) for case in CASES} == {Borne, Safe, Either, RunEnds, PlantGone}


@pytest.mark.parametrize("part", range(4))
def test_every_case_in_one_process_is_as_it_must_be(part: int) -> None:
    cases = [case for case in CASES if not case.live][part::4]
    wrong = [f"{one.case.name}: {one.wrong}" for one in play_matrix(cases, None) if one.wrong]
    assert not wrong, "\n".join(wrong)


def make_run(closed: int | None = None, torque: float = 10.0) -> dict[str, np.ndarray]:
    """Columns of a run of 10 Nm; the valve closes in the row `closed`, and the clutch opens 30 ms later."""
    voltage, moment, fault = np.full(ROWS, 1.3), np.full(ROWS, torque), np.zeros(ROWS)
    if closed is not None:
        voltage[closed:], moment[closed + 30 :], fault[closed:] = 0.0, 0.0, 6.0
    return {"time_s": np.arange(ROWS) / RATE, "valve_voltage_v": voltage, "truth_clutch_torque_nm": moment,
            "controller_fault": fault}  # fmt: skip


def say_wrong(outcome: Borne | Safe | Either | RunEnds | PlantGone, columns: dict[str, np.ndarray]) -> str:
    return judge(FaultCase("made up", (), outcome), columns, AT, RATE).wrong


def test_what_is_wrong_is_told() -> None:
    begin = round(AT * RATE)
    assert say_wrong(Borne(), make_run()) == ""
    assert say_wrong(Borne(), make_run(begin + 5)).startswith(
        "the valve closed; the controller has a fault; torque 10.0 Nm off"
    )
    assert say_wrong(Borne(), make_run(torque=14.0)) == "torque above 13 Nm; torque 4.0 Nm off at the end"
    assert say_wrong(Safe(), make_run(begin + 15)) == ""
    assert say_wrong(Safe(), make_run(begin + 16)) == "too late"
    assert say_wrong(Safe(), make_run()) == "the valve stays open"
    assert say_wrong(Safe(), make_run(begin + 5, torque=17.0)) == "torque above 16 Nm"
    assert say_wrong(Either(), make_run()) == say_wrong(Either(), make_run(begin + 900)) == ""
    stuck = make_run(begin + 5)
    stuck["truth_clutch_torque_nm"][-1] = 3.0
    assert say_wrong(Safe(), stuck) == "the clutch does not open"
    short = {name: column[: begin + 100] for name, column in make_run().items()}
    assert say_wrong(Borne(), short) == f"{begin + 100} rows of {ROWS} recorded"
    assert say_wrong(PlantGone(), short) == ""
    recovered = {"recovered": short["time_s"]}
    assert say_wrong(RunEnds(), make_run(begin + 900) | recovered) == ""
    assert say_wrong(RunEnds(), make_run(begin + 1100) | recovered) == "too late"
    assert say_wrong(RunEnds(), make_run() | recovered) == "the valve stays open"
    lacking = {"recovered": short["time_s"][: begin - 5]}
    assert say_wrong(RunEnds(), make_run(begin + 5) | lacking) == f"{begin - 5} rows of {begin} recorded"
    torn = {name: np.delete(column, begin - 100) for name, column in make_run().items()}
    assert say_wrong(Borne(), torn) == "rows are missing"


def test_a_run_with_a_fault_or_without_torque_before_its_fault_is_disturbed() -> None:
    begin = round(AT * RATE)
    assert not is_disturbed(make_run(), AT, RATE)
    assert not is_disturbed(make_run(begin), AT, RATE)
    assert is_disturbed(make_run(begin - 1), AT, RATE)
    assert is_disturbed(make_run(torque=0.0), AT, RATE)


def test_a_run_in_which_plant_or_controller_waited_too_long_was_stalled() -> None:
    assert not was_stalled(make_run())
    assert not was_stalled(make_run() | {"controller_wake_us": np.array([np.nan, 40.0, 4900.0])})
    assert was_stalled(make_run() | {"controller_wake_us": np.array([np.nan, 40.0, 5100.0])})
    assert was_stalled(make_run() | {"plant_wake_us": np.array([40.0, 5100.0])})


@pytest.mark.parametrize(
    "name",
    [
        "frame_loss: commands 1",
        "controller killed",
        "controller stopped for 0.2 s",
        "plant killed",
        "disk full",
        "disk slow",
        "rubbish_peer",
    ],
)
def test_a_case_of_services_is_as_it_must_be(name: str) -> None:
    (case,) = (case for case in CASES if case.name == name)
    (judged,) = play_matrix([case], "local:fault-matrix")
    assert not judged.wrong
