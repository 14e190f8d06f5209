"""The closed loop in one process: it follows, it adapts, it stays safe."""

from typing import Any

import numpy as np
import pytest

from clutch_hil.bench.in_process import Played, play
from clutch_hil.bench.judgement.following import judge_following
from plant_sim.node.injection import Injection, switch_on
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import Profile, load_profile
from plant_sim.rigs import wet_clutch
from protocols.can.claim import make_claim_session
from protocols.can.frames import Frame, load_frames
from protocols.can.reception import INTRUSION, INTRUSION_PERIODS, WRONG_RATES
from protocols.errors import InputError
from rt_controller.law.phases import Fault
from rt_controller.loop.cycle_record import RECORD
from tests.clutch_hil.bench.timing.interference import (
    controller_node,
    make_interference,
    play_restart,
    play_undisturbed,
    play_with_changes,
)

CLOSED_BAR = 0.5  # bar: what is left in the cylinder 0.3 s after the valve closed; the springs act from 1.7 bar
FRAMES = load_frames()

STEADY = Profile("steady", (0.0, 0.2, 0.5, 3.0), (0.0, 0.0, 10.0, 10.0), (10.47,) * 4)


def read_valve(frames: list[Frame]) -> tuple[int, float]:
    """Enable and voltage of the valve command among frames."""
    codec = FRAMES["VALVE_COMMAND"]
    values = next(codec.unpack(data) for can_id, data in frames if can_id == codec.can_id)
    return values.valve_enable, values.valve_voltage


def test_the_torque_follows_the_demand() -> None:
    result = play_undisturbed(STEADY)
    assert result.judge_following().regime_error < 0.15  # Nm; 0.1 measured, spring share of 0.14 Nm included
    assert result.judge_following().rise_time < 0.35  # s, of a ramp of 0.3 s and the fill


def test_the_run_goes_through_its_phases_in_order() -> None:
    phase = play_undisturbed(load_profile("engagement"))["controller_phase"]
    assert list(phase[np.flatnonzero(np.diff(phase, prepend=-1.0))]) == [0, 1, 2, 3, 0]


def test_two_plays_are_the_same_to_the_bit() -> None:
    one, other = play_undisturbed(STEADY), play_undisturbed(STEADY)
    assert np.array_equal(one.plant, other.plant)
    assert np.array_equal(one.controllers[0], other.controllers[0])


@pytest.mark.parametrize(("rate", "seconds"), [(1000, 1.9), (1000, 1.9004), (250, 1.9)])
@pytest.mark.parametrize("fault", [{}, {"frame_loss.samples": 0.3}], ids=["clear bus", "lossy bus"])
def test_many_cycles_in_a_compiled_call_are_those_one_by_one(
    rate: int, seconds: float, fault: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the rig changes, along a ramp, with an effect that comes and goes, beside faults of the bus."""
    changes = [
        Injection(switch_on("piston_seal_friction"), at=0.7, ramp=0.2, until=1.4),
        Injection({"oil.sump_temperature": 80.0}, at=1.1),
        *([Injection(fault, at=0.9, until=1.0)] if fault else []),
    ]

    def play_changing() -> tuple[Played, list[int]]:
        plant = PlantNode(rate, profile=load_profile("engagement", seconds), injections=changes)
        ticks = list[int]()
        return play(plant, controller_node(rate=rate), progress=ticks.append), ticks

    at_once = play_changing()
    monkeypatch.setattr(PlantNode, "steady", False)
    one_by_one = play_changing()
    assert at_once[1] == one_by_one[1] == list(range(0, len(at_once[0].plant), 500))
    for a, b in ((at_once[0].plant, one_by_one[0].plant), (at_once[0].controllers[0], one_by_one[0].controllers[0])):
        np.testing.assert_array_equal(a, b)


def test_the_controller_never_uses_the_torque_sensor() -> None:
    blind, _ = play_with_changes(make_interference(clutch_torque=12345), STEADY)
    assert np.array_equal(blind.controllers[0], play_undisturbed(STEADY).controllers[0])


@pytest.mark.parametrize("kept", [4, 5])
def test_sensors_stale_for_more_than_five_cycles_close_the_valve(kept: int) -> None:
    """`kept` cycles without a sample while the clutch slips; the sample after more than 3 is not used, for its counter."""
    result, sent = play_with_changes(lambda tick, frames: [] if 2000 <= tick < 2000 + kept else frames, STEADY)
    enabled, voltage = read_valve(sent[2000 + kept])
    assert (enabled, voltage > 0.0) == ((1, True) if kept == 4 else (0, False))
    assert result["controller_fault"][-1] == (0 if kept == 4 else 1)
    if kept == 5:
        assert result["truth_cylinder_pressure_bar"][2300] < CLOSED_BAR


def test_a_fault_is_left_only_through_idle() -> None:
    profile = Profile(
        "twice", (0.0, 0.3, 1.0, 1.1, 1.5, 1.8, 2.5), (0.0, 10.0, 10.0, 0.0, 0.0, 10.0, 10.0), (10.0,) * 7
    )
    off = Profile("off", (0.0, 0.1), (0.0, 0.0), (10.0, 10.0))
    codec = FRAMES["TORQUE_SETPOINT"].bind(make_claim_session(1))  # as the plant, whose session is 1

    def with_gap(tick: int, frames: list[Frame]) -> list[Frame]:
        if 600 <= tick < 620:
            return []
        if 1100 <= tick < 1500:  # the supervisor asks for idle
            idle = Frame(codec.can_id, codec.pack(tick, 0, *off.interpolate(0.0)[1:]))
            return [idle if frame.can_id == codec.can_id else frame for frame in frames]
        return frames

    result, _ = play_with_changes(with_gap, profile)
    phase = result["controller_phase"]
    assert (phase[650:1099] == 4).all()
    assert phase[1400] == 0
    assert phase[-1] == 2


def test_a_lost_supervisor_releases_the_clutch() -> None:
    setpoint = FRAMES["TORQUE_SETPOINT"].can_id
    result, _ = play_with_changes(lambda t, frames: [f for f in frames if t < 1500 or f.can_id != setpoint], STEADY)
    assert result["controller_phase"][1590] == 2  # within the time-out of 0.1 s
    assert result["controller_phase"][1610] == 3
    assert result["truth_cylinder_pressure_bar"][2000] < CLOSED_BAR
    assert result["controller_fault"].max() == 0


def test_an_empty_supply_is_a_fill_time_out() -> None:
    parameters = wet_clutch.load_nominal().with_values({"valve.gain": 0.5})  # bar/V: a fifth of the pressure asked for
    result = play(PlantNode(profile=STEADY, parameters=parameters), controller_node())
    assert result["controller_fault"][-1] == 5
    assert result["valve_voltage_v"][-1] == 0.0


def test_a_lost_pressure_signal_is_a_fault_before_the_torque_runs_away() -> None:
    """From 2 s on the pressure reads 0 with valid frames: both loops would ask for all there is."""
    result, _ = play_with_changes(make_interference(since=2000, noise=1, cylinder_pressure=0), STEADY)
    assert result["controller_fault"][-1] == Fault.PRESSURE_LOST
    assert result["truth_clutch_torque_nm"].max() < 13.0  # Nm, of 10 asked; 33 without the check
    assert result["truth_cylinder_pressure_bar"][-1] < CLOSED_BAR


@pytest.mark.parametrize(("noise", "fault"), [(0, Fault.SENSOR_FROZEN), (1, Fault.TORQUE_IMPLAUSIBLE)])
def test_a_pressure_signal_that_sticks_low_is_a_fault(noise: int, fault: int) -> None:
    """The signal stands at 2.5 bar, while more is asked for; with noise on it, the torque contradicts it."""
    stuck = round(2.5 / 0.0048828125)
    result, _ = play_with_changes(make_interference(since=1000, noise=noise, cylinder_pressure=stuck), STEADY)
    assert result["controller_fault"][-1] == fault
    assert result["truth_cylinder_pressure_bar"][-1] < CLOSED_BAR


def test_a_controller_that_slept_does_not_throw_the_torque_up() -> None:
    """0.3 s without commands: the plant closes its valve; then the clutch is open, and the controller knows."""
    plant, controller = PlantNode(profile=STEADY), controller_node()
    inbox: list[Frame] = []
    missed: list[Frame] = []
    torque = []
    while not plant.finished:
        frames = plant.step(inbox)
        torque.append(plant.make_row()[[column.name for column in plant.columns].index("truth_clutch_torque_nm")])
        missed += frames
        if 1500 <= plant.tick < 1800:
            inbox = []
            continue
        inbox = controller.step(missed, slots=301 if plant.tick == 1800 else 1)
        missed = []
    assert max(torque[1800:]) < 11.0  # Nm, of 10 asked
    assert controller.make_row()[3] == 6


@pytest.mark.parametrize("stall", [10, 30, 80])
def test_a_machine_that_stands_still_is_no_fault_of_the_rig(stall: int) -> None:
    """Again and again for `stall` periods: their samples come at once when it goes on, and nobody could answer them."""
    plant, controller = PlantNode(profile=STEADY), controller_node()
    inbox: list[Frame] = []
    torque = []
    while not plant.finished:
        slept = stall if plant.tick > 300 and plant.tick % 500 < stall else 0
        plant.receive(inbox)
        plant.skip_periods(slept)
        frames = []
        for _ in range(1 + slept):
            frames += plant.sample()
            plant.advance()
            torque.append(plant.make_row()[[column.name for column in plant.columns].index("truth_clutch_torque_nm")])
        inbox = controller.step(frames, slots=1 + slept)
        assert controller.make_row()[3] == 0, plant.tick
    assert max(torque[1000:]) < 11.0  # Nm, of 10 asked
    assert min(torque[1000:-stall]) > 9.0


def test_a_restarted_controller_does_not_engage_in_the_middle_of_a_demand() -> None:
    assert play_restart(STEADY, at=1500)[2] == 0


def test_a_standing_clutch_does_not_wind_up() -> None:
    still = Profile("still", STEADY.time, STEADY.torque, (0.0,) * 4)
    result = play_undisturbed(still)
    assert result["truth_cylinder_pressure_bar"].max() < 3.5  # bar: feedforward and P alone
    assert result["controller_fault"].max() == 0


def test_the_motor_stands_until_a_sample_has_been_believed() -> None:
    def corrupt(tick: int, frames: list[Frame]) -> list[Frame]:
        return [Frame(i, bytes((d[0] ^ 1,)) + d[1:]) if i == 0x100 else Frame(i, d) for i, d in frames]

    result, sent = play_with_changes(corrupt, STEADY)
    assert read_valve(sent[-1]) == (0, 0.0)
    assert result["motor_speed_demand_rad_s"][10:].max() == 0.0


def test_corrupt_frames_are_refused_and_counted() -> None:
    def flipped(tick: int, frames: list[Frame]) -> list[Frame]:
        return [Frame(i, d[:-1] + bytes((d[-1] ^ 1,))) if tick % 10 == 3 else Frame(i, d) for i, d in frames]

    result, _ = play_with_changes(flipped, STEADY)
    assert result["controller_fault"].max() == 0
    assert result.judge_following().regime_error < 0.2  # Nm: one sample of ten is missing


def test_strange_frames_among_the_others_change_nothing() -> None:
    """In every cycle: short, empty, with a wrong CRC; now and then one of a controller."""
    valve = FRAMES["VALVE_COMMAND"]

    def disturbed(tick: int, frames: list[Frame]) -> list[Frame]:
        strays = [Frame(0x100, b"\0" * 7), Frame(0x101, b"\1" * 8), Frame(0x701, b"")]
        if tick in (150, 350, 351, 550):
            strays.append(Frame(0x080, valve.pack(tick // 200, 1, 1.0, 0)))
        return [*strays, *frames]

    result, sent = play_with_changes(disturbed, STEADY)
    _, expected = play_with_changes(lambda tick, frames: frames, STEADY)
    assert sent == expected
    assert result["controller_fault"].max() == 0


def read_fault(node: Any) -> int:
    return int(node.record.view(RECORD)[0]["fault"])


def test_a_second_controller_is_a_fault_until_it_is_gone_and_idle_is_asked() -> None:
    valve = FRAMES["VALVE_COMMAND"]
    node = controller_node()
    for n in range(INTRUSION - 1):
        node.step([Frame(0x080, valve.pack(n, 1, 1.0, 0))])
    assert read_fault(node) == Fault.NONE
    node.step([Frame(0x080, valve.pack(INTRUSION - 1, 1, 1.0, 0))])
    assert read_fault(node) == Fault.SECOND_SENDER
    assert node.first_rejected == "a second controller is on the bus: it sends VALVE_COMMAND (0x080)"
    idle = [Frame(0x180, FRAMES["TORQUE_SETPOINT"].pack(n)) for n in range(INTRUSION_PERIODS + 2)]
    for frame in idle[:-2]:
        node.step([frame])
    assert read_fault(node) == Fault.SECOND_SENDER, "1000 periods have not passed"
    for frame in idle[-2:]:
        node.step([frame])
    assert read_fault(node) == Fault.NONE


def test_two_rates_on_one_bus_are_refused_before_a_run_and_a_fault_in_it() -> None:
    node = controller_node()
    node.step([])
    heartbeats = [Frame(0x701, FRAMES["PLANT_HEARTBEAT"].pack(n, 1, 500, 7)) for n in range(WRONG_RATES)]
    node.step(heartbeats[:-1])
    assert read_fault(node) == Fault.NONE
    node.step(heartbeats[-1:])
    assert read_fault(node) == Fault.WRONG_RATE
    assert node.first_rejected == "the plant runs at 500 Hz, this controller at 1000 Hz: give both one rate"
    with pytest.raises(InputError, match="plant runs at 500 Hz, this controller at 1000 Hz"):
        controller_node().step(heartbeats[:1])  # before a run one is enough


def test_the_valve_closes_when_commands_stop() -> None:
    plant, controller = PlantNode(profile=STEADY), controller_node()
    inbox: list[Frame] = []
    for _ in range(1500):
        inbox = controller.step(plant.step(inbox))
    for _ in range(300):
        plant.step([])
    assert plant.make_row()[1] == 0.0  # V
    assert plant.make_row()[3] < CLOSED_BAR


def test_the_safe_frames_close_the_valve_and_stop_the_motor() -> None:
    plant, controller = PlantNode(profile=STEADY), controller_node()
    inbox: list[Frame] = []
    for _ in range(1500):
        inbox = controller.step(plant.step(inbox))
    plant.step(inbox)
    plant.step(controller.list_safe_frames())
    assert plant.make_row()[1:3] == (0.0, 0.0)
    assert all(counts["lost"] == counts["repeated"] == 0 for counts in plant.count_receptions().values())


@pytest.mark.parametrize("rate", [250, 500, 2000, 4000])
def test_the_loop_works_at_other_rates(rate: int) -> None:
    result = play(PlantNode(rate=rate, profile=STEADY), controller_node(rate=rate))
    assert result.judge_following().regime_error < 0.2  # Nm


def test_following_is_judged_as_the_thesis_does() -> None:
    time = np.arange(0.0, 2.0, 0.001)
    demand = np.where(time < 0.5, 0.0, 10.0)
    torque = np.where(time < 0.5, 0.0, 10.0 * (1.0 - np.exp(-(time - 0.5) / 0.1)))
    rise = 0.1 * np.log(10.0)  # s: a first-order lag reaches 90 % after tau ln 10
    error = 10.0 * 0.1 * (np.exp(-rise / 0.1) - np.exp(-1.5 / 0.1)) / (1.5 - rise)
    result = judge_following(time, demand, torque)
    assert result.rise_time == pytest.approx(rise, abs=0.0011)  # one sample
    assert result.regime_error == pytest.approx(error, rel=0.01)


def test_a_torque_that_never_arrives_has_no_rise_time() -> None:
    time = np.arange(0.0, 1.0, 0.001)
    assert np.isnan(judge_following(time, np.full_like(time, 10.0), np.full_like(time, 8.9))).all()
