"""Regimes are what they are called: phases share a run out, directions follow the pressure, noise makes no directions."""

import numpy as np
import pytest

from clutch_hil.discrepancy.models.position_axis import PositionAxis
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.regimes import ALL, Regimes, find_family
from tests.clutch_hil.discrepancy.clutch_runs import NOISE, PERIOD, list_baseline, record_runs

MOSTLY = 0.95  # share of samples: edges of a regime lie within the smoothing of 10 ms
CONFUSED = 0.02  # share of a constant pressure's samples that 5 % noise may give a direction; measured 0.004


@pytest.fixture(scope="module")
def runs():
    """Runs of the rig as it should be."""
    return record_runs({})


@pytest.fixture(scope="module")
def regimes(runs):
    """Their regimes."""
    return Regimes(WetClutch(), runs, list_baseline())


def test_phases_share_out_every_sample(runs, regimes):
    for run in runs:
        count = np.sum([mask for name, mask in regimes(run).items() if find_family(name) == "phase"], axis=0)
        assert np.all(count == 1)


def test_a_clutch_fills_engages_slips_releases_and_is_open_in_this_order(runs, regimes):
    masks = regimes(runs[0])
    begun = 2.6  # s: demanded
    first = {
        n: np.flatnonzero(masks[f"phase={n}"][round(begun / PERIOD) :])[0]
        for n in ("fill", "engage", "slip", "release", "open")
    }
    assert first["fill"] < first["engage"] < first["slip"] < first["release"] < first["open"]


def test_fill_takes_as_long_as_the_rig_needs_to_touch(runs, regimes):
    """docs/rig.md, pressure regulator: about 85 ms; without the regulator the valve alone is slower."""
    masks = regimes(runs[0])
    fill = np.sum(masks["phase=fill"]) * PERIOD / 4.0  # four engagements
    assert 0.05 < fill < 0.15


def test_pressure_that_rises_is_applied_and_pressure_that_falls_released(runs, regimes):
    masks, demand = regimes(runs[1]), runs[1]["valve_voltage_v"]
    later = round(0.06 / PERIOD)  # s that the pressure comes behind a ramp of its demand
    rises = np.roll(np.gradient(demand) > 0.0, later)
    steady = slice(round(1.0 / PERIOD), None)
    assert np.mean(rises[steady][masks["direction=apply"][steady]]) > MOSTLY
    assert np.mean(~rises[steady][masks["direction=release"][steady]]) > MOSTLY


def test_noise_gives_a_constant_pressure_no_direction(runs):
    t = runs[0]["time_s"]
    loud = dict(NOISE, cylinder_pressure_bar=0.17)
    still = [dict(run, valve_voltage_v=np.full_like(t, 3.4 / 2.5)) for run in record_runs({}, noise=loud)]
    still[0]["cylinder_pressure_bar"] = 3.4 + 0.17 * np.random.default_rng(4).standard_normal(len(t))
    masks = Regimes(WetClutch(), still, list_baseline())(still[0])
    assert np.mean(masks["direction=apply"] | masks["direction=release"]) < CONFUSED


def test_thirds_of_the_runs_hold_a_third_each(runs, regimes):
    masks = [regimes(run) for run in runs]
    shares = [np.mean(np.concatenate([m[f"temperature={word}"] for m in masks])) for word in ("cold", "warm", "hot")]
    assert shares == pytest.approx([1 / 3] * 3, abs=0.01)


def test_an_axis_goes_forward_backward_and_reverses():
    t = np.arange(0.0, 4.0, PERIOD)
    run = {"time_s": t, "position_m": 0.1 * np.sin(2.0 * np.pi * 0.5 * t), "motor_force_n": np.zeros_like(t)}
    masks = Regimes(PositionAxis(), [run], {})(run)
    assert masks[ALL].all()
    forward = np.cos(2.0 * np.pi * 0.5 * t) > 0.0
    assert np.all(forward[masks["direction=forward"]])
    assert not np.any(forward[masks["direction=backward"]])
    assert np.all(np.abs(np.cos(2.0 * np.pi * 0.5 * t[masks["reversal"]])) < 0.5)


def test_inputs_keep_apart_whatever_their_names_end_in():
    """A last word is a unit only if it is one, and a unit is left out only where two inputs then have different names."""
    inputs = ("speed_in", "speed_out", "demand_v", "demand_a", "motor_speed_rad_s")
    time = np.arange(4000) / 1000.0
    run = {name: np.sin((k + 1.0) * time) for k, name in enumerate(inputs)} | {"time_s": time}
    model = PositionAxis()
    model.inputs = inputs
    masks = Regimes(model, [run], {})(run)
    rising = {name.removesuffix("=rising") for name in masks if name.endswith("=rising")}
    assert rising == {"speed_in", "speed_out", "demand_v", "demand_a", "motor_speed"}
