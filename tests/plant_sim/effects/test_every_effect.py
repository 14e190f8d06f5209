"""What holds for every effect of the catalogue, whoever wrote it."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest

from clutch_hil.bench.effect_sheets.demonstration import demonstrate
from clutch_hil.bench.effect_sheets.effect_text import split_sections
from plant_sim.effects.catalogue import load_effects
from plant_sim.effects.effect import SECTIONS, Effect
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.sensors import Sensors
from plant_sim.rigs.wet_clutch import Rig, State, Whole
from protocols.errors import InputError

SEEN = 3.0  # times noise and quantisation together; least measured: 3.9, coarse_quantisation (half of its 0.39 Nm)
SANE = {  # largest magnitudes of a rough run, any effect at any bound
    "slip_speed": 100.0,  # rad/s; measured 28 without effects, 70 where a very soft shaft swings
    "pressure": 30e5,  # Pa; measured 21.5 bar without effects, 25.0 bar, the supply, behind a quick valve
    # Nm; measured 74 Nm without effects. A backlash that closes on plates which stick brings what they can carry: at the 25 bar
    # of the supply M_C is 245 Nm, C_v 60 Nm at 1 rad/s. Measured 280 Nm at 21 bar and 3.6 rad/s, 204 of M_C and 76 of C_v, and
    # with a gap of 0.2 rad 240 Nm, in steps of 0.1 as of 0.001 ms
    "clutch_torque": 10.8 * 25.0 - 25.1 + 2.67 * 25.0 - 6.49,
}
# One advance of 4 ms against four of 1 ms. Without effects 4e-7 Nm, 2e-6 rad/s: what a call knows of the acceleration
SPLIT = {"pressure": 10.0, "clutch_torque": 0.01, "slip_speed": 0.002, "temperature": 1e-4}  # Pa, Nm, rad/s, K
# 0.6 s after switching off: half of what noise and quantisation are; the motor's speed control takes longest to settle
BACK = {"pressure": 250.0, "clutch_torque": 0.025, "slip_speed": 0.008, "temperature": 0.05}  # Pa, Nm, rad/s, K

Piece = tuple[float, float, int]  # voltage [V], speed demand [rad/s], cycles of 1 ms
ROUGH: tuple[Piece, ...] = (  # engagement, release before it is slow, reversal under load, full supply, both at once
    (1.36, 20.0, 200),
    (0.0, 20.0, 120),
    (1.6, 25.0, 150),
    (1.6, -25.0, 200),
    (10.0, -5.0, 60),
    (0.0, 30.0, 150),
)
SMOOTH: tuple[Piece, ...] = ((1.36, 20.0, 300), (1.5, 15.0, 100))
HELD = (1.36, 20.0)
LIMIT = 40.0  # Nm, of the motor

NOMINAL = wet_clutch.load_nominal()
BASELINE = Rig(NOMINAL)
ALL = tuple(load_effects().values())
every_effect = pytest.mark.parametrize("effect", ALL, ids=lambda effect: effect.name)


class Taken(NamedTuple):
    """States after every cycle, counts before it, and the rig at the end."""

    states: np.ndarray
    counts: np.ndarray
    end: Whole


def run(rig: Rig, pieces: Sequence[Piece], state: Whole | None = None) -> Taken:
    """A run through the sensors, from rest if no state is given."""
    state = state or rig.make_rest_state(pieces[0][1], 343.15)
    sensors, states, counts = Sensors(seed=1), [], []
    for voltage, speed, cycles in pieces:
        for _ in range(cycles):
            sample, state = sensors.sample(rig, state, 1e-3)
            state = rig.advance(state, voltage, speed, LIMIT, 1e-3, 10)
            counts.append(sample)
            states.append(state.y)
    return Taken(np.concatenate(states), np.array(counts), state)


def make_typical_rig(*chosen: Effect) -> Rig:
    """A rig with effects at their typical values."""
    return Rig(
        NOMINAL.with_values({name: value for effect in chosen for name, value in effect.list_typical_values().items()})
    )


def try_rig(values: Mapping[str, float]) -> Rig | None:
    """A rig with these values; None where it says that it cannot integrate them."""
    try:
        return Rig(NOMINAL.with_values(values))
    except InputError as error:
        if "too fast to integrate" not in str(error):
            raise
        return None


def carry_over(state: Whole, before: Rig, after: Rig) -> Whole:
    return state._replace(effects=after.table.carry_over(state.effects, before.table))


def assert_sane(taken: Taken, what: str) -> None:
    numbers = taken.states.view(np.float64)
    assert np.isfinite(numbers).all(), (
        f"{what}: {State._fields[int(np.argmax(~np.isfinite(numbers))) % len(State._fields)]}"
    )
    assert np.isfinite(taken.end.effects).all(), what
    for name, limit in SANE.items():
        assert np.abs(taken.states[name]).max() <= limit, f"{what}: {name}"


@every_effect
def test_docstring_has_a_title_and_every_section(effect: Effect) -> None:
    texts = split_sections(effect)
    assert {"What", *SECTIONS} <= set(texts)
    assert all(texts.values())
    assert 10 < len(effect.title) <= 120


@pytest.fixture(scope="module")
def baseline() -> Taken:
    taken = run(BASELINE, ROUGH)
    assert taken.states["clutch_torque"].min() < -10.0 < 10.0 < taken.states["clutch_torque"].max()
    return taken


@every_effect
def test_attached_but_off_it_changes_not_one_bit(effect: Effect, baseline: Taken) -> None:
    rig = Rig(NOMINAL, also=(effect.name,))
    assert rig.table.names == (effect.name,)
    result = run(rig, ROUGH)
    for name in State._fields:
        assert (result.states[name] == baseline.states[name]).all(), name
    assert (result.counts == baseline.counts).all()


@every_effect
def test_at_typical_values_something_measured_changes(effect: Effect) -> None:
    shown = demonstrate(effect)
    assert shown.times_resolution > SEEN
    assert np.isfinite(shown.with_it[shown.column]).all()


@every_effect
def test_at_the_ends_of_its_bounds_the_rig_stays_sane(effect: Effect) -> None:
    rigs = 0
    for p, end in product(effect.parameters, (0, 1)):
        if rig := try_rig(effect.list_typical_values() | {f"{effect.name}.{p.name}": p.bounds[end]}):
            assert_sane(run(rig, ROUGH), f"{effect.name}.{p.name} = {p.bounds[end]:g} {p.unit}")
            rigs += 1
    assert rigs >= 2 * len(effect.parameters) - 1, "bounds should be values the rig can have"


def test_all_effects_at_once_leave_the_rig_sane() -> None:
    chosen: list[Effect] = []
    for effect in ALL:
        if not any(other.name in effect.excludes or effect.name in other.excludes for other in chosen):
            chosen.append(effect)
    assert len(chosen) > len(ALL) // 2, "most effects go together"
    assert_sane(run(make_typical_rig(*chosen), ROUGH), "all")


@every_effect
def test_a_call_without_steps_moves_no_state(effect: Effect) -> None:
    rig = make_typical_rig(effect)
    state = run(rig, ROUGH[:4]).end
    voltage, speed, _ = ROUGH[3]
    for _ in range(2):
        after = rig.advance(state, voltage, speed, LIMIT, 0.0, 0)
        assert after.effects.tobytes() == state.effects.tobytes()
        assert after.y.tobytes() == state.y.tobytes()


@every_effect
def test_the_number_of_calls_does_not_matter(effect: Effect) -> None:
    rig = make_typical_rig(effect)
    one = several = rig.make_rest_state(SMOOTH[0][1], 343.15)
    for voltage, speed, cycles in SMOOTH:
        for _ in range(cycles // 4):
            one = rig.advance(one, voltage, speed, LIMIT, 4e-3, 40)
            for _ in range(4):
                several = rig.advance(several, voltage, speed, LIMIT, 1e-3, 10)
            for name, limit in SPLIT.items():
                assert abs(one.y[name][0] - several.y[name][0]) <= limit, name


@pytest.fixture(scope="module")
def undisturbed() -> State:
    return run(BASELINE, [(*HELD, 1000)]).end.read()


@every_effect
def test_switched_on_and_off_again_it_leaves_the_baseline(effect: Effect, undisturbed: State) -> None:
    rig = make_typical_rig(effect)
    state = run(BASELINE, [(*HELD, 200)]).end
    state = run(rig, [(*HELD, 200)], carry_over(state, BASELINE, rig)).end
    after = run(BASELINE, [(*HELD, 600)], carry_over(state, rig, BASELINE)).end.read()
    for name, limit in BACK.items():
        assert abs(getattr(after, name) - getattr(undisturbed, name)) <= limit, name
    assert after.seal_force == 0.0
    assert after.lead == 0.0
