"""Effects of the valve: what each does to the pressure it is asked for, against closed forms."""

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.signal

from plant_sim.effects.catalogue import find_effect
from plant_sim.effects.signals import COMMAND
from plant_sim.rigs.wet_clutch import Whole
from tests.plant_sim.effects.fluid import BAR, K_V, SUPPLY, W_V, ZETA, Fluid, G, make_rig, resume, run

EXACT = 1e-12  # relative: rounding of sums
SETTLED = 1e-6  # relative: a valve of 700 rad/s, 0.1 s after a step; measured 1e-9
RESPONSE = 1e-9  # of the step: Runge-Kutta 4 against the closed form; measured 3e-13
IMPULSE = 4e-4  # relative: a sum over samples of 1 ms for an integral; measured 1.8e-4 at 0.03 ms, 6e-6 at 3 ms
SAG = 5e-5  # bar: as in test_hydraulics.py; measured 0.015 mbar, where the sag lowers the demand by 0.4 bar
SWITCHED = 1.0  # Pa: what the valve of 8 Hz lacks of its demand 0.3 s after a step; measured 0.7, and a bump of 0.5
FAST = 700.0  # rad/s, the fastest valve allowed: it shows what it is asked for

ENGAGE = [(1.36, 250), (0.8, 150), (1.5, 100)]


def apply_law(name: str, values: Any, h: float = 1e-4, **parameters: float) -> np.ndarray:
    """Demands that the law of an effect makes of `values`, in the same unit, step by step."""
    one = find_effect(name)
    p = SimpleNamespace(**{q.name: q.off for q in one.parameters} | parameters)
    x = SimpleNamespace(**{q.name: np.zeros(q.size) if q.size > 1 else 0.0 for q in one.states})
    made = []
    for value in values:
        s = SimpleNamespace(demand=float(value), time=1.0, valve_pressure=0.0)
        one.laws[COMMAND](s, SimpleNamespace(valve_gain=1.0), p, x, h)
        made.append(s.demand)
    return np.array(made)


def find_settled_pressures(voltages: list[float], **changed: float) -> np.ndarray:
    """Pressure [bar] that a fast valve settles at for each voltage in turn."""
    records = run(make_rig(valve__frequency=FAST, **changed), [(v, 100) for v in voltages])
    return records["valve_pressure"][99::100] / BAR


def make_ramp(*corners: float, step: float = 1e-3) -> np.ndarray:
    """Straight lines through `corners`, each met exactly."""
    parts = [np.linspace(a, b, round(abs(b - a) / step) + 1)[1:] for a, b in pairwise(corners)]
    return np.concatenate([[corners[0]], *parts])


# --- dead band, gain, bandwidth --------------------------------------------------------------------------------------


def test_deadband_swallows_the_first_of_the_voltage_and_no_more() -> None:
    voltages = [0.0, 0.1, 0.2, 0.5, 2.0, -1.0]
    assert find_settled_pressures(voltages, valve_deadband__width=0.2) == pytest.approx(
        [0, 0, 0, 0.75, 4.5, 0], abs=SETTLED
    )


def test_deadband_is_odd() -> None:
    values = np.linspace(-1.0, 1.0, 201)
    there = apply_law("valve_deadband", values, width=0.3)
    assert (there == -apply_law("valve_deadband", -values, width=0.3)).all()
    assert there[-1] == 0.7


def test_gain_scales_the_voltage() -> None:
    scaled, louder = run(make_rig(valve_gain__ratio=1.1), ENGAGE), run(make_rig(), [(1.1 * v, n) for v, n in ENGAGE])
    for name in ("valve_pressure", "pressure", "position"):
        assert scaled[name] == pytest.approx(louder[name], rel=1e-9, abs=1e-9)


def test_gain_drifts_from_its_ratio_and_never_changes_its_sign() -> None:
    scaled = apply_law("valve_gain", [1.0] * 4000, h=1e-3, ratio=1.1, drift=-0.5)
    assert scaled == pytest.approx(np.maximum(1.1 - 0.5e-3 * np.arange(1, 4001), 0.0), abs=1e-9)
    assert scaled[-1] == 0.0


def test_gain_does_not_lift_the_supply() -> None:
    assert find_settled_pressures([10.0], valve_gain__ratio=1.5) == pytest.approx([SUPPLY], rel=SETTLED)


def test_slower_valve_answers_a_step_as_a_second_order_system_of_the_lower_frequency() -> None:
    result = run(make_rig(slower_valve__ratio=0.5), [(1.36, 400)])["valve_pressure"] / BAR
    t, w = 1e-3 * np.arange(1, 401), 0.5 * W_V
    damped = w * np.sqrt(1 - ZETA**2)
    step = 1.0 - np.exp(-ZETA * w * t) * (np.cos(damped * t) + ZETA * w / damped * np.sin(damped * t))
    assert result == pytest.approx(K_V * 1.36 * step, abs=RESPONSE * K_V * 1.36)


@pytest.mark.parametrize("damping", [1.2, 3.0])
def test_a_damped_valve_answers_a_step_as_a_system_of_that_damping(damping: float) -> None:
    result = run(make_rig(slower_valve__damping=damping), [(1.36, 400)])["valve_pressure"] / BAR
    t = 1e-3 * np.arange(401)
    system = scipy.signal.TransferFunction([W_V**2], [1.0, 2.0 * damping * ZETA * W_V, W_V**2])
    step = scipy.signal.step(system, T=t)[1][1:]
    assert result == pytest.approx(K_V * 1.36 * step, abs=RESPONSE * K_V * 1.36)


@pytest.mark.parametrize("h", [1e-4, 1e-3])
def test_a_lag_before_the_valve_follows_a_step_as_a_first_order_system_does_in_the_mean_of_each_step(h: float) -> None:
    result = apply_law("slower_valve", [2.0] * round(0.05 / h), h=h, ratio=1.0, lag=5e-3)
    ends = h * np.arange(len(result) + 1)
    integral = 2.0 * (ends + 5e-3 * np.exp(-ends / 5e-3))  # of 2 (1 - exp(-t/tau))
    assert result == pytest.approx(np.diff(integral) / h, abs=1e-9)


# --- delay -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [1, 7, 50])  # ms
def test_delay_shifts_pressure_and_piston_by_exactly_itself(delay: int) -> None:
    late, prompt = run(make_rig(valve_delay__delay=float(delay)), ENGAGE), run(make_rig(), ENGAGE)
    for name in ("valve_pressure", "valve_rate", "pressure", "position", "normal_force"):
        assert (late[name][delay:] == prompt[name][:-delay]).all(), name
        assert (late[name][:delay] == 0.0).all(), name


@pytest.mark.parametrize("substeps", [10, 13, 20])
@pytest.mark.parametrize("delay", [0.03, 3.14159, 49.99])  # ms
def test_a_delay_between_steps_loses_exactly_the_impulse_of_its_length(delay: float, substeps: int) -> None:
    late, prompt = (
        run(make_rig(valve_delay__delay=d), [(1.0, 600)], substeps=substeps)["valve_pressure"] for d in (delay, 0.0)
    )
    assert 1e-3 * np.sum(prompt - late) == pytest.approx(1e-3 * delay * K_V * BAR, rel=IMPULSE)


@pytest.mark.parametrize(
    ("changed", "bump"),
    [
        ({"valve_delay__delay": 20.0}, 0.0),
        ({"slower_valve__lag": 50.0}, SWITCHED),
        ({"spool_stiction__breakaway": 2.0}, SWITCHED),
    ],
)
def test_what_remembers_the_demand_gives_no_bump_when_it_is_switched_on_in_a_running_plant(
    changed: dict[str, float], bump: float
) -> None:
    plain, with_memory = make_rig(), make_rig(**changed)
    _, state = resume(plain, plain.make_rest_state(20.0, 343.15), [(1.36, 300)])
    carried = Whole(state.y, with_memory.table.carry_over(state.effects, plain.table))
    there, here = resume(with_memory, carried, [(1.36, 50)])[0], resume(plain, state, [(1.36, 50)])[0]
    assert there["valve_pressure"] == pytest.approx(here["valve_pressure"], abs=bump)


# --- hysteresis ------------------------------------------------------------------------------------------------------


def test_hysteresis_opens_a_loop_as_wide_as_it_says() -> None:
    up, down = (
        find_settled_pressures([0.0, 2.0], valve_hysteresis__width=0.4)[-1],
        find_settled_pressures([4.0, 2.0], valve_hysteresis__width=0.4)[-1],
    )
    assert (up, down) == pytest.approx((4.8, 5.2), abs=1e-5)


def test_hysteresis_remembers_where_it_turned() -> None:
    path = make_ramp(0.0, 3.0, 1.0, 2.0, 1.0, 0.0)
    out = apply_law("valve_hysteresis", path, width=0.9)
    first, again = np.flatnonzero(path == 1.0)[1:3]
    assert again == first + 2000
    assert out[again] == pytest.approx(out[first], rel=EXACT), "the minor loop closes"
    plain = apply_law("valve_hysteresis", make_ramp(0.0, 3.0, 1.0, 0.0), width=0.9)
    assert out[again:] == pytest.approx(plain[first:], rel=EXACT, abs=EXACT), "and is forgotten"


def test_hysteresis_loops_between_the_same_ends_are_congruent() -> None:
    one = apply_law("valve_hysteresis", make_ramp(0.0, 2.0, 1.0, 2.0), width=0.9)[2000:]
    other = apply_law("valve_hysteresis", make_ramp(0.0, 4.0, 1.0, 2.0, 1.0, 2.0), width=0.9)[-2001:]
    assert one - one[0] == pytest.approx(other - other[0], abs=1e-12)


def test_hysteresis_is_odd_and_takes_work() -> None:
    path = make_ramp(0.0, 2.0, -2.0, 2.0)
    out = apply_law("valve_hysteresis", path, width=0.9)
    assert (out == -apply_law("valve_hysteresis", -path, width=0.9)).all()
    area = -np.trapezoid(out[2000:], path[2000:])  # of the loop from 2 to 2: down above, up below
    assert area == pytest.approx(
        0.9 * 4.0 - 0.9 * 0.9 * 21 / 16, rel=1e-3
    )  # sum of the plays' 2 r (4 - 2 r), a quarter each


@pytest.mark.parametrize(("name", "pascal"), [("valve_hysteresis", 0.0), ("spool_stiction", 1.0)])  # its slide: 0.28 Pa
def test_what_the_valve_remembers_does_not_depend_on_the_integration_step(name: str, pascal: float) -> None:
    strength = find_effect(name).strengths[0].name
    hard = {f"{name}__{strength}": 0.3}
    voltages = [(float(v), 3) for v in 1.2 + 0.3 * np.sin(np.linspace(0.0, 20.0, 150))]
    coarse, fine = (run(make_rig(**hard), voltages, substeps=n)["valve_pressure"] for n in (10, 20))
    assert coarse == pytest.approx(fine, rel=1e-6, abs=pascal)
    assert np.abs(coarse - run(make_rig(), voltages)["valve_pressure"]).max() > 0.1 * BAR


@pytest.mark.parametrize("spread", [0.5, 1.0, 3.0])
def test_spread_is_how_far_the_command_goes_from_one_side_of_the_loop_to_the_other(spread: float) -> None:
    width, path = 0.4, make_ramp(0.0, 4.0, 1.0)
    behind = path - apply_law("valve_hysteresis", path, width=width, spread=spread)
    top = int(np.argmax(path))
    assert behind[top] == pytest.approx(width / 2)
    crossed = top + np.flatnonzero(np.isclose(behind[top:], -width / 2, atol=1e-9))[0]
    # the widest of four plays, 7/8 of the spread, crosses twice its radius
    assert path[top] - path[crossed] == pytest.approx(2.0 * spread * width * 7 / 8, abs=2e-3)


# --- stiction --------------------------------------------------------------------------------------------------------


FAST_SPOOL = {"speed": 1e20, "rest_band": 0.0}  # it jumps, and rests as soon as its demand does


def test_stiction_makes_a_staircase_of_a_slow_ramp() -> None:
    path = make_ramp(0.0, 4.0)
    out = apply_law("spool_stiction", path, breakaway=0.5, kinetic_share=0.4, speed=1e20, rest_band=0.01)
    steps = np.diff(out)
    steps = steps[steps != 0.0]
    assert steps == pytest.approx(0.5 * (0.6 - 0.01), abs=2e-3), "what break-away has more than sliding, less the rest"
    assert len(steps) == 12
    assert np.abs(path - out).max() <= 0.5


def test_stiction_follows_a_fast_ramp_behind_what_sliding_takes() -> None:
    slope, speed = 10.0, 500.0  # per s
    path = make_ramp(0.0, 4.0, step=slope * 1e-4)
    out = apply_law("spool_stiction", path, breakaway=0.5, kinetic_share=0.4, speed=speed, rest_band=0.01)
    lag = (0.4 + slope / speed) * 0.5  # dw/dt = a (lag/S - kappa)
    assert (path - out)[len(path) // 2 :] == pytest.approx(lag, abs=2.0 * slope * 1e-4)


@pytest.mark.parametrize("h", [1e-4, 1e-3, 7e-3])
def test_the_slide_takes_the_time_that_its_speed_says_whatever_the_step(h: float) -> None:
    """From 0 to 1 less 0.4 S: S/a = 5 ms; at rest when b S = 0.05 are left, after 14 ms."""
    rest, time = 0.05, h * np.arange(1, 1 + round(0.042 / h))
    out = apply_law(
        "spool_stiction", np.ones_like(time), h=h, breakaway=0.5, kinetic_share=0.4, speed=100.0, rest_band=0.1
    )
    left = np.maximum(0.8 * np.exp(-np.linspace(0.0, 0.042, 420001) / 5e-3), rest)  # exact
    assert out == pytest.approx(0.8 - left[:-1].reshape(len(out), -1).mean(axis=1), abs=1e-4)
    assert out[-1] == pytest.approx(0.8 - rest, abs=1e-12)


def test_stiction_without_a_jump_is_a_play() -> None:
    path = make_ramp(0.0, 2.0, 0.7, 1.5, -1.0)
    play, plays = 0.0, []
    for u in path:
        play = min(max(play, u - 0.3), u + 0.3)
        plays.append(play)
    out = apply_law("spool_stiction", path, breakaway=0.3, kinetic_share=1.0, **FAST_SPOOL)
    assert out == pytest.approx(plays, abs=EXACT)


def test_a_spool_does_not_break_away_in_no_time() -> None:
    one = find_effect("spool_stiction")
    p = SimpleNamespace(**{q.name: q.off for q in one.parameters} | {"breakaway": 0.3})
    x, s = SimpleNamespace(spool=0.0, sliding=0.0), SimpleNamespace(demand=1.0)
    one.laws[COMMAND](s, None, p, x, 0.0)
    assert (s.demand, x.spool, x.sliding) == (0.0, 0.0, 0.0)


def test_stiction_is_odd() -> None:
    path = make_ramp(0.0, 2.0, 0.7, 1.5, -1.0)
    there = apply_law("spool_stiction", path, breakaway=0.3, kinetic_share=0.5)
    assert (there == -apply_law("spool_stiction", -path, breakaway=0.3, kinetic_share=0.5)).all()


def measure_hunting(**changed: float) -> float:
    """Pressure from crest to valley [bar] under an integrating regulator that has had 4 s to settle at 3.4 bar."""
    valve = make_rig(**changed)
    state, integral, seen = valve.make_rest_state(20.0, 343.15), 0.0, []
    for _ in range(6000):
        error = 3.4 - float(state.y["pressure"][0]) / BAR
        integral += 1e-3 * error
        state = valve.advance(state, (3.4 + 0.45 * error + 6.0 * integral) / K_V, 20.0, 1e9, 1e-3, 10)
        seen.append(3.4 - error)
    return float(np.ptp(seen[4000:]))


def test_stiction_makes_an_integrating_regulator_hunt_and_hysteresis_does_not() -> None:
    assert measure_hunting() < 1e-6
    assert measure_hunting(valve_hysteresis__width=0.2) < 1e-6
    assert measure_hunting(spool_stiction__breakaway=0.1) > 0.04  # the jump: half of the break-away


# --- supply ----------------------------------------------------------------------------------------------------------


def test_supply_sags_by_what_the_fill_draws() -> None:
    sagging = Fluid(droop=2e4, recovery=0.03).run(ENGAGE)
    result = run(make_rig(supply_sag__droop=2e4, supply_sag__recovery=30.0), ENGAGE)
    assert sagging[:, 4].max() > 1.0
    assert result["pressure"] / BAR == pytest.approx(sagging[:, 2], abs=SAG)
    assert result["valve_pressure"] / BAR == pytest.approx(sagging[:, 0], abs=SAG)


def test_supply_recovers_once_no_oil_is_drawn() -> None:
    pieces = [(1.36, 900)]
    sagging, plain = (run(make_rig(supply_sag__droop=droop), pieces)["pressure"] / BAR for droop in (2e4, 0.0))
    assert np.abs(sagging - plain)[:150].max() > 0.1
    assert sagging[-1] == pytest.approx(plain[-1], rel=1e-6)


def test_a_sagging_supply_limits_the_pressure() -> None:
    asked_for_more = {"valve_gain__ratio": 1.5, "internal_leakage__conductance": 1e-4}
    weak = run(make_rig(supply_sag__droop=5e4, **asked_for_more), [(10.0, 3000)])[-1]
    drawn = G * (weak["valve_pressure"] - weak["pressure"]) / BAR
    assert weak["valve_pressure"] / BAR == pytest.approx(SUPPLY - 5e4 * drawn, rel=1e-3)
