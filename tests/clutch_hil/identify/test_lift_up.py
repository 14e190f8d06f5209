"""Lift-up from butterflies: the model of appendix E and the film of the virtual tribometer are identified back."""

import numpy as np
import pytest

from clutch_hil.identify.friction.lift_up import IdentifiedLiftUp, LiftRecord, _measure_stroke_time, identify_lift_up
from clutch_hil.thesis.appendices.appendix_e import LOAD, MODEL, RADIUS
from plant_sim.friction.lift_up import LiftUp
from plant_sim.rigs.tribometer import load_nominal, mean_radius
from plant_sim.rigs.tribometer_contacts import Contacts, load_contacts
from plant_sim.rigs.tribometer_experiments import BANDWIDTH, play_reciprocation
from protocols.errors import InputError

DT = 1e-5  # s, of the truth: a seventh of the steps that the identification takes
EVERY = 20  # of its samples, one is recorded
NOISE = 1e-8  # m, of the gap
TRUE = MODEL.normal
CONTACT = LiftUp(0.0, 1.0, 1.0, TRUE.mass, TRUE.stiffness, TRUE.power, TRUE.damping)  # what is known
STROKES = ((3.0, 0.03), (9.0, 0.06), (9.0, 0.02))  # Hz, rad


def make_butterfly(frequency: float, angle: float, seed: int) -> LiftRecord:
    """Four strokes to and fro of appendix E's model, its lift with noise and an unknown zero."""
    time = np.arange(0.0, 4.0 / frequency, DT)
    position = angle * RADIUS * np.sin(2.0 * np.pi * frequency * time)
    lift = MODEL.lift(MODEL.trace(position, DT, LOAD).state)[::EVERY]
    noise = np.random.default_rng(seed).normal(0.0, NOISE, lift.size)
    return LiftRecord(position[::EVERY], lift + noise + 2e-7, EVERY * DT, LOAD)


@pytest.fixture(scope="module")
def identified() -> IdentifiedLiftUp:
    return identify_lift_up(
        [make_butterfly(*stroke, seed) for seed, stroke in enumerate(STROKES)], CONTACT, MODEL.tangential
    )


def test_appendix_e_is_identified_back_within_its_intervals(identified):
    for name, value in identified.values.items():
        true = getattr(TRUE, name)
        low, high = identified.intervals[name]
        assert low <= true <= high
        assert value == pytest.approx(true, rel=0.01)
    assert identified.error == pytest.approx(NOISE, rel=0.05)  # nothing but the noise is left
    assert not identified.warnings


def test_force_is_the_steady_curve_and_lags(identified):
    speeds = np.array([-0.3, 0.01, 0.1, 0.3])
    assert identified.force(speeds) == pytest.approx(MODEL.steady_lift_force(speeds), rel=0.01)
    assert (
        identified.force(0.1, 2.0) < identified.force(0.1) < identified.force(0.1, -2.0)
    )  # thinner accelerating (fig E.7)
    assert identified.force(-0.1, -2.0) == pytest.approx(identified.force(0.1, 2.0))
    # along a slow ramp of the speed, against the model itself
    acceleration = 0.5
    time = np.arange(0.0, 0.4, DT)
    state = MODEL.trace(0.5 * acceleration * time**2, DT, LOAD).state
    assert identified.force(acceleration * 0.3, acceleration) == pytest.approx(
        float(MODEL.lift_force(state[round(0.3 / DT)])), rel=0.01
    )


def test_the_result_is_a_law_of_the_simulator(identified):
    assert identified.model.highest == pytest.approx(TRUE.highest, rel=0.01)
    assert identified.model.mass == TRUE.mass


def test_film_of_the_tribometer_is_identified_through_its_sensors():
    """Height, speed and rate that `parameters/tribometer_contacts.toml` puts into the rig, through noise and runout."""
    radius, film, load = mean_radius(load_nominal()), load_contacts().list_si("film"), 120.0
    rig = Contacts(seed=3).make_lubricated_rig(load)
    records = []
    for frequency, angle in ((4.5, 0.06), (9.0, 0.06), (9.0, 0.03)):
        m = play_reciprocation(rig, load, angle, frequency, 8)
        records.append(LiftRecord(m.angle * radius, m.gap, m.time[1] - m.time[0], load, radius, BANDWIDTH))
    lift_up = identify_lift_up(records, CONTACT, kind="height")
    assert lift_up.values["height"] == pytest.approx(film["height"], rel=0.02)
    assert lift_up.values["speed_scale"] == pytest.approx(film["speed"] * radius, rel=0.02)
    assert lift_up.values["rate"] == pytest.approx(film["rate"], rel=0.02)
    with pytest.raises(InputError, match="not a model of appendix E"):
        _ = lift_up.model


def test_one_speed_alone_is_warned_of():
    lift_up = identify_lift_up([make_butterfly(9.0, 0.06, 0)], CONTACT, kind="height")
    assert any("record some at half and at double this speed" in line for line in lift_up.warnings)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"lift": np.zeros(1000)}, "the lift of the butterflies stays at 0 m"),
        ({"position": np.ones(1000)}, "the position of the butterflies stays at 1 m"),
        ({"lift": np.full(1000, np.nan)}, "lift holds nan"),
        ({"load": 0.0}, "load of the butterflies is 0 N"),
        ({"period": -1.0}, "period of the butterflies is -1 s"),
        ({"position": np.arange(10.0)}, "10 samples; 200 or more are needed"),
    ],
)
def test_wrong_butterflies_are_refused(change, sentence):
    good = {"position": np.sin(np.arange(1000)), "lift": np.cos(np.arange(1000)), "period": 1e-3, "load": 10.0}
    with pytest.raises(InputError, match=sentence):
        LiftRecord(**good | change)


def test_a_motion_in_one_direction_makes_no_butterfly():
    ramp = np.linspace(0.0, 1.0, 1000)
    with pytest.raises(InputError, match="3 or more are needed: butterflies reciprocate"):
        identify_lift_up([LiftRecord(ramp, ramp**2, 1e-3, 10.0)], CONTACT)


def test_a_sample_in_the_very_middle_of_a_stroke_is_no_second_pass() -> None:
    """Times of strokes are the scale from which the search for the lag starts."""
    rows = np.abs((np.arange(1000) + 25) % 200 - 100) - 50  # strokes of 100 rows through 0
    record = LiftRecord(1e-5 * rows, 1e-6 * np.cos(rows), 1e-3, 100.0)
    assert _measure_stroke_time(record) == pytest.approx(0.1, rel=0.15)  # s; ends of the record are parts of strokes
