"""Plates at standstill: they carry exactly what is applied, up to their capacity, at any step; break away; land; hold."""

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np
import pytest

from plant_sim.effects.catalogue import load_effects
from plant_sim.effects.effect import Effect
from plant_sim.effects.signals import SIGNALS
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.clutch_phase import Phase, find_phase
from plant_sim.rigs.standstill import step_near_standstill
from plant_sim.rigs.wet_clutch import Rig, Whole
from protocols.files.units import BAR

OIL = 343.15  # K
PERIOD = 1e-3  # s
STEPS = (2, 3, 10, 100)  # of a sample: 0.5 ms, about the longest that the hydraulics bear, to 0.01 ms
NOMINAL = wet_clutch.load_nominal()
RIG = Rig(NOMINAL)
INERTIA = 0.05  # kg m^2, of the motor
AREA = 1.131e-2  # m^2, of the piston
BROKEN = 1e-6  # rad/s: faster plates have broken away
TURNED = 0.015  # Nm, root mean square, the same where plates turn again and again
CONVERGED = 0.05  # Nm between steps of 0.5 and 0.01 ms, the sensor's noise; measured 0.024

Signal = float | Callable[[float], float]  # a number, or a function of the time [s]


def apply_torque(
    rig: Rig, begin: Whole, voltage: Signal, torque: Signal, seconds: float, substeps: int = 10
) -> np.ndarray:
    """States after each sample while the motor gives a `torque` [Nm]: its speed controller is kept at the limit."""
    state, states = begin, []
    for k in range(round(seconds / PERIOD)):
        volts, asked = (x(k * PERIOD) if callable(x) else x for x in (voltage, torque))
        state = rig.advance(state, volts, np.copysign(1e3, asked), abs(asked), PERIOD, substeps)
        states.append(state.y)
    return np.concatenate(states)


def make_rest_state(rig: Rig = RIG, voltage: float = 1.36) -> Whole:
    """Plates pressed for 0.5 s without slip."""
    state = rig.fill(0.0, OIL)
    for _ in range(500):
        state = rig.advance(state, voltage, 0.0, 40.0, PERIOD, 10)
    return state


def compute_capacity(states: np.ndarray) -> np.ndarray:
    """M_C [Nm] by docs/rig.md, eq. 4 and 5."""
    return np.maximum(0.0, 10.8 * (2.35 + states["normal_force"] / AREA / BAR) - 25.1)


def count_turns(states: np.ndarray) -> int:
    """How often the direction of slip changes, rest not counted."""
    way = np.sign(states["slip_speed"])
    return int((np.diff(way[way != 0.0]) != 0.0).sum())


def assert_sticks(states: np.ndarray) -> None:
    for name in ("slip_speed", "acceleration"):
        assert (states[name] == 0.0).all(), name
    assert (states["clutch_torque"] == states["motor_torque"]).all()
    assert (states["angle"] == states["angle"][0]).all()


# --- what is applied --------------------------------------------------------------------------------------------------

HELD = make_rest_state()


@pytest.mark.parametrize("substeps", STEPS)
@pytest.mark.parametrize("case", range(10))
def test_plates_carry_exactly_what_is_applied_however_it_varies(case: int, substeps: int) -> None:
    random = np.random.default_rng(case)
    size, mean, hertz = random.uniform(0.1, 0.5), random.uniform(-0.45, 0.45), random.uniform(0.2, 30.0)
    jumps = random.uniform(-0.04, 0.04, 1000)
    most = compute_capacity(HELD.y)[0]
    torque = lambda t: most * (mean + size * np.sin(2 * np.pi * hertz * t) + jumps[int(t / PERIOD)])  # noqa: E731
    states = apply_torque(RIG, HELD, 1.36, torque, 1.0, substeps)
    assert_sticks(states)
    assert states["clutch_torque"] == pytest.approx([torque(k * PERIOD) for k in range(1000)], rel=1e-12)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_sudden_torque_just_below_the_capacity_moves_nothing(way: float) -> None:
    assert_sticks(apply_torque(RIG, HELD, 1.36, way * 0.999 * compute_capacity(HELD.y)[0], 0.2))


def test_sixty_seconds_of_hold_creep_by_nothing() -> None:
    state = HELD
    for _ in range(600):
        state = RIG.advance(state, 1.36, 100.0, 9.0, 0.1, 1000)
    assert state.read().angle == HELD.read().angle
    assert state.read().clutch_torque == 9.0


@pytest.mark.parametrize("substeps", STEPS)
def test_the_motor_s_speed_control_acts_on_plates_that_stick(substeps: int) -> None:
    state = HELD
    for k in range(100):  # 40 Nm/rad of 0.5 rad/s, and 4 Nm s/rad
        state = RIG.advance(state, 1.36, 0.5, 40.0, PERIOD, substeps)
        assert state.read().clutch_torque == pytest.approx(4.0 * 0.5 + 40.0 * 0.5 * (k + 1) * PERIOD, rel=1e-12)
        assert state.read().acceleration == 0.0


# --- friction that builds up at rest as well ---------------------------------------------------------------------------

LETTER = Rig(NOMINAL.with_values({"standstill.lag": 1.0}))


@pytest.mark.parametrize("substeps", STEPS)
def test_with_its_lag_friction_at_rest_builds_up_by_equation_6_9(substeps: int) -> None:
    """A sudden torque slides the plates at first: m = 1 - exp(-C t), and viscous friction."""
    begin = make_rest_state(LETTER)
    states = apply_torque(LETTER, begin, 1.36, 9.0, 0.01, substeps)
    sliding = states["slip_speed"] > 0.0
    assert sliding.all()
    m = 1.0 - np.exp(-69.0 * PERIOD * np.arange(1, 11))
    assert states["friction_state"] == pytest.approx(m, abs=1e-7)  # measured 5e-9


@pytest.mark.parametrize("substeps", STEPS)
def test_with_its_lag_plates_hold_what_comes_slowly(substeps: int) -> None:
    states = apply_torque(LETTER, make_rest_state(LETTER), 1.36, lambda t: 8.0 * np.sin(2 * np.pi * t), 1.0, substeps)
    assert np.ptp(states["angle"]) < 1e-7  # rad, measured 2e-8: creep while a step of 0.05 Nm is built up
    assert states["clutch_torque"] == pytest.approx(states["motor_torque"], abs=1e-9)


# --- break-away -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("substeps", STEPS)
@pytest.mark.parametrize("voltage", [1.1, 1.36, 1.6])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_plates_break_away_at_their_capacity(way: float, voltage: float, substeps: int) -> None:
    states = apply_torque(RIG, make_rest_state(voltage=voltage), voltage, lambda t: way * 20.0 * t, 1.2, substeps)
    broken = int(np.argmax(np.abs(states["slip_speed"]) > BROKEN))
    assert broken > 0
    assert abs(states["motor_torque"][broken]) == pytest.approx(compute_capacity(states)[broken], rel=0.01)
    assert_sticks(states[: broken - 2])
    assert count_turns(states) == 0
    assert (way * np.diff(states["slip_speed"]) >= 0.0).all()
    assert way * states["friction_state"][broken] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("substeps", STEPS)
def test_plates_break_away_when_the_pressure_falls_and_not_before(substeps: int) -> None:
    states = apply_torque(RIG, HELD, lambda t: 1.36 - 0.2 * t, 5.0, 2.0, substeps)
    broken = int(np.argmax(states["slip_speed"] > BROKEN))
    assert compute_capacity(states)[broken] == pytest.approx(5.0, rel=0.01)
    assert_sticks(states[: broken - 2])


@pytest.mark.parametrize("volts_a_second", [0.1, 1.0, 100.0])
def test_more_pressure_changes_nothing_of_what_plates_carry(volts_a_second: float) -> None:
    states = apply_torque(RIG, HELD, lambda t: min(1.36 + volts_a_second * t, 2.0), -8.0, 1.0)
    assert_sticks(states)
    assert (states["clutch_torque"] == -8.0).all()
    assert states["normal_force"][-1] > states["normal_force"][0]


def test_a_sudden_loss_of_pressure_still_holds_what_it_can() -> None:
    states = apply_torque(RIG, HELD, lambda t: 1.36 if t < 0.1 else 1.2, 4.0, 1.0)
    assert compute_capacity(states)[-1] > 4.0
    assert_sticks(states)


SWINGS = 4  # turns of the slip when plates land: most of all loads, the same with steps of 1 us
TOGETHER = 3  # samples within which plates land with any step; measured 1
SWING = 3.0  # rad/s: half of 20 Nm for 14 ms on 0.05 kg m^2; 2.4 measured


# --- landing and turning ----------------------------------------------------------------------------------------------


@cache
def find_landing(load: float) -> int:
    """First sample of rest of a free inertia under `load` [Nm], with the finest steps."""
    states = apply_torque(RIG, RIG.fill(20.0, OIL), 1.36, load, 1.5, STEPS[-1])
    return int(np.flatnonzero(states["slip_speed"] != 0.0)[-1]) + 1


@pytest.mark.parametrize("substeps", STEPS)
@pytest.mark.parametrize("load", [-8.0, -1.0, 0.0, 5.0, 9.0])
def test_a_free_inertia_is_stopped_and_held(load: float, substeps: int) -> None:
    begin = RIG.fill(20.0, OIL)
    states = apply_torque(RIG, begin, 1.36, load, 1.5, substeps)
    # eq. 6.9 turns its friction within 1/C = 14 ms, not at once: the inertia swings back, by 14 ms of at most 20 Nm
    assert count_turns(states) <= SWINGS
    assert states["slip_speed"].min() > -SWING
    stopped = int(np.flatnonzero(states["slip_speed"] != 0.0)[-1]) + 1
    assert abs(stopped - find_landing(load)) <= TOGETHER
    assert_sticks(states[stopped:])
    assert (states["clutch_torque"][stopped:] == load).all()


def simulate_reversal(substeps: int) -> np.ndarray:
    """Slip turned slowly by the motor's speed control, 5 to -5 rad/s in 1 s."""
    state, states = RIG.fill(5.0, OIL), []
    for k in range(2000):
        speed = 5.0 - 10.0 * min(max(k * PERIOD - 0.5, 0.0), 1.0)
        state = RIG.advance(state, 1.36, speed, 40.0, PERIOD, substeps)
        states.append(state.y)
    return np.concatenate(states)


@pytest.mark.parametrize("substeps", STEPS)
def test_a_slow_reversal_turns_once_without_chatter(substeps: int) -> None:
    states = simulate_reversal(substeps)
    assert count_turns(states) == 1
    resting = np.flatnonzero(states["slip_speed"] == 0.0)
    assert resting.size > 50
    assert np.ptp(resting) == resting.size - 1, "one rest without a break"
    assert np.abs(np.diff(states["clutch_torque"][600:])).max() < 0.4  # Nm: 40 Nm/rad of 5 rad/s give 0.2 a sample


@pytest.mark.parametrize("substeps", STEPS[:-1])
@pytest.mark.parametrize(("swing", "hertz"), [(3.0, 1.0), (10.0, 2.5)])
def test_every_step_gives_the_same_turns(swing: float, hertz: float, substeps: int) -> None:
    """Slow and fast: plates that land early in coarse steps once were 5 Nm off."""

    def turned(steps: int) -> np.ndarray:
        state, states = RIG.fill(swing, OIL), []
        for k in range(2000):
            speed = swing * np.cos(2 * np.pi * hertz * k * PERIOD)
            state = RIG.advance(state, 1.36, speed, 40.0, PERIOD, steps)
            states.append(state.y)
        return np.concatenate(states)["clutch_torque"]

    assert np.sqrt(np.mean((turned(substeps) - turned(STEPS[-1])) ** 2)) < TURNED


def test_every_step_gives_the_same_reversal() -> None:
    fine = simulate_reversal(100)["clutch_torque"]
    for substeps in STEPS[:-1]:
        assert np.abs(simulate_reversal(substeps)["clutch_torque"] - fine).max() < CONVERGED


@pytest.mark.parametrize("substeps", STEPS)
@pytest.mark.parametrize("surplus", [1e-6, 1e-3, 0.1, 1.0])
def test_plates_that_creep_do_not_chatter(surplus: float, substeps: int) -> None:
    """The viscous part alone takes the surplus, at (surplus/C_v)^3 rad/s."""
    states = apply_torque(RIG, HELD, 1.36, compute_capacity(HELD.y)[0] + surplus, 1.0, substeps)
    assert count_turns(states) == 0
    assert (states["slip_speed"] >= 0.0).all()
    assert np.abs(states["clutch_torque"] - states["motor_torque"])[-500:].max() < 1e-3


@pytest.mark.parametrize("step", [1e-5, 1e-4, 1e-3, 4e-3])
def test_a_step_of_any_length_holds_the_same_torque(step: float) -> None:
    """The law alone, also at steps that are too long for the hydraulics."""
    random, held = np.random.default_rng(1), 0
    for _ in range(500):
        star, drag = random.uniform(2.7, 4.2) * BAR, random.uniform(0.5, 3.0)
        most = 10.8 * star / BAR - 25.1
        applied_nm, m = random.uniform(-1.3, 1.3) * most, random.uniform(-1.0, 1.0)
        signals = np.zeros(1, SIGNALS)[0]
        arguments = (applied_nm, INERTIA, star, drag, signals, RIG.record[0], None, step)
        share, slip, sticks = step_near_standstill(m, 0.0, *arguments)
        assert sticks == (abs(applied_nm) <= most)
        held += sticks
        if sticks:
            assert slip == 0.0
            assert share * most == pytest.approx(applied_nm, rel=1e-12)
            continue
        assert share == np.sign(applied_nm)
        viscous = (2.67 * star / BAR - 6.49) * drag * abs(slip) ** (1 / 3)
        assert slip * applied_nm > 0.0  # and it is the root of backward Euler
        assert viscous + abs(slip) * INERTIA / step == pytest.approx(abs(applied_nm) - most, rel=1e-6)
    assert 200 < held < 450


# --- effects ----------------------------------------------------------------------------------------------------------

MOVES = {"presliding", "backlash", "shaft_compliance"}  # they have a spring, or a gap, that moves


@pytest.mark.parametrize("effect", list(load_effects().values()), ids=lambda effect: effect.name)
def test_with_any_effect_plates_hold_without_chatter(effect: Effect) -> None:
    rig = Rig(NOMINAL.with_values(effect.list_typical_values()))
    begin = make_rest_state(rig)
    states = apply_torque(rig, begin, 1.36, lambda t: 6.0 * np.sin(2 * np.pi * t), 2.0)
    assert np.isfinite(states.view(np.float64)).all()
    if effect.name not in MOVES:
        assert_sticks(states)
    elif effect.name == "shaft_compliance":
        assert (states["slip_speed"] == 0.0).all()
        assert np.abs(states["clutch_torque"] - states["motor_torque"]).max() < 1.0  # the motor swings on the shaft
    assert count_turns(states) <= 20  # the gap of 0.02 rad closes with blows, and the spring swings when it begins


@pytest.mark.parametrize(
    ("changed", "beside"),
    [({"residual_torque.offset": 1.5}, 1.5), ({"position_ripple.amplitude": 2.0, "position_ripple.phase": 0.5}, 1.755)],
)
def test_a_torque_beside_the_friction_is_carried_too(changed: Mapping[str, float], beside: float) -> None:
    rig = Rig(NOMINAL.with_values(changed))
    begin = make_rest_state(rig)
    states = apply_torque(rig, begin, 1.36, lambda t: 15.0 * t, 1.2)
    broken = int(np.argmax(states["slip_speed"] > BROKEN))
    assert_sticks(states[: broken - 2])
    assert states["motor_torque"][broken] == pytest.approx(compute_capacity(states)[broken] + beside, rel=0.01)


def test_a_twisted_shaft_swings_against_plates_that_stick_at_its_clamped_frequency() -> None:
    rig = Rig(NOMINAL.with_values({"shaft_compliance.compliance": 3e-3, "shaft_compliance.damping": 0.01}))
    c, share = rig.record[0], NOMINAL["shaft_compliance.share"].value
    states = apply_torque(rig, make_rest_state(rig), 1.36, 5.0, 0.5, 100)
    assert (states["slip_speed"] == 0.0).all()
    swing = states["clutch_torque"] - 5.0
    crossings = np.flatnonzero(np.diff(np.sign(swing)) != 0)
    hertz = 0.5 * (crossings.size - 1) / ((crossings[-1] - crossings[0]) * PERIOD)
    expected = 1.0 / (2 * np.pi * np.sqrt(3e-3 * (1.0 - share) * c["motor_inertia"]))
    assert hertz == pytest.approx(expected, rel=0.02)


# --- phase ------------------------------------------------------------------------------------------------------------


def test_plates_that_stick_are_told_so() -> None:
    state = HELD
    for _ in range(5):
        state = RIG.advance(state, 1.36, 100.0, 2.0, PERIOD, 10)
        assert find_phase(state.read(), 1.7 * BAR, 2.35 * BAR) is Phase.STICK
    assert find_phase(RIG.advance(state, 1.36, 100.0, 40.0, 0.1, 1000).read(), 1.7 * BAR, 2.35 * BAR) is Phase.SLIP
