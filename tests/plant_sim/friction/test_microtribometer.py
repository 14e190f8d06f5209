"""Friction models on a measured contact; skipped where the data are not on the machine."""

import numpy as np
import pytest

from clutch_hil.thesis.control_models import microtribometer as entry
from clutch_hil.thesis.measured_data import VARIABLE, MissingDataError, find_measured_file
from plant_sim.friction.load_law import Amontons
from plant_sim.friction.xgms import XGMS
from protocols.errors import InputError
from tests import needs


@pytest.fixture(scope="module")
def record() -> entry.Record:
    """The measured record."""
    try:
        return entry.read_record()
    except MissingDataError:
        needs.skip("data")


@pytest.fixture(scope="module")
def scores(record: entry.Record) -> dict[str, entry.Score]:
    """The models that are quick to fit."""
    quick = ("Coulomb", "Dahl", "Maxwell-slip, 2 elements")
    return entry.compare_candidates(record, tuple(c for c in entry.make_candidates() if c.name in quick))


def test_units_are_those_of_the_stated_load(record):
    """5 N are recorded as 5e6 uN, friction is about half of it, and it acts along the motion as we count it."""
    cycles = record.parts[0]
    assert np.median(record.load[cycles]) == pytest.approx(5.0, abs=0.01)
    assert 0.3 < np.median(np.abs(record.force[cycles]) / record.load[cycles]) < 0.6
    assert np.sum(record.force[cycles][1:] * np.diff(record.position[cycles])) > 0.0  # the loop takes energy


def test_maxwell_slip_predicts_cycles_it_has_not_seen(scores):
    """At most 0.12 N; Dahl's model just reaches that, Coulomb friction is ten times worse."""
    held_out = {name: score.held_out for name, score in scores.items()}
    assert held_out["Maxwell-slip, 2 elements"] <= entry.REQUIRED_ERROR
    assert held_out["Maxwell-slip, 2 elements"] < held_out["Dahl"] <= entry.REQUIRED_ERROR
    assert held_out["Coulomb"] > 8.0 * held_out["Maxwell-slip, 2 elements"]


def test_load_dependence_predicts_the_unloading(record, scores):
    """The fitted elements under the measured load follow it to 0.1 N; without load the force stays where it was."""
    values = scores["Maxwell-slip, 2 elements"].values
    limits = np.array([values["W_0"], values["W_1"]])
    model = XGMS(Amontons(limits.sum() / entry.LOAD), [values["k_0"], values["k_1"]], limits / limits.sum())
    force = model.trace(record.position, entry.STEP, record.load).force + values["offset"]
    errors = [np.sqrt(np.mean((force - record.force)[part] ** 2)) for part in record.parts]
    assert errors[1] <= entry.REQUIRED_ERROR
    assert errors[2] < 0.1
    assert scores["Maxwell-slip, 2 elements"].unloading > 1.0


def test_missing_data_say_where_they_are_looked_for(monkeypatch, tmp_path):
    """One sentence with the file, the folder and the variable."""
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    with pytest.raises(MissingDataError, match=f"{entry.FILE} are not in {tmp_path}; set {VARIABLE}"):
        find_measured_file(entry.FILE)


def test_the_last_digit_of_a_dwell_makes_no_motion():
    """Flicker of one digit is held, a stroke passes through but for the digit."""
    digit = entry.RESOLUTION
    dwell = digit * np.array([0, 1, 0, 1, 1, 0], float)
    assert np.ptp(entry.remove_flicker(dwell)) == 0.0
    stroke = np.linspace(0.0, 100.0 * digit, 50)
    assert np.abs(entry.remove_flicker(stroke) - stroke).max() == pytest.approx(digit)


@pytest.mark.parametrize(
    "rows", ["0 1 2 3\n", "0 1 2\n1 1 2\n", "0 1 2 nan\n1 1 2 3\n", "nan 1 2 3\n1 1 2 3\n", "0 a 2 3\n"]
)
def test_a_record_that_is_none_is_one_sentence(monkeypatch, tmp_path, rows):
    """A table without rows, with one, with other columns or with what is no number."""
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    path = tmp_path / entry.FILE
    path.parent.mkdir()
    path.write_text(f"time load position force\n{rows}", encoding="utf-8")
    with pytest.raises(InputError, match=r"are not a table of four columns of numbers|end at 0 s"):
        entry.read_record()
