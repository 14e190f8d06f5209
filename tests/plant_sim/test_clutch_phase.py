"""Phases of the clutch, determined from the rig's state."""

import numpy as np
import pytest

from clutch_hil.bench.in_process import play
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import Profile
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.clutch_phase import Phase, find_phase
from protocols.node import load_node

BAR = 1e5
PRELOAD, CONTACT = 1.7 * BAR, 2.35 * BAR
ORDER = [Phase.REST, Phase.FILL, Phase.TOUCH, Phase.SLIP, Phase.RELEASE, Phase.DRAIN, Phase.REST]


def simulate_states(pieces: list[tuple[float, float, int]], **changed: float) -> list[wet_clutch.State]:
    """States after every millisecond: voltage [V], speed demand [rad/s], cycles."""
    rig = wet_clutch.Rig(wet_clutch.load_nominal().with_values({k.replace("__", "."): v for k, v in changed.items()}))
    whole = rig.make_rest_state(pieces[0][1], 343.15)
    seen = []
    for voltage, speed, cycles in pieces:
        for _ in range(cycles):
            whole = rig.advance(whole, voltage, speed, 40.0, 1e-3, 10)
            seen.append(whole.read())
    return seen


def find_phases(seen: list[wet_clutch.State]) -> list[Phase]:
    return [find_phase(state, PRELOAD, CONTACT) for state in seen]


def list_passed(named: list[Phase]) -> list[Phase]:
    """Phases in the order in which they were passed."""
    return [one for k, one in enumerate(named) if k == 0 or one != named[k - 1]]


ENGAGEMENT = [(0.0, 10.47, 50), (1.36, 10.47, 500), (1.6, 10.47, 300), (0.0, 10.47, 500)]


@pytest.mark.parametrize("speed", [5.0, 10.47, 26.0])
@pytest.mark.parametrize("voltage", [1.0, 1.36, 1.6])
def test_an_engagement_passes_every_phase_once_and_in_order(voltage: float, speed: float) -> None:
    assert (
        list_passed(find_phases(simulate_states([(0.0, speed, 50), (voltage, speed, 700), (0.0, speed, 500)]))) == ORDER
    )


@pytest.mark.parametrize(
    "changed",
    [
        {"plate_waviness__height": 0.03},
        {"piston_seal_friction__force": 60.0},
        {"entrapped_air__volume": 1e-6},
        {"internal_leakage__conductance": 2e-6},
        {"drain_restriction__ratio": 0.3},
    ],
    ids=lambda changed: next(iter(changed)),
)
def test_effects_do_not_confuse_the_phases(changed: dict[str, float]) -> None:
    assert list_passed(find_phases(simulate_states(ENGAGEMENT, **changed))) == ORDER


def test_the_controllers_engagement_passes_every_phase_in_order() -> None:
    profile = Profile(
        "engage and release", (0.0, 0.2, 0.4, 1.2, 1.4, 1.8), (0.0, 0.0, 9.0, 9.0, 0.0, 0.0), (10.47,) * 6
    )
    node = PlantNode(1000, wet_clutch.load_nominal(), profile, 1, 70.0)
    played = play(node, load_node("controller")(rate=1000))
    rig = wet_clutch.Rig(wet_clutch.load_nominal())
    whole, named = rig.make_rest_state(10.47, 343.15), []
    inputs = zip(played["valve_voltage_v"].tolist(), played["motor_speed_demand_rad_s"].tolist(), strict=True)
    for voltage, speed in inputs:
        whole = rig.advance(whole, voltage, speed, 40.0, 1e-3, 10)
        named.append(find_phase(whole.read(), PRELOAD, CONTACT))
    assert list_passed(named) == ORDER


def test_phases_mean_what_they_say() -> None:
    seen = simulate_states(ENGAGEMENT)
    named = np.array(find_phases(seen))
    moved = np.array([state.position for state in seen])
    pressed = np.array([state.normal_force for state in seen]) > 0
    torque = np.array([state.clutch_torque for state in seen])
    assert (moved[named == Phase.REST] == 0.0).all()
    assert (np.diff(moved[named == Phase.FILL]) >= 0.0).all()
    assert (np.diff(moved[named == Phase.DRAIN]) <= 0.0).all()
    for one in (Phase.TOUCH, Phase.SLIP, Phase.RELEASE):
        assert pressed[named == one].all(), one
    for one in (Phase.REST, Phase.FILL, Phase.DRAIN):
        assert not pressed[named == one].any(), one
        assert (torque[named == one] == 0.0).all(), one
    assert 5 <= (named == Phase.TOUCH).sum() <= 20, "about a time constant of the friction, 12 ms"


def test_a_slip_speed_that_changes_does_not_leave_slip() -> None:
    seen = simulate_states([(1.36, 26.0, 500), (1.36, 0.5, 300), (1.36, 26.0, 300)])
    assert set(find_phases(seen)[300:]) == {Phase.SLIP}


def test_a_fill_that_is_given_up_drains_without_having_touched() -> None:
    assert list_passed(find_phases(simulate_states([(1.36, 10.47, 60), (0.0, 10.47, 400)]))) == [
        Phase.REST,
        Phase.FILL,
        Phase.DRAIN,
        Phase.REST,
    ]
