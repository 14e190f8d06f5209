"""The controller as a process, begun by clock, bus or pll: closed loop, every slot accounted for, overruns by policy."""

import json
import signal
import subprocess
import time
from pathlib import Path

import pytest

from protocols.realtime.ring import RingReader
from tests.processes import ONE_CPU, PATIENCE, list_errors, play_here, service

RATE = 250  # Hz: a hiccup of a shared machine is less than the guard's five cycles
SECONDS = 3.0  # s of closed loop


def wait_for_closed_loop(controller: subprocess.Popen[str], ring: Path) -> None:
    """Wait until the warm-up of a controller's loop, 50 ms, is over."""
    deadline = time.monotonic() + PATIENCE

    def wait(until: str) -> None:
        assert controller.poll() is None, f"the controller ended before {until}: {controller.communicate()[0]}"
        assert time.monotonic() < deadline, f"no {until}"
        time.sleep(0.05)

    while not ring.exists():
        wait("ring")
    reader, rows = RingReader(ring), 0
    while rows < 0.5 * RATE:
        wait("closed loop")
        rows += len(reader.read())


def run_controlled(bus: str, folder: Path, *arguments: str) -> dict:
    """The summary of a controller that has controlled a plant for SECONDS."""
    summary = folder / "summary.json"
    common = ("--bus", bus, "--rate", str(RATE), "--no-telemetry", *ONE_CPU)
    with (
        service("plant", *common, "--profile", "engagement") as plant,
        service("controller", *common, "--ring", str(folder / "ring"), "--summary", str(summary), *arguments) as loop,
    ):
        wait_for_closed_loop(loop, folder / "ring")
        time.sleep(SECONDS)
        loop.send_signal(signal.SIGTERM)
        loop.wait(PATIENCE)
        plant.terminate()
        plant.wait(PATIENCE)
    return json.loads(summary.read_text())


@pytest.mark.parametrize("trigger", ["clock", "bus", "pll"])
def test_every_slot_is_run_or_skipped_and_every_sample_counted(local_bus: str, tmp_path: Path, trigger: str) -> None:
    message = run_controlled(local_bus, tmp_path, "--trigger", trigger, "--spin-us", "50")
    timing, frames = message["timing"], message["frames"]["ENCODER"]
    assert message["trigger"] == trigger
    assert timing["slots"] == timing["cycles"] + timing["skipped"]
    assert timing["slots"] > 0.5 * SECONDS * RATE
    assert frames["lost"] == frames["corrupt"] == frames["repeated"] == 0
    # one sample a slot, but for those before the grid begins and after it ends
    assert abs(frames["received"] - timing["slots"]) <= 0.2 * RATE
    assert message["valve_closed"]
    taken = message["footprint"]
    assert (taken["collections"], taken["threads_begun"]) == (0, 0)
    if not message["not_available"]:  # with every right
        assert (taken["minor_faults"], taken["major_faults"]) == (0, 0)


def test_the_bench_can_be_begun_by_its_samples(local_bus: str, tmp_path: Path) -> None:
    arguments = ("--bus", local_bus, "--rate", str(RATE), "--seconds", "3", "--out", str(tmp_path), "--json")
    done = play_here("up", *arguments, "--trigger", "bus", "--spin-us", "20")
    assert done.returncode in (0, 1), done.stderr  # a stall of more than 20 ms is a fault, and no matter of this test
    message = json.loads(done.stdout)["controller"]
    assert message["trigger"] == "bus"
    assert message["timing"]["slots"] == message["timing"]["cycles"] + message["timing"]["skipped"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--trigger", "gps"), "error: trigger 'gps' is unknown; allowed are bus, clock, pll"),
        (("--trigger", "bus", "--lockstep"), "--trigger and --lockstep cannot be combined; lock-step has no clock"),
    ],
)
def test_a_bench_refuses_a_bad_pace(local_bus: str, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    done = play_here("up", "--bus", local_bus, "--out", tmp_path / "out", *arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert not list(tmp_path.rglob("*.parquet"))


def test_an_overrun_can_end_the_controller_with_the_valve_closed(local_bus: str, tmp_path: Path) -> None:
    """The controller is stopped for 0.1 s until it ends. A stall of the machine may end it before that."""
    common = ("--bus", local_bus, "--rate", str(RATE), "--no-telemetry", *ONE_CPU)
    with (
        service("plant", *common, "--profile", "engagement"),
        service("controller", *common, "--ring", str(tmp_path / "ring"), "--overrun", "fault") as loop,
    ):
        deadline = time.monotonic() + PATIENCE
        while loop.poll() is None and time.monotonic() < deadline:
            time.sleep(0.5)
            loop.send_signal(signal.SIGSTOP)  # does nothing to a process that has ended
            time.sleep(0.1)
            loop.send_signal(signal.SIGCONT)
        message, _ = loop.communicate(timeout=PATIENCE)
    assert loop.returncode == 1
    assert "cycles were missed, and the overrun policy is fault, valve closed" in message


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--trigger", "gps"), "error: trigger 'gps' is unknown; allowed are bus, clock, pll"),
        (("--overrun", "slip"), "error: overrun policy 'slip' is unknown; allowed are catch-up, fault, skip"),
        (("--spin-us", "900"), "error: spin of 900 us is not possible; allowed are 0 to 200 us"),
    ],
)
def test_a_bad_setting_is_one_sentence(local_bus: str, arguments: tuple[str, ...], sentence: str) -> None:
    done = play_here("controller", "--bus", local_bus, *arguments)
    assert (done.returncode, list_errors(done.stderr)) == (2, [sentence])
