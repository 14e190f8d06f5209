"""Stick stiffness: that of plates that bend before they slide, of rigid ones a least value, and what the runs lack."""

import pytest

import clutch_hil as ch
from clutch_hil.fitting.model import Columns
from clutch_hil.identify.stick_stiffness import measure_stick
from plant_sim.rigs import wet_clutch

NOMINAL = {name: p.value for name, p in wet_clutch.load_nominal().items()}
LIMIT = 10.8 * 3.4 - 25.1  # Nm, M_C of the thesis at the middle pressure
ENCODER = 1e5  # Nm/rad: half of 11.6 Nm over one count of the encoder, 3.8e-5 rad, is 1.5e5


def play(**effects: dict[str, float]) -> Columns:
    return dict(ch.simulate(profile="reversals", effects=effects).columns)


@pytest.mark.parametrize("angle", [2e-3, 5e-3])
def test_the_stiffness_of_plates_that_bend_is_within_its_interval(angle: float) -> None:
    stick = measure_stick([play(presliding={"angle": angle, "spread": 1.0})], NOMINAL)
    assert stick.quantity is not None
    assert not stick.warning
    assert abs(stick.quantity.value - LIMIT / angle) <= stick.quantity.half < 0.1 * stick.quantity.value


def test_of_plates_that_stick_rigidly_the_least_value_is_told() -> None:
    stick = measure_stick([play()], NOMINAL)
    assert stick.quantity is None
    assert "the stick stiffness is above" in stick.warning
    assert float(stick.warning.partition("above ")[2].partition(" ")[0]) > ENCODER


def test_runs_in_which_no_plates_rest_are_told_what_they_need() -> None:
    run = dict(ch.simulate(profile="slip_sine", seconds=4.0).columns)
    stick = measure_stick([run], NOMINAL)
    assert stick.quantity is None
    assert "these runs have 0 such stretches, 3 are needed: play the experiment reversals" in stick.warning
