"""Starting values: the contact pressure that a first run shows, and hydraulics that are found where it is off."""

import numpy as np
import pytest

from benchmarks.identification import Hidden, draw, list_true_values, record_course
from benchmarks.power_shift import TrueShift, play
from clutch_hil.discrepancy.experiments.identification_design import SURVEY
from clutch_hil.identify.clutch_effects import correct_offsets, estimate_effects, estimate_line
from clutch_hil.identify.courses.clutch_courses import SCALE, TORQUE_SHARE, Span
from clutch_hil.identify.courses.course_pieces import compose
from clutch_hil.identify.identification import identify_clutch
from clutch_hil.identify.recorded_runs.run_evidence import read_evidence
from clutch_hil.identify.starting_values import _describe_ends
from clutch_hil.identify.stepwise import estimate_contact, estimate_friction, estimate_valve_gain, take_samples
from clutch_hil.identify.two_clutches.power_shift import NEEDED, _split, select_clutch_parameters
from plant_sim.rigs import power_shift, wet_clutch
from protocols.errors import InputError
from protocols.files.run import Run

BELIEVED = wet_clutch.load_nominal()["piston.contact_pressure"].value  # bar
# Pieces of which a design once put an experiment together, on the rig below. With them the first contact pressure is 4 % off
SHORT = (
    "crawl at 0.35 bar", "crawl at 1.85 bar", "slip sine at 1.5 bar", "triangle at 22 rad/s", "refill", "refill", "refill",
)  # fmt: skip


def play_scale(rig: np.ndarray, seed: int, torque_zero: float = 0.0) -> Run:
    rows = np.array(SCALE[0](Span(BELIEVED)).rows)
    return record_course(rig, rows, SCALE[1], BELIEVED, [seed, 0, 77], Hidden(torque=torque_zero))


@pytest.mark.parametrize("zero", [-0.95, 0.95])
def test_the_zero_of_the_torque_sensor_moves_no_contact(zero: float) -> None:
    """An open clutch that shows 1 Nm carries none."""
    rig = draw(11)  # the second clutch of a rig on which it did
    line = estimate_line([play_scale(rig, 11, zero).columns])
    sound = estimate_line([play_scale(rig, 11).columns])
    assert line is not None
    assert sound is not None
    assert line == pytest.approx(sound, rel=1e-3)  # 2e-5 were measured: the zero is a mean of noise


def test_short_runs_whose_line_is_off_lead_to_the_rig() -> None:
    rig = draw(5)
    scale = play_scale(rig, 5)
    line, gain = estimate_line([scale.columns]), estimate_valve_gain(take_samples([scale.columns]))
    assert line is not None
    assert gain is not None
    span = Span.of_line(*line, TORQUE_SHARE * float(rig["motor_torque_limit"][0]))
    runs = [
        record_course(rig, np.array(compose(pieces, span)[0].rows), 70.0, span.contact, [5, number, 77], Hidden(), gain)
        for number, pieces in enumerate((SURVEY, SHORT), 1)
    ]
    result = identify_clutch([scale, *runs])
    assert max(result.misfit.values()) < 1.2  # as a goal allows (goals.py)
    true = list_true_values(rig)["piston.contact_pressure"]
    assert result.propagation.values["piston.contact_pressure"] == pytest.approx(true, abs=0.01)  # bar, the goal


def test_a_curve_without_stribeck_is_no_start() -> None:
    """On clutch a of this rig it fitted the stationary torques best, and the fit that began there never found beta and V_S."""
    rig = TrueShift.draw(34, hidden=True)
    runs = read_evidence(play(rig, 34), "power_shift", NEEDED)
    own = _split(runs, "a").measured.values()
    samples = take_samples(correct_offsets(list(own), estimate_effects(list(own))[0]))
    line = estimate_contact(samples)
    assert line is not None
    result = estimate_friction(samples, line, select_clutch_parameters(power_shift.load_nominal(), "a"))
    for name in ("clutch.stribeck_speed", "clutch.beta_inf"):
        assert result[name] == pytest.approx(rig.values[f"a.{name}"], rel=0.2)


def test_a_torque_at_its_end_is_told_where_no_line_is_found() -> None:
    scale = play_scale(draw(5), 5).columns
    stuck = {**scale, "clutch_torque_nm": np.clip(scale["clutch_torque_nm"], None, 0.5)}
    with pytest.raises(
        InputError, match=r"show no torque that rises .* clutch_torque_nm is 0.5 at most, in \d+ rows: was it"
    ):
        identify_clutch([Run(stuck, {"rig": "wet_clutch"}, {})], force=True)  # the checks say it otherwise
    cut = {**scale, "clutch_torque_nm": 0.0 * scale["clutch_torque_nm"]}
    cut["clutch_torque_nm"] += 0.05 * np.random.default_rng(1).standard_normal(len(cut["time_s"]))
    with pytest.raises(InputError, match=r"at a slip above 1 rad/s, is needed$"):
        identify_clutch([Run(cut, {"rig": "wet_clutch"}, {})])


def test_a_channel_that_was_not_connected_is_told_where_no_line_is_found() -> None:
    sound = {
        "valve_voltage_v": np.arange(999.0),
        "cylinder_pressure_bar": np.arange(999.0),
        "clutch_torque_nm": np.zeros(9),
    }
    assert _describe_ends([sound]) == (
        "; clutch_torque_nm is 0 throughout: was this channel connected? if not, leave it out of the import map: the motor's"
        " torque takes its place, if its speed demand was recorded"
    )
    dead = {**sound, "valve_voltage_v": np.ones(999), "clutch_torque_nm": np.arange(999.0)}
    assert "valve_voltage_v is 1 throughout" in _describe_ends([dead])
