"""The atlas says where they disagree, and says nothing where they do not."""

import json

import numpy as np
import pytest
from scipy.signal import lfilter

from clutch_hil.discrepancy.atlas import PooledSource, compute_p_values, find_claims, find_concentration, locate_effect
from clutch_hil.discrepancy.models.position_axis import PositionAxis
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.residual_statistics import compute_statistics
from clutch_hil.discrepancy.sources import LATER, Source
from tests.clutch_hil.discrepancy.clutch_runs import NOISE, list_baseline, record_runs

CASES = 100  # of noise alone
UNIFORM = 0.12  # what a share of them may miss its level by: 2.4 standard errors of a share of one half
SIZE = 0.15  # relative: sizes of claims against what was put in; measured 4 %


@pytest.fixture(scope="module")
def model():
    """The baseline."""
    return WetClutch()


def find(model, hidden, seed=1, noise=NOISE):
    """Claims of runs with `hidden` effects, at the parameters they were made with."""
    return find_claims(model, record_runs(hidden, seed, noise), noise, list_baseline(), {})


@pytest.mark.parametrize("times", [1.0, 10.0])
def test_noise_alone_is_no_disagreement(model, times):
    assert find(model, {}, noise={column: times * sigma for column, sigma in NOISE.items()}) == []


@pytest.mark.parametrize(
    ("hidden", "block", "output"),
    [
        (
            {"piston_seal_friction.force": 60.0, "piston_seal_friction.pressure_slope": 8.0},
            "friction",
            "clutch_torque_nm",
        ),
        ({"stribeck_change.depth": 1.4}, "friction", "clutch_torque_nm"),
        ({"valve_hysteresis.width": 0.1}, "hydraulics", None),
        ({"pressure_sensor_gain.gain": 1.03}, "sensors", "cylinder_pressure_bar"),
        ({"torque_sensor_offset.offset": 0.5}, "sensors", "clutch_torque_nm"),
        ({"motor_torque_ripple.amplitude": 0.05}, "drive", "motor_torque_nm"),
    ],
)
def test_the_block_that_is_at_fault_is_claimed_first(model, hidden, block, output):
    first = find(model, hidden)[0]
    assert first.block == block
    assert output in (None, first.output)
    assert first.p_value <= 0.01


def test_an_offset_is_claimed_everywhere_and_with_its_size(model):
    [claim] = find(model, {"torque_sensor_offset.offset": 0.5})
    assert claim.regime == "all"
    assert claim.size == pytest.approx(0.5, rel=SIZE)
    assert claim.times_floor == pytest.approx(0.5 / NOISE["clutch_torque_nm"], rel=SIZE)


def record_engagements(hidden):
    """Four runs of engagements."""
    return [record_runs(hidden, seed)[0] for seed in range(4)]


def test_air_in_the_line_is_claimed_while_the_clutch_fills(model):
    ours = find_claims(model, record_engagements({"entrapped_air.volume": 4e-6}), NOISE, list_baseline(), {})
    assert ours
    assert {c.regime for c in ours} <= {"phase=fill", "phase=engage", "phase=release"}


def test_an_effect_acts_where_it_makes_a_difference(model):
    known = {c.name: c for c in model.candidates}
    hidden = {"entrapped_air.volume": 4e-6}
    places = locate_effect(model, record_engagements(hidden), NOISE, list_baseline(), hidden, known["entrapped_air"])
    assert {c.block for c in places} == {"hydraulics"}
    assert {c.regime for c in places} <= {"phase=fill", "phase=engage", "phase=release"}
    assert all(c.p_value <= 0.05 for c in places)


@pytest.mark.parametrize("memory", [0.0, 0.7])
def test_p_values_are_uniform_under_coloured_noise(memory):
    """`memory`: of one mean of 4 ms in the next; 0.7 is a noise of 11 ms."""
    random = np.random.default_rng(3)
    n = 3000
    block = np.arange(n) // 62
    smallest = []
    for _ in range(CASES):
        x = lfilter([1.0], [1.0, -memory], random.standard_normal((3, n)), axis=1)
        masks = {"all": np.ones(n, bool), "a": np.arange(n) % 500 < 100, "b": np.arange(n) < 1500}
        seen = []
        for one, other in ((0, 1), (1, 2), (2, 0)):  # two channels, whose noise is independent
            tested = np.column_stack([np.roll(x[one], lag) * x[other] for lag in LATER])
            seen.append(PooledSource(Source("b", "c", [], [], []), tested[:, 0], tested, block, masks))
        smallest.append(min(compute_p_values(seen).values()))
    for level in (0.05, 0.2, 0.5):
        assert np.mean(np.array(smallest) <= level) == pytest.approx(level, abs=UNIFORM)


def test_power_is_placed_where_it_is_dense_and_nowhere_where_it_is_spread():
    even = {"all": (1.0, 1.0), "phase=fill": (0.1, 0.1), "phase=slip": (0.9, 0.9), "direction=apply": (0.5, 0.5)}
    assert find_concentration(even) == []
    dense = dict(even, **{"phase=fill": (0.8, 0.1), "phase=slip": (0.2, 0.9)})
    assert find_concentration(dense) == ["phase=fill"]


def test_the_order_of_a_ripple_and_the_correlation_of_channels_are_told(model):
    hidden = {"position_ripple.amplitude": 0.5, "position_ripple.order": 6.0}
    sentence = json.loads(json.dumps(compute_statistics(model, record_runs(hidden), NOISE, list_baseline(), {})))
    order = sentence["outputs"]["clutch_torque_nm"]["order"]
    assert order["a_turn"] == 6.0
    assert order["amplitude"] == pytest.approx(0.5, rel=SIZE)
    assert sentence["cross"]["clutch_torque_nm, motor_torque_nm"] > 0.3
    assert sentence["blocks_times_floor"]["friction: clutch_torque_nm"] > 3.0


def test_runs_may_have_very_different_lengths(model):
    long, other, cut = record_runs({"friction_level.level": 0.9})
    short = {name: values[:1200] for name, values in cut.items()}  # 1.2 s beside 8 s
    time = {
        compute_statistics(model, runs, NOISE, list_baseline(), {})["outputs"]["clutch_torque_nm"]["autocorrelation_s"]
        for runs in ([long, other, short], [short, other, long])
    }
    assert len(time) == 1
    assert 0.05 < time.pop() < 4.0


def test_another_rig_has_claims_by_its_own_inputs():
    axis = PositionAxis()
    t = np.arange(0.0, 12.0, 1e-3)
    random = np.random.default_rng(2)
    nominal = {name: p.value for name, p in axis.parameters.items()}
    runs = []
    for hertz in (0.5, 0.8):
        run = {"time_s": t, "position_m": 0.1 * np.sin(2.0 * np.pi * hertz * t)}
        shown = axis.simulate({**run, "motor_force_n": np.zeros_like(t)}, nominal, {})["motor_force_n"]
        forward = np.cos(2.0 * np.pi * hertz * t) > 0.0
        runs.append({**run, "motor_force_n": shown + random.standard_normal(len(t)) + 2.0 * forward})
    ours = find_claims(axis, runs, {"motor_force_n": 1.0}, nominal, {})
    assert [(c.block, c.output, c.regime) for c in ours] == [("friction", "motor_force_n", "direction=forward")]
    assert ours[0].size == pytest.approx(2.0, rel=SIZE)
