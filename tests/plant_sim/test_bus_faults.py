"""Faults of the bus: what each does to frames, when it begins and ends, and that a bus without faults does nothing."""

from collections import Counter
from pathlib import Path

import pytest

from plant_sim.bus_faults.bus_fault import COMMANDS, SAMPLES
from plant_sim.bus_faults.catalogue import BUS_FAULTS, PARAMETERS
from plant_sim.effects.catalogue import load_effects
from plant_sim.node.disturbed_bus import DisturbedBus
from plant_sim.node.injection import Injection, switch_off, switch_on
from plant_sim.node.plant_node import PlantNode
from plant_sim.node.power_shift_node import PowerShiftNode
from plant_sim.profiles.profile import load_profile
from protocols.can.frames import Frame, load_frames
from protocols.errors import InputError

RATE = 1000
CODECS = load_frames()
VALVE, SETPOINT, ANALOG, BEAT = (
    CODECS[name] for name in ("VALVE_COMMAND", "TORQUE_SETPOINT", "ANALOG_SENSORS", "PLANT_HEARTBEAT")
)


def make_frames(tick: int) -> list[Frame]:
    """Two frames of a sample, whose counters are the tick."""
    return [
        Frame(VALVE.can_id, VALVE.pack(tick, 1, 2.0, tick % 8)),
        Frame(ANALOG.can_id, ANALOG.pack(tick, 1.0, 40.0, 5.0)),
    ]


def pass_ticks(ticks: int, direction: str, *injections: Injection) -> list[list[Frame]]:
    """What arrives in each of so many ticks, of two frames a tick."""
    bus = DisturbedBus(RATE, 1, list(CODECS.values()))
    bus.check(injections, 0.0)
    bus.plan(injections)
    way = bus.pass_commands if direction == COMMANDS else bus.pass_samples
    return [way(tick, make_frames(tick)) for tick in range(ticks)]


def inject(name: str, at: float = 0.0, until: float = float("inf"), ramp: float = 0.0, **values: float) -> Injection:
    return Injection(switch_on(name, values), at, ramp, until)


@pytest.mark.parametrize("together", [True, False])
def test_a_fault_within_another_returns_to_it(together: bool) -> None:
    """Whether they are planned together, as at a start, in whatever order, or one after the other while the plant runs."""
    longer, within = (
        inject("frame_delay", at=1.0, commands=20.0),
        inject("frame_delay", at=2.0, until=3.0, commands=40.0),
    )
    bus = DisturbedBus(RATE, 1, list(CODECS.values()))
    for part in ([within, longer],) if together else ([longer], [within]):
        bus.plan(part)
    changes = [(change.at, change.old, change.new) for change in bus.planned]
    assert changes == [(1.0, 0.0, 20.0), (2.0, 20.0, 40.0), (3.0, 40.0, 20.0)]


def test_a_bus_without_faults_passes_everything_on() -> None:
    assert pass_ticks(5, COMMANDS) == [make_frames(tick) for tick in range(5)]
    assert DisturbedBus(RATE, 1, []).is_clear(3.0)


@pytest.mark.parametrize("direction", [COMMANDS, SAMPLES])
@pytest.mark.parametrize("name", [name for name in BUS_FAULTS if f"{name}.{COMMANDS}" in PARAMETERS])
def test_a_fault_of_one_direction_leaves_the_other_alone(name: str, direction: str) -> None:
    values = {p.name: p.typical for p in BUS_FAULTS[name].parameters} | {COMMANDS: 0.0, SAMPLES: 0.0}
    strongest = PARAMETERS[f"{name}.{direction}"].bounds[1]
    fault = inject(name, **(values | {direction: strongest, **({"window": 4.0} if "window" in values else {})}))
    sent = [make_frames(tick) for tick in range(10)]
    assert pass_ticks(10, direction, fault) != sent
    assert pass_ticks(10, SAMPLES if direction == COMMANDS else COMMANDS, fault) == sent


def test_all_faults_at_once_and_at_their_bounds_end_no_plant() -> None:
    """Truncated frames reach the other faults, and a pressure is at the end of its range."""
    for end in (0, 1):
        values = {name: PARAMETERS[name].bounds[end] or 1.0 for name in PARAMETERS}
        values |= {f"{name}.{way}": 0.5 for name in ("frame_loss", "frame_truncation") for way in (COMMANDS, SAMPLES)}
        values |= {"frame_delay.commands": 0.0, "frame_delay.samples": 0.0, "frame_masquerade.claimed": float(end)}
        plant = PlantNode(profile=load_profile("engagement", 1.0), injections=[Injection(values)])
        for _ in range(400):
            plant.step([frame for tick in range(3) for frame in make_frames(tick)])


def test_a_fault_begins_and_ends_in_time() -> None:
    come = pass_ticks(20, COMMANDS, inject("frame_loss", at=0.005, until=0.012, commands=1.0))
    assert [bool(frames) for frames in come] == [not 5 <= tick < 12 for tick in range(20)]


def test_a_share_of_the_frames_is_lost() -> None:
    come = sum(map(len, pass_ticks(2000, COMMANDS, inject("frame_loss", commands=0.3))))
    assert 0.66 < come / 4000 < 0.74


def test_a_delay_keeps_the_order_and_loses_nothing() -> None:
    come = pass_ticks(30, COMMANDS, inject("frame_delay", commands=7.0))
    assert come[:7] == [[]] * 7
    assert come[7:] == [make_frames(tick) for tick in range(23)]


def test_a_delay_grows_along_its_ramp() -> None:
    """10 ms more in 100 ms."""
    come = pass_ticks(100, COMMANDS, inject("frame_delay", ramp=0.1, commands=10.0))
    counters = [VALVE.read_counter(frames[-2].data) for frames in come if frames]
    assert counters == sorted(counters)
    assert 99 - counters[-1] in (9, 10)


def test_after_bus_off_what_waits_in_the_queue_comes_first() -> None:
    fault = inject("bus_off", at=0.005, length=4.0, queue=3.0)
    for direction in (COMMANDS, SAMPLES):
        come = pass_ticks(12, direction, fault)
        assert [bool(frames) for frames in come] == [not 5 <= tick < 9 for tick in range(12)]
        assert come[9] == [*make_frames(5), make_frames(6)[0], *make_frames(9)]
        assert come[10] == make_frames(10)


def test_error_frames_come_before_the_others_with_the_flag_of_an_error_frame() -> None:
    come = pass_ticks(3, COMMANDS, inject("error_frames", commands=2.0))
    for tick, frames in enumerate(come):
        assert [frame.can_id >> 29 for frame in frames[:2]] == [1, 1]
        assert frames[2:] == make_frames(tick)


@pytest.mark.parametrize("after", [0, 1, 5])
def test_repeated_frames_come_at_once_or_later(after: int) -> None:
    come = pass_ticks(10, COMMANDS, inject("frame_repetition", commands=1.0, after=after))
    for tick, frames in enumerate(come):
        expected = Counter(make_frames(tick)) + (Counter(make_frames(tick - after)) if tick >= after else Counter())
        assert Counter(frames) == expected


def test_reordered_frames_come_after_those_of_the_next_sample() -> None:
    come = pass_ticks(10, COMMANDS, inject("frame_reordering", commands=1.0))
    assert come[0] == []
    assert come[1:] == [make_frames(tick) for tick in range(9)]


@pytest.mark.parametrize("renewed", [0, 1])
def test_a_window_is_sent_again(renewed: int) -> None:
    come = pass_ticks(12, COMMANDS, inject("frame_replay", commands=1.0, window=4.0, renewed=renewed))
    assert come[:4] == [make_frames(tick) for tick in range(4)]
    for tick in range(4, 12):
        (_, data), _ = come[tick]
        assert VALVE.is_valid(data)
        assert VALVE.unpack(data).sample_tick == tick % 4
        assert VALVE.read_counter(data) == (tick if renewed else tick % 4)


def test_a_burst_changes_at_most_its_length_and_never_nothing() -> None:
    come = pass_ticks(500, COMMANDS, inject("frame_corruption", commands=1.0, burst=5.0))
    for tick, frames in enumerate(come):
        for wrong, right in zip(frames, make_frames(tick), strict=True):
            changed = int.from_bytes(wrong.data, "little") ^ int.from_bytes(right.data, "little")
            assert wrong.can_id == right.can_id
            assert 1 <= (changed // (changed & -changed)).bit_length() <= 5


def test_truncated_frames_are_shorter() -> None:
    for frames in pass_ticks(50, SAMPLES, inject("frame_truncation", samples=1.0)):
        assert all(len(frame.data) < 8 for frame in frames)


def test_a_payload_comes_under_another_identifier_besides() -> None:
    for tick, frames in enumerate(pass_ticks(50, SAMPLES, inject("frame_misaddressing", samples=1.0))):
        assert frames[:2] == make_frames(tick)
        for right, wrong in zip(frames[:2], frames[2:], strict=True):
            assert wrong.data == right.data
            assert wrong.can_id != right.can_id


@pytest.mark.parametrize(("name", "known"), [("frame_insertion", True), ("bus_babbling", False)])
def test_other_senders_send_so_many_frames_a_sample(name: str, known: bool) -> None:
    ours = {codec.can_id for codec in CODECS.values()}
    for tick, frames in enumerate(pass_ticks(50, COMMANDS, inject(name, commands=7.0))):
        assert frames[7:] == make_frames(tick)
        assert all((frame.can_id in ours) == known for frame in frames[:7])


@pytest.mark.parametrize("ahead", [0, 1])
def test_a_masquerade_is_a_right_frame_with_other_content(ahead: int) -> None:
    come = pass_ticks(5, COMMANDS, inject("frame_masquerade", valve_voltage=9.9, ahead=ahead))
    for tick, frames in enumerate(come):
        forged = frames[-1 if ahead else 0]
        assert VALVE.is_valid(forged.data)
        assert VALVE.unpack(forged.data).valve_voltage == pytest.approx(9.9, abs=1e-3)
        assert VALVE.read_counter(forged.data) == tick + ahead
        assert [frame for frame in frames if frame is not forged] == make_frames(tick)


def test_heartbeats_tell_another_rate() -> None:
    bus = DisturbedBus(RATE, 1, list(CODECS.values()))
    bus.plan([inject("heartbeat_rate", rate=500.0)])
    ((_, data),) = bus.pass_samples(0, [Frame(BEAT.can_id, BEAT.pack(3, 2, RATE, 9))])
    assert BEAT.is_valid(data)
    assert (BEAT.unpack(data).rate, BEAT.read_counter(data)) == (500, 3)


@pytest.mark.parametrize("name", BUS_FAULTS)
def test_each_fault_can_be_switched_on_and_off_and_has_a_line_of_text(name: str) -> None:
    on, off = switch_on(name), switch_off(name)
    assert set(on) == set(off)
    assert all(on[strength] != off[strength] for strength in off)
    assert (BUS_FAULTS[name].__doc__ or "").partition("\n")[0].endswith(".")
    for frames in (pass_ticks(20, COMMANDS, Injection(on)), pass_ticks(20, SAMPLES, Injection(on))):
        assert len(frames) == 20


def test_no_fault_has_the_name_of_an_effect_or_of_a_group_of_parameters() -> None:
    groups = {name.partition(".")[0] for name in PlantNode().parameters}
    assert not set(BUS_FAULTS) & (set(load_effects()) | groups)


@pytest.mark.parametrize("node", [PlantNode, PowerShiftNode])
def test_a_plant_tells_planned_and_begun_faults_and_refuses_wrong_ones(node: type[PlantNode]) -> None:
    plant = node(injections=[inject("frame_loss", at=0.002, until=0.004, commands=1.0)])
    assert [change["name"] for change in plant.planned_changes] == ["frame_loss.commands"] * 2
    for _ in range(6):
        plant.step([])
    assert not plant.planned_changes
    assert [(change["old"], change["new"], change["row"]) for change in plant.injected_changes] == [
        (0, 1, 2),
        (1, 0, 4),
    ]
    with pytest.raises(InputError, match=r"frame_loss\.commands = 2 is outside 0..1"):
        plant.inject(inject("frame_loss", at=1.0, commands=2.0))
    with pytest.raises(InputError, match=r"too late: the rig is at 0\.006 s"):
        plant.inject(inject("frame_loss", at=0.001, commands=1.0))
    with pytest.raises(InputError, match="allowed are 256 in one run"):
        plant.inject(*(inject("frame_loss", at=1.0 + k, until=1.5 + k, commands=1.0) for k in range(200)))
    assert not plant.planned_changes
    plant.lockstep = True
    with pytest.raises(InputError, match="in lock-step each sample waits for its answer"):
        plant.inject(inject("frame_loss", at=1.0, commands=1.0))


def test_an_injection_of_rig_and_bus_is_taken_whole_or_not_at_all() -> None:
    plant = PlantNode()
    values = switch_on("internal_leakage") | switch_on("frame_delay", {"commands": 5.0})
    plant.inject(Injection(values, at=0.5))
    assert len(plant.planned_changes) == 2
    wrong = switch_on("internal_leakage") | {"frame_delay.commands": -1.0}
    with pytest.raises(InputError):
        plant.inject(Injection(wrong, at=0.6))
    assert len(plant.planned_changes) == 2


def test_the_compiled_loop_is_left_while_a_fault_acts() -> None:
    plant = PlantNode(
        profile=load_profile("engagement", 1.0), injections=[inject("frame_loss", at=0.1, until=0.2, commands=1.0)]
    )
    steady = []
    for _ in range(300):
        plant.step([])
        steady.append(plant.steady)  # of the sample that follows
    assert steady == [not 100 <= tick + 1 <= 200 for tick in range(300)]


def test_more_frames_than_a_sample_can_have_are_left_out() -> None:
    values = {"frame_insertion.samples": 100.0, "bus_babbling.samples": 100.0, "frame_repetition.samples": 1.0,
              "frame_misaddressing.samples": 1.0}  # fmt: skip
    plant = PlantNode(injections=[Injection(values)])
    counts = [len(plant.step([])) for _ in range(5)]
    assert all(200 < count <= len(plant.outbox) for count in counts)


def test_the_table_of_the_docs_has_every_fault_with_its_parameters() -> None:
    page = (Path(__file__).parents[2] / "docs" / "scenarios.md").read_text(encoding="utf-8")
    for fault in BUS_FAULTS.values():
        (row,) = (line for line in page.splitlines() if line.startswith(f"| `{fault.name}` "))
        units = [(p, "" if p.unit == "1" else f" {p.unit}") for p in fault.parameters]
        assert row.endswith(f"| {', '.join(f'`{p.name}` {p.typical:g}{unit}' for p, unit in units)} |")


def test_the_names_in_the_catalogue_are_those_of_the_parameters() -> None:
    assert {name.partition(".")[0] for name in PARAMETERS} == set(BUS_FAULTS)
    assert SETPOINT.name == "TORQUE_SETPOINT"
