"""Adaptation of the friction level: what it learns, when it does not learn, and at which temperatures it keeps it."""

from collections.abc import Iterator
from math import exp, inf, sin
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rt_controller.law.adaptation import ADAPTATION, ADAPTATION_SETTINGS, INITIAL_ADAPTATION, TEMPERATURE_NODES, adapt
from rt_controller.law.record import make_record
from rt_controller.loop.parameter_sets import load_controller_parameters

STEP = 1e-3  # s
COULOMB, VISCOUS = 9.7, 7.0  # Nm, at about 3.4 bar and 20 rad/s
WARM, HOT = 343.15, 403.15  # K
VALUES = load_controller_parameters().list_si("adaptation")
SETTINGS = make_record(ADAPTATION_SETTINGS, VALUES)
SETTLED = 10 * SETTINGS.time_constant  # s: exp(-10) of the error is left, 1e-5 for the level 0.8
LEVEL_TOLERANCE = 1e-4
# The viscous part moves with the level on one moment matrix: slower, and only while its parts are told apart.
VISCOUS_TOLERANCE = 2e-3
TIME_CONSTANT_TOLERANCE = 0.01  # relative: Euler steps of 1/500 of the time constant
NOISE_LEVEL = 0.005  # of the level: 0.05 Nm of noise on 17 Nm over 1000 samples is 1e-4


class LevelAdaptation:
    """The function `adapt` with records of its own."""

    def __init__(self, settings: Any) -> None:
        self._state, self._settings = make_record(ADAPTATION, INITIAL_ADAPTATION), settings

    def update(self, *data: float) -> None:
        adapt(self._state, self._settings, *data)

    def read_contents(self) -> dict[str, bytes]:
        """Return all learnt values, to the bit."""
        return {name: self._state[name].tobytes() for name in ADAPTATION.names or () if name != "active"}

    @property
    def level(self) -> float:
        return float(self._state.level)

    @property
    def viscous(self) -> float:
        return float(self._state.viscous)

    @property
    def active(self) -> bool:
        return bool(self._state.active)


def learn(
    adaptation: LevelAdaptation,
    seconds: float,
    level: float = 0.8,
    viscous: float = 0.0,
    temperature: float = WARM,
    varying: float = 0.0,
    **changed: float,
) -> None:
    """Adapt to exact data of a clutch with this `level` and `viscous` correction; `varying` changes the viscous share."""
    for k in range(round(seconds / STEP)):
        v = VISCOUS * (1.0 + varying * sin(20.0 * k * STEP))
        observed = level * (COULOMB + v) + viscous * v
        values = {"slip": 20.0, "acceleration": 0.0, "sliding": True} | changed
        adaptation.update(
            COULOMB, v, observed, values["slip"], values["acceleration"], temperature, STEP, values["sliding"]
        )


def look(adaptation: LevelAdaptation, temperature: float) -> float:
    """Return the level at a temperature, without learning."""
    adaptation.update(0.0, 0.0, 0.0, 0.0, 0.0, temperature, STEP, False)
    assert not adaptation.active
    return adaptation.level


def test_an_untaught_adaptation_leaves_the_model_as_it_is() -> None:
    adaptation = LevelAdaptation(SETTINGS)
    assert (adaptation.level, adaptation.viscous, adaptation.active) == (1.0, 0.0, False)
    assert look(adaptation, HOT) == 1.0


@pytest.mark.parametrize("level", [0.8, 1.0, 1.3])
def test_the_level_converges_to_the_truth_from_exact_data(level: float) -> None:
    adaptation = LevelAdaptation(SETTINGS)
    learn(adaptation, 2 * SETTLED, level)
    assert adaptation.active
    assert adaptation.level == pytest.approx(level, abs=LEVEL_TOLERANCE)


def test_the_level_follows_with_its_time_constant() -> None:
    adaptation = LevelAdaptation(SETTINGS)
    # at a node, share s of each correction goes to the node and 1 - s to the base: together all of it
    learn(adaptation, SETTINGS.time_constant, 0.8, temperature=TEMPERATURE_NODES[2])
    assert adaptation.level == pytest.approx(0.8 + 0.2 * exp(-1.0), rel=TIME_CONSTANT_TOLERANCE)


def test_both_directions_of_slip_teach_the_same_level() -> None:
    forward, backward = LevelAdaptation(SETTINGS), LevelAdaptation(SETTINGS)
    for _ in range(3000):
        forward.update(COULOMB, VISCOUS, 0.8 * 16.7, 20.0, 5.0, WARM, STEP, True)
        backward.update(-COULOMB, -VISCOUS, -0.8 * 16.7, -20.0, -5.0, WARM, STEP, True)
    assert forward.level < 0.85
    assert backward.level == forward.level


def test_noise_of_the_torque_signal_averages_out() -> None:
    adaptation = LevelAdaptation(SETTINGS)
    for k in range(20_000):
        noise = 0.05 * sin(1e4 * k)  # any bounded sequence without mean
        adaptation.update(COULOMB, VISCOUS, 0.8 * 16.7 + noise, 20.0, 0.0, WARM, STEP, True)
    assert adaptation.level == pytest.approx(0.8, abs=NOISE_LEVEL)


FROZEN = {
    "out of contact": {"sliding": False},
    "below the slip floor": {"slip": SETTINGS.slip_floor},
    "below the slip floor, backwards": {"slip": -SETTINGS.slip_floor},
    "accelerating hard": {"acceleration": SETTINGS.acceleration_limit},
    "braking hard": {"acceleration": -SETTINGS.acceleration_limit},
}


@pytest.mark.parametrize("why", FROZEN)
def test_nothing_is_learnt(why: str) -> None:
    adaptation = LevelAdaptation(SETTINGS)
    learn(adaptation, 1.0, 0.9, varying=0.3)
    before = adaptation.read_contents()
    learn(adaptation, 1.0, 0.5, 0.3, varying=0.3, **FROZEN[why])  # type: ignore[arg-type]
    assert adaptation.read_contents() == before
    assert not adaptation.active


@pytest.mark.parametrize("torque", [0.0, SETTINGS.torque_floor, -SETTINGS.torque_floor])
def test_nothing_is_learnt_below_the_torque_floor(torque: float) -> None:
    adaptation = LevelAdaptation(SETTINGS)
    learn(adaptation, 1.0, 0.9)
    before = adaptation.read_contents()
    for _ in range(1000):
        adaptation.update(0.5 * torque, 0.5 * torque, 10.0, 20.0, 0.0, WARM, STEP, True)
    assert adaptation.read_contents() == before


def test_just_inside_every_floor_it_learns() -> None:
    for changed in (
        {"slip": SETTINGS.slip_floor * 1.01},
        {"slip": -SETTINGS.slip_floor * 1.01},
        {"acceleration": SETTINGS.acceleration_limit * 0.99},
    ):
        adaptation = LevelAdaptation(SETTINGS)
        learn(adaptation, 0.1, **changed)  # type: ignore[arg-type]
        assert adaptation.active
        assert adaptation.level < 1.0


@pytest.mark.parametrize(("truth", "bound"), [(0.1, SETTINGS.level_low), (5.0, SETTINGS.level_high)])
def test_the_level_is_bounded_and_comes_back_at_once(truth: float, bound: float) -> None:
    adaptation = LevelAdaptation(SETTINGS)
    learn(adaptation, 3 * SETTLED, truth)
    assert adaptation.level == pytest.approx(bound, abs=LEVEL_TOLERANCE)
    learn(adaptation, SETTLED + 8 * SETTINGS.window, 1.0)  # no wind-up beyond the bound
    assert adaptation.level == pytest.approx(1.0, abs=2e-3)


@given(
    st.lists(
        st.tuples(
            st.floats(-30, 30), st.floats(-30, 30), st.floats(-1e3, 1e3), st.floats(-30, 30), st.floats(-100, 100),
            st.floats(250, 450), st.floats(1e-5, 0.1), st.booleans(),
        ),
        max_size=60,
    )
)  # fmt: skip
def test_no_data_drives_level_or_viscous_correction_out_of_bounds(data: list[tuple[float, ...]]) -> None:
    adaptation = LevelAdaptation(SETTINGS)
    for c, v, observed, slip, acceleration, temperature, step, sliding in data:
        adaptation.update(c, v, observed, slip, acceleration, temperature, step, bool(sliding))
        assert SETTINGS.level_low <= adaptation.level <= SETTINGS.level_high
        assert abs(adaptation.viscous) <= SETTINGS.viscous_bound


def test_a_stale_sample_may_be_the_first() -> None:
    adaptation = LevelAdaptation(SETTINGS)
    adaptation.update(COULOMB, VISCOUS, 5.0, 20.0, 0.0, WARM, 0.0, True)
    assert (adaptation.level, adaptation.viscous) == (1.0, 0.0), "no correction"


def test_a_stale_sample_teaches_nothing() -> None:
    adaptation = LevelAdaptation(SETTINGS)
    learn(adaptation, 1.0, 0.9)
    level, viscous = adaptation.level, adaptation.viscous
    for _ in range(100):
        adaptation.update(COULOMB, VISCOUS, 5.0, 20.0, 0.0, WARM, 0.0, True)  # no time has passed
    assert (adaptation.level, adaptation.viscous) == (level, viscous)


def test_the_viscous_part_is_held_while_the_ratio_of_parts_is_constant() -> None:
    adaptation = LevelAdaptation(SETTINGS)
    for k in range(20_000):
        load = 1.0 + 0.5 * sin(20.0 * k * STEP)  # more or less pressure: both parts alike
        c, v = COULOMB * load, VISCOUS * load
        adaptation.update(c, v, 0.8 * (c + v) + 0.3 * v, 20.0, 0.0, WARM, STEP, True)
    assert adaptation.viscous == 0.0
    # the whole is right all the same, for this ratio
    whole = 0.8 + 0.3 * VISCOUS / (COULOMB + VISCOUS)
    assert adaptation.level == pytest.approx(whole, abs=LEVEL_TOLERANCE)


@pytest.mark.parametrize("viscous", [0.3, -0.2])
def test_with_excitation_level_and_viscous_part_are_told_apart(viscous: float) -> None:
    adaptation = LevelAdaptation(SETTINGS)
    learn(adaptation, 30.0, 0.8, viscous, varying=0.8)
    assert adaptation.viscous == pytest.approx(viscous, abs=VISCOUS_TOLERANCE)
    assert adaptation.level == pytest.approx(0.8, abs=VISCOUS_TOLERANCE)


def test_too_little_excitation_does_not_move_the_viscous_part() -> None:
    adaptation = LevelAdaptation(SETTINGS)
    learn(adaptation, 5.0, 0.8, 0.3, varying=0.05)
    assert adaptation.viscous == 0.0


def test_what_is_learnt_at_one_temperature_stays_there_more_than_elsewhere() -> None:
    adaptation = LevelAdaptation(SETTINGS)
    learn(adaptation, 2 * SETTLED, 0.8, temperature=WARM)
    here, elsewhere = 1.0 - look(adaptation, WARM), 1.0 - look(adaptation, HOT)
    assert here == pytest.approx(0.2, abs=LEVEL_TOLERANCE)
    assert 0.0 < elsewhere < here, "elsewhere the level moves too, but less"


def test_what_is_learnt_at_a_node_is_shared_by_the_temperature_share() -> None:
    adaptation = LevelAdaptation(SETTINGS)
    node = TEMPERATURE_NODES[1]
    learn(adaptation, 2 * SETTLED, 0.8, temperature=node)
    for other in (TEMPERATURE_NODES[0], *TEMPERATURE_NODES[2:], 280.0, 500.0):
        assert 1.0 - look(adaptation, other) == pytest.approx(
            0.2 * (1.0 - SETTINGS.temperature_share), abs=LEVEL_TOLERANCE
        )
    between = 0.5 * (node + TEMPERATURE_NODES[2])
    assert look(adaptation, between) == pytest.approx(
        0.5 * (look(adaptation, node) + look(adaptation, TEMPERATURE_NODES[2])), abs=1e-12
    )


def test_between_two_nodes_both_remember_by_their_nearness_and_the_others_nothing() -> None:
    low, high = TEMPERATURE_NODES[1:3]
    for nearness in (0.5, 0.25, 0.9):
        adaptation = LevelAdaptation(SETTINGS)
        learn(adaptation, 1.0, 0.8, temperature=low + nearness * (high - low))
        base = look(adaptation, TEMPERATURE_NODES[0])
        assert look(adaptation, TEMPERATURE_NODES[3]) == look(adaptation, TEMPERATURE_NODES[5]) == base
        shares = base - look(adaptation, low), base - look(adaptation, high)
        whole = SETTINGS.temperature_share / (1.0 - SETTINGS.temperature_share) * (1.0 - base)
        assert shares == pytest.approx(((1.0 - nearness) * whole, nearness * whole), rel=1e-9)


@pytest.mark.parametrize(("outside", "end", "next_one"), [(280.0, 0, 1), (500.0, 5, 4)])
def test_beyond_the_nodes_the_end_node_remembers_alone(outside: float, end: int, next_one: int) -> None:
    adaptation = LevelAdaptation(SETTINGS)
    learn(adaptation, 1.0, 0.8, temperature=outside)
    assert look(adaptation, TEMPERATURE_NODES[end]) == look(adaptation, outside)
    assert look(adaptation, TEMPERATURE_NODES[next_one]) == look(adaptation, TEMPERATURE_NODES[2])
    assert look(adaptation, outside) < look(adaptation, TEMPERATURE_NODES[2])


def test_nodes_span_fig_6_8() -> None:
    assert (TEMPERATURE_NODES[0], TEMPERATURE_NODES[-1]) == (313.15, 423.15)
    assert list(TEMPERATURE_NODES) == sorted(set(TEMPERATURE_NODES))


def test_a_step_longer_than_the_time_constant_goes_to_the_truth_and_not_beyond() -> None:
    adaptation = LevelAdaptation(SETTINGS)
    adaptation.update(COULOMB, VISCOUS, 0.8 * (COULOMB + VISCOUS), 20.0, 0.0, TEMPERATURE_NODES[2], 10.0, True)
    assert adaptation.level == pytest.approx(0.8, abs=1e-12)


def test_two_temperatures_end_with_a_level_each() -> None:
    adaptation = LevelAdaptation(SETTINGS)

    def apart() -> float:
        return look(adaptation, HOT) - look(adaptation, WARM)

    def teach(rounds: int) -> Iterator[float]:
        for _ in range(rounds):
            learn(adaptation, 6.0, 0.8, temperature=WARM)
            learn(adaptation, 6.0, 1.1, temperature=HOT)
            yield apart()

    differences = list(teach(4))
    assert differences == sorted(differences), "each round keeps more of the difference"
    assert differences[-1] > 0.8 * (1.1 - 0.8)


def test_without_a_temperature_share_all_temperatures_learn_alike() -> None:
    adaptation = LevelAdaptation(make_record(ADAPTATION_SETTINGS, VALUES, temperature_share=0.0))
    learn(adaptation, SETTLED, 0.8, temperature=WARM)
    assert look(adaptation, HOT) == look(adaptation, WARM) < 0.85


def test_what_does_not_slide_is_level_one_for_ever() -> None:
    adaptation = LevelAdaptation(SETTINGS)
    for observed in (0.0, 5.0, 1e9, -inf):
        adaptation.update(COULOMB, VISCOUS, observed, 20.0, 0.0, WARM, STEP, False)
        assert (adaptation.level, adaptation.viscous, adaptation.active) == (1.0, 0.0, False)


def test_after_a_step_longer_than_the_window_only_the_newest_sample_counts() -> None:
    adaptation = LevelAdaptation(SETTINGS)
    learn(adaptation, SETTLED)
    coulomb, viscous = 0.5 * COULOMB, 0.5 * VISCOUS
    adaptation.update(coulomb, viscous, coulomb + viscous, 20.0, 0.0, WARM, 2.0 * SETTINGS.window, True)
    assert adaptation._state.aa == pytest.approx((coulomb + viscous) ** 2)
