"""Faults are told where they happen: time, name, reason and measured values; and how many, at the end."""

import signal
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.bench.in_process import play
from clutch_hil.live.driving.demand import make_pressure_profile, make_torque_profile
from clutch_hil.live.monitor.collector import Collector
from clutch_hil.live.recording.recorder import Recorder
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import Profile, load_profile
from protocols.buses.bus import open_bus
from protocols.can.fault_text import REASONS, WAITS_FOR_IDLE, FaultWatch, waits_for_idle, watch_run
from protocols.can.frames import load_frames
from protocols.can.request import Request
from protocols.node import load_node
from protocols.realtime.beat import TIMING
from protocols.telemetry.batch import Batch, list_run_columns
from rt_controller.law.phases import Fault, Phase
from rt_controller.loop.node import COLUMNS, ControllerNode
from rt_controller.loop.parameter_sets import load_controller_parameters, load_shipped_parameters
from tests.clutch_hil.bench.test_services import RATE, await_frame
from tests.processes import ONE_CPU, PATIENCE, await_file, service

NAMES = [column.name for column in COLUMNS]


def make_row(**values: float) -> np.ndarray:
    return np.array(
        [[{"sample_tick": 2500.0}.get(name, 0.0) if name not in values else values[name] for name in NAMES]]
    )


def test_every_fault_has_its_reason_and_a_limit_that_exists() -> None:
    names = {fault.name.lower().replace("_", " ") for fault in Fault if fault is not Fault.NONE}
    assert set(REASONS) == names
    assert set(load_frames()["CONTROLLER_STATUS"].list_choices("fault").values()) == names | {"none"}
    parameters = load_shipped_parameters()
    assert all(parameters[reason.limit].unit == reason.unit for reason in REASONS.values() if reason.limit)
    without_limit = {name for name, reason in REASONS.items() if not reason.limit}
    assert without_limit == {"second sender", "wrong rate"}


@pytest.mark.parametrize("fault", [fault for fault in Fault if fault is not Fault.NONE])
def test_a_fault_is_told_once_with_time_reason_and_values(fault: Fault) -> None:
    watch = FaultWatch(NAMES, 250.0, {name: p.value for name, p in load_shipped_parameters().items()})
    came = make_row(fault=fault.value, sample_age=6.0, pressure_bar=3.41, slip_rad_s=20.1)
    (sentence,) = watch.take(np.concatenate([make_row(), came, came]))
    assert sentence.line.startswith(f"fault at 10.02 s: {fault.name.lower().replace('_', ' ')}: ")
    assert ("(limit " in sentence.line) is (fault not in (Fault.SECOND_SENDER, Fault.WRONG_RATE))
    assert "pressure 3.41 bar" in sentence.line
    assert "slip 20.10 rad/s" in sentence.line
    assert watch.take(came) == []
    (cleared,) = watch.take(make_row(sample_tick=2600.0))
    assert cleared.line == "cleared at 10.40 s"
    assert watch.verdict == sentence.line
    watch.take(came)
    assert watch.verdict == f"2 faults, the first: {sentence.line}"


@pytest.mark.parametrize("blocks", [[0, 3], [0, 1, 3], [0, 2, 3]])
def test_what_was_demanded_and_estimated_is_told_from_before_the_reaction(blocks: list[int]) -> None:
    before = {"sample_tick": 2499.0, "pressure_demand_bar": 3.41, "torque_estimate_nm": 15.78, "pressure_bar": 3.4}
    rows = np.concatenate(
        [
            make_row(),
            make_row(**before, observed_torque_nm=4.8),
            make_row(fault=Fault.TORQUE_IMPLAUSIBLE.value, pressure_bar=3.39, observed_torque_nm=4.85),
        ]
    )
    watch = FaultWatch(NAMES, RATE)
    (sentence,) = [fault for begin, end in pairwise(blocks) for fault in watch.take(rows[begin:end])]
    assert "torque seen at the motor, 4.85 Nm, and the estimate differ; pressure 3.39 bar, " in sentence.line
    assert "pressure demand 3.41 bar" in sentence.line
    assert "estimate 15.78 Nm" in sentence.line


def test_a_fault_that_this_version_does_not_know_is_told_by_its_number() -> None:
    """Of a controller of a newer version: who records or watches it goes on."""
    watch = FaultWatch(NAMES, RATE)
    (sentence,) = watch.take(np.concatenate([make_row(), make_row(fault=77.0, pressure_bar=2.0)]))[-1:]
    assert ": fault 77: this version does not know this fault; pressure 2.00 bar" in sentence.line
    (cleared,) = watch.take(make_row())
    assert cleared.name == "none"


def test_what_was_demanded_before_the_first_row_is_not_told() -> None:
    (sentence,) = FaultWatch(NAMES, RATE).take(make_row(fault=Fault.FILL_TIMEOUT.value, pressure_bar=2.0))
    assert "; pressure 2.00 bar, slip 0.00 rad/s" in sentence.line
    assert "pressure demand" not in sentence.line
    assert "estimate" not in sentence.line


@pytest.mark.parametrize(
    ("pressure", "why"),
    [
        (1.2, "the pressure fell while the clutch was closed (limit 1.5 bar)"),
        (
            3.01,
            "the pressure signal stayed constant while the clutch was closed, although its demand changed (limit 0.1 s)",
        ),
    ],
)
def test_a_pressure_that_stands_still_is_not_told_as_one_that_fell(pressure: float, why: str) -> None:
    came = np.concatenate(
        [make_row(pressure_bar=pressure, fault=fault.value) for fault in (Fault.NONE, Fault.PRESSURE_LOST)]
    )
    parameters = {name: p.value for name, p in load_shipped_parameters().items()}
    (sentence,) = FaultWatch(NAMES, RATE, parameters).take(came)
    assert f"pressure lost: {why}; " in sentence.line
    (sentence,) = FaultWatch(NAMES, RATE).take(came)
    assert "fell while the clutch was closed, or its signal stayed constant" in sentence.line, (
        "without the limit it may be either"
    )
    falls = np.concatenate([make_row(pressure_bar=pressure + 0.1), came[1:]])
    (sentence,) = FaultWatch(NAMES, RATE).take(falls)
    assert "pressure lost: the pressure fell while the clutch was closed; " in sentence.line


def test_a_frozen_pressure_is_told_as_frozen(tmp_path: Path) -> None:
    path = tmp_path / "frozen.toml"
    path.write_text('title = "frozen"\n[run]\nprofile = "engagement"\n[[inject]]\nat = 2.0\nfreeze = "pressure"\n')
    run = ch.simulate(path)
    watch = watch_run(run.columns, run.metadata["sample_rate_hz"], run.metadata["controller_parameters"])
    assert watch.first
    assert "the pressure signal stayed constant" in watch.first.line
    at = int(np.flatnonzero(run.columns["controller_fault"])[0])
    for column, text in (
        ("pressure_demand_bar", "pressure demand {:.2f} bar"),
        ("torque_estimate_nm", "estimate {:.2f} Nm"),
    ):
        value = run.columns[f"controller_{column}"][at - 1]
        assert value > 1.0
        assert text.format(value) in watch.first.line


def test_a_controller_keeps_the_first_fault_though_nobody_reads_its_record() -> None:
    controller = ControllerNode(RATE)
    play(PlantNode(rate=RATE, profile=load_profile("engagement", 1.0)), controller)
    assert controller.watch_faults().count == 0
    demand = controller.record[NAMES.index("pressure_demand_bar")]
    assert demand > 2.0
    for _ in range(8):
        controller.step([])  # no sample comes
    faults = controller.watch_faults()
    assert faults.count == 1
    assert faults.first
    assert faults.first.line.startswith("fault at 1.0")
    assert "stale sensors: no plausible sample for 6 cycles (limit 5 cycles)" in faults.first.line
    assert f"pressure demand {demand:.2f} bar" in faults.first.line


def make_batch(node: str, rows: np.ndarray, first: int = 0) -> Batch:
    columns = list_run_columns(node, [*COLUMNS, *TIMING])
    timing = np.zeros((len(rows), len(TIMING)))
    return Batch(node, 1, first, RATE, 0.0, 0, columns, np.concatenate([rows, timing], axis=1))


@pytest.mark.parametrize(("node", "whose"), [("controller", ""), ("controller_b", " of clutch b")])
def test_a_monitor_and_a_recorder_tell_the_fault_of_either_clutch(node: str, whose: str) -> None:
    came = make_row(fault=Fault.OVERPRESSURE.value, phase=Phase.FAULT.value, pressure_bar=5.6)
    collector = Collector("bench")
    collector.alive = dict.fromkeys(("controller", "controller_b"), True)
    for other in ("controller", "controller_b"):
        collector.take([make_batch(other, make_row())], 0.0)
    assert collector.make_snapshot(0.0).standing_faults == []
    collector.take([make_batch(node, came, 1)], 0.1)
    snapshot = collector.make_snapshot(0.1)
    (line,) = snapshot.standing_faults
    assert line.startswith(f"fault{whose} at 10.00 s: overpressure: ")
    assert snapshot.last_fault == line
    assert line in snapshot.list_troubles()
    collector.take([make_batch(node, make_row(), 2)], 0.2)
    assert collector.make_snapshot(0.2).last_fault == f"{line}; cleared{whose.replace('of', 'for')} at 10.00 s"
    assert collector.make_snapshot(0.2).standing_faults == []

    sentence: list[str] = []
    recorder = Recorder(
        None, ScriptedFeed([[make_batch(node, np.concatenate([make_row(), came]))]]), None, False, sentence.append
    )
    recorder.step(plant=False)
    assert sentence == [line]


def test_a_run_of_two_clutches_tells_the_faults_of_both() -> None:
    came = np.concatenate([make_row(), make_row(fault=Fault.OVERPRESSURE.value)])
    columns = {f"{node}_{name}": came[:, i] for node in ("controller", "controller_b") for i, name in enumerate(NAMES)}
    for clutch in "ab":
        sentence = watch_run(columns, RATE, {}, clutch)
        assert sentence.verdict.startswith(f"fault of clutch {clutch} at ")
        assert sentence.stands


class ScriptedFeed:
    """What comes, look by look."""

    bench = "bench"
    rejections = ""

    def __init__(self, script: list[list[Batch]]) -> None:
        self._script, self.alive, self.lost = script, dict[str, bool](), dict[str, int]()

    def read(self) -> list[Batch]:
        return self._script.pop(0)

    def take_events(self) -> list[dict]:
        return []


@pytest.mark.parametrize("telemetry", ["--telemetry", "--no-telemetry"])
def test_a_bench_in_two_shells_tells_its_fault(local_bus: str, tmp_path: Path, telemetry: str) -> None:
    path = tmp_path / "run.parquet"
    common = ("--bus", local_bus, "--rate", str(RATE), *ONE_CPU, telemetry)
    with service("controller", *common) as controller, open_bus(local_bus) as port:
        with service("plant", *common, "--profile", "engagement") as plant:
            await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 2)
            if telemetry == "--telemetry":
                sentence = tmp_path / "told.txt"
                with (
                    sentence.open("w") as errors,
                    service("record", str(path), "--bus", local_bus, stderr=errors) as record,
                ):
                    await_file(tmp_path / "run.parquet.part")
                    plant.kill()
                    await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 4)
                    await_file(sentence, "fault at ")
                    record.send_signal(signal.SIGINT)
                    out, _ = record.communicate(timeout=PATIENCE)
                assert record.returncode == 1
                assert "no row lost; fault at " in out
            else:
                plant.kill()
                await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 4)
        controller.terminate()
        out, errors = controller.communicate(timeout=PATIENCE)
    assert controller.returncode == 1
    if telemetry == "--telemetry":
        assert "stale sensors: no plausible sample for 6 cycles (limit 5 cycles); pressure " in errors
    assert "verdict: controller stopped, valve closed; fault at " in out
    assert " cycles, late " in out  # its timing


def test_a_plant_ends_with_its_timing(local_bus: str) -> None:
    common = ("--bus", local_bus, "--rate", str(RATE), *ONE_CPU, "--no-telemetry")
    with service("plant", *common) as plant, service("controller", *common), open_bus(local_bus) as port:
        await_frame(port, "ANALOG_SENSORS", lambda sensors: True)
        plant.terminate()
        out, _ = plant.communicate(timeout=PATIENCE)
    assert plant.returncode == 0
    assert " cycles, late " in out
    assert "verdict: plant stopped after" in out


def from_csv(tmp_path: Path) -> Profile:
    path = tmp_path / "at_once.csv"
    path.write_text(
        "time_s,torque_demand_nm,motor_speed_demand_rad_s,pressure_demand_bar\n0,10,10,0\n1,10,10,0\n2,0,10,3\n"
    )
    return load_profile(str(path))


AT_ONCE = {
    "a torque": lambda folder: Profile("torque", (0.0, 1.5), (8.0, 8.0), (10.0, 10.0)),
    "a ramp of torque": lambda folder: make_torque_profile(8.0, 10.0, 1.5, 50.0),
    "a pressure": lambda folder: Profile("pressure", (0.0, 1.5), (0.0, 0.0), (10.0, 10.0), (3.0, 3.0)),
    "a ramp of pressure": lambda folder: make_pressure_profile(3.0, 10.0, 1.5, 5.0),
    "a CSV file": from_csv,
    "a repeated one": lambda folder: Profile("torque", (0.0, 1.0), (8.0, 8.0), (10.0, 10.0)).repeat_to(2.5),
}


@pytest.mark.parametrize("rate", [50, 250, 1000])
@pytest.mark.parametrize("kind", AT_ONCE)
def test_a_profile_whose_demand_is_there_at_once_engages(kind: str, rate: int, tmp_path: Path) -> None:
    profile = AT_ONCE[kind](tmp_path)
    played = play(PlantNode(rate=rate, profile=profile), load_node("controller")(rate=rate))
    assert played["controller_request"][0] == Request.IDLE
    assert Phase.FILL in played["controller_phase"]
    assert not played["controller_fault"].any()


def test_who_waits_for_idle_says_so() -> None:
    assert "request for idle" in WAITS_FOR_IDLE
    for request in (Request.ENGAGE, Request.PRESSURE, Request.LOCK):
        assert waits_for_idle(Phase.IDLE, request)
    for request in (Request.IDLE, Request.RELEASE):
        assert not waits_for_idle(Phase.IDLE, request)
    assert not waits_for_idle(Phase.FILL, Request.ENGAGE)


def test_parameters_of_the_table_are_the_controllers() -> None:
    assert {reason.limit for reason in REASONS.values() if reason.limit.startswith("phases.")} <= set(
        load_controller_parameters()
    )
