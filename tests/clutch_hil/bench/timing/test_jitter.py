"""`clutch-hil jitter`: what is late and whose fault it is, and the whole command on a real bench.

Nothing here bounds a duration: machines are shared. The report of the whole run is kept in runs/jitter-test.
"""

import json
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.bench.timing.command_latency import compute_latencies, watch_frames
from clutch_hil.bench.timing.echo import Echo
from clutch_hil.bench.timing.jitter_report import judge, judge_sweep, make_document, sweep_document, sweep_text
from clutch_hil.bench.timing.lateness import compute_shortest_spike, find_late_cycles, find_spikes, mark_explained
from clutch_hil.bench.timing.loads import LOADS, find_loads
from clutch_hil.bench.timing.measurements import Measurements, Setting, summarise
from clutch_hil.bench.timing.stalls import StallWatch
from clutch_hil.bench.timing.witness_loop import Pace, read
from protocols.can.frames import load_frames
from protocols.errors import InputError
from protocols.realtime import child
from tests.processes import list_errors, play_here

PERIOD = 1_000_000  # ns


def list_late(*at: float) -> np.ndarray:
    """Cycles that end a period after slots, in periods."""
    return np.array([[PERIOD * slot, PERIOD * (slot + 1.0)] for slot in at])


def test_a_late_cycle_near_a_spike_of_the_witness_is_the_machines() -> None:
    slots = PERIOD * np.arange(1000)
    ended = slots + 5_000
    ended[500] += 300_000
    seen = find_spikes(slots, ended, PERIOD)
    assert seen.tolist() == [[500 * PERIOD, 500 * PERIOD + 305_000]]
    result = mark_explained(list_late(300, 496.4, 496.6, 499, 501, 502.7, 502.9), seen, PERIOD)
    assert result.tolist() == [False, False, True, True, True, True, False]


def test_a_cycle_that_waited_for_a_stall_is_the_machines_however_late_it_began() -> None:
    """What was missed is made up for first, by the plant, which goes before the controller."""
    lost = np.array([[100.0, 170.0]]) * PERIOD
    assert mark_explained(np.array([[99.5, 175.0], [173.0, 175.0]]) * PERIOD, lost, PERIOD).tolist() == [True, False]


def test_what_is_usual_for_a_wake_up_explains_nothing() -> None:
    """At 4 kHz a tenth of a period would be 25 us, and every cycle near a spike."""
    assert [compute_shortest_spike(period) for period in (4_000_000, PERIOD, 250_000)] == [400_000, 100_000, 100_000]
    slots = 250_000 * np.arange(1000)
    assert len(find_spikes(slots, slots + 60_000, 250_000)) == 0


def test_slots_the_witness_itself_has_slept_through_are_spikes() -> None:
    slots = np.delete(PERIOD * np.arange(1000), [700, 701])
    seen = find_spikes(slots, slots + 5_000, PERIOD)
    assert seen.tolist() == [[700 * PERIOD, 702 * PERIOD]]
    assert mark_explained(list_late(699.5, 703.5, 704.6), seen, PERIOD).tolist() == [True, True, False]


def test_a_spike_lasts_until_the_witness_slept_again() -> None:
    slots = np.delete(PERIOD * np.arange(1000), range(501, 510))
    ended = slots + 5_000
    ended[500] += round(9.4 * PERIOD)
    result = mark_explained(list_late(496.0, 497.0, 505.0, 511.0, 513.0), find_spikes(slots, ended, PERIOD), PERIOD)
    assert result.tolist() == [False, True, True, True, False]


def test_a_short_spike_in_a_long_one_does_not_hide_it() -> None:
    lost = np.array([[10.0, 60.0], [20.0, 21.0]]) * PERIOD
    assert mark_explained(list_late(50.0, 70.0), lost, PERIOD).tolist() == [True, False]


def test_a_cycle_is_late_when_it_ends_after_its_slot_or_leaves_one_out() -> None:
    """One that only begins late is not: its slot is what it waited for."""
    slots = PERIOD * np.array([0, 1, 2, 3, 6, 7, 8, 9, 10])  # 4 and 5 are left out: the cycle of 3 began with them over
    counted = np.array([0, 0, 0, 0, 1, 1, 1, 1, 2])  # those of 3 and 9 ended late
    assert find_late_cycles(slots, counted, PERIOD).tolist() == [3, 7]
    assert find_late_cycles(slots, np.zeros(9), PERIOD).tolist() == [3]


def test_without_spikes_nothing_is_explained() -> None:
    slots = PERIOD * np.arange(100)
    nothing = find_spikes(slots, slots, PERIOD)
    assert nothing.shape == (0, 2)
    assert mark_explained(list_late(50.0), nothing, PERIOD).tolist() == [False]
    assert mark_explained(np.empty((0, 2)), nothing, PERIOD).tolist() == []


@pytest.mark.needs("real-time priority")
def test_a_watch_sees_what_keeps_it_from_the_cpu() -> None:
    """Here somebody above its priority who is busy for 60 ms; where the rights are missing, nothing can be told."""
    busy = (
        "import os, time; os.sched_setaffinity(0, {0}); os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(60))\n"
    )
    busy += "begin = time.monotonic_ns()\nwhile time.monotonic_ns() < begin + 60_000_000: pass\nprint(begin)"
    with StallWatch(0, 50, 250_000, 31_000, 30.0) as watch:
        time.sleep(0.2)
        done = subprocess.run([sys.executable, "-c", busy], capture_output=True, text=True, check=False)
        time.sleep(0.2)
    assert done.returncode == 0, done.stderr
    begin, seen = int(done.stdout), watch.list_stalls(20_000_000.0)
    assert ((seen[:, 0] - 31_000) % 250_000 == 0).all()
    hidden = (seen[:, 0] >= begin) & (seen[:, 0] <= begin + 1_000_000) & (seen[:, 1] >= begin + 60_000_000)
    assert hidden.any()
    assert len(watch.list_stalls(1e12)) == 0


def test_percentiles_are_told_only_where_there_are_enough_cycles() -> None:
    values = np.arange(1.0, 5001.0)
    assert set(summarise(values)) == {"p50", "p99", "p99.9", "max"}
    assert summarise(values)["p50"] == pytest.approx(2500.5)
    assert set(summarise(values[:100])) == {"p50", "max"}


def test_latency_is_from_a_sample_to_the_first_command_that_answers_it() -> None:
    frames = load_frames()
    encoder, valve = frames["ENCODER"].can_id, frames["VALVE_COMMAND"].can_id
    heard = [(0, encoder, 65535), (40_000, valve, 65535), (1_000_000, encoder, 0), (1_025_000, valve, 0)]
    heard += [(2_025_000, valve, 0), (3_000_000, encoder, 2), (3_050_000, valve, 2)]  # tick 0 again; 1 was lost
    assert compute_latencies(heard).tolist() == [40.0, 25.0, 50.0]
    with pytest.raises(InputError, match="no sample of the measurement was answered"):
        compute_latencies([(0, encoder, 1), (1_000_000, encoder, 2)])


@pytest.mark.parametrize("role", ["raw", "python-can"])
def test_an_echo_answers_whenever_the_source_comes(role: str, local_bus: str, tmp_path: Path) -> None:
    """On a busy machine that takes longer than the source sends."""
    ready, timing = tmp_path / "ready", (local_bus, 250, 0.1, 0, 50)
    echo = Echo(role, *timing, str(ready)).spawn()
    try:
        while not ready.exists():
            assert echo.poll() is None
            time.sleep(0.02)
        with watch_frames(local_bus) as frames:
            time.sleep(0.5)
            assert Echo("source", *timing).spawn().wait(60.0) == 0
        assert len(compute_latencies(frames)) > 0
    finally:
        echo.terminate()
    assert echo.wait(60.0) == 0


def test_a_loop_that_keeps_time_says_when(tmp_path: Path) -> None:
    pace = Pace(str(tmp_path / "pace"), 500, 0.4, 0, 50, phase_ns=250_000, spin_us=20.0)
    assert pace.spawn().wait(60.0) == 0
    slots, woken, ended = read(tmp_path / "pace")
    assert len(slots) == 200
    assert (slots % 2_000_000 == 250_000).all()
    assert (woken >= slots).all()
    assert (ended > woken).all()
    assert (ended[:-1] < woken[1:]).all()


def test_only_known_loads() -> None:
    with pytest.raises(
        InputError, match=r"load 'heat' is unknown; allowed are bus, cpu, disk, full, memory, restarts, viewer"
    ):
        find_loads(["cpu", "heat"])
    assert [load.name for load in find_loads(["disk"])] == ["disk"]


@pytest.mark.parametrize(
    "name", [*sorted(set(LOADS) - {"viewer", "full"}), pytest.param("full", marks=pytest.mark.needs("mount"))]
)
def test_a_load_runs_and_ends(name: str, local_bus: str) -> None:
    with LOADS[name].run(local_bus):
        pass  # leaving waits for its end


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--cpu", "999"], "error: CPU 999 is not possible; allowed are "),
        (["--seconds", "900"], "error: 900 s in 3 rounds is not possible; allowed are 3 to 180 s"),
        (["--rates", "250,fast"], "error: rates '250,fast' has 'fast'; allowed are whole numbers in Hz"),
        (["--rates", "250,7"], "error: rate 7 Hz is not possible; allowed are 50 to 10000 Hz"),
        (
            ["--load", "heat"],
            "error: load 'heat' is unknown; allowed are bus, cpu, disk, full, memory, restarts, viewer",
        ),
    ],
)
def test_a_bad_setting_is_one_sentence(tmp_path: Path, local_bus: str, arguments: list[str], sentence: str) -> None:
    done = play_here("jitter", "--bus", local_bus, "--out", tmp_path / "out", *arguments)
    assert done.returncode == 2
    assert list_errors(done.stderr)[0].startswith(sentence)
    assert not (tmp_path / "out").exists()


def test_the_whole_report(local_bus: str, tmp_path: Path) -> None:
    """Every cycle the witness saw is accounted for; what is ours is told apart from what is the machine's."""
    out = tmp_path / "jitter"
    command = child.list_command(
        "jitter", "--bus", local_bus, "--rate", "250", "--seconds", "2", "--rounds", "1", "--out", str(out), "--json"
    )
    done = subprocess.run(command, capture_output=True, text=True, timeout=300.0, check=False)
    assert done.returncode in (0, 1), done.stderr
    message = json.loads(done.stdout)
    assert message == json.loads((out / "jitter.json").read_text())
    assert (out / "jitter.png").stat().st_size > 10_000
    loops = {name: one for name, one in message["phases"].items() if "period" in one}
    assert set(loops) == {"empty loop, sleep", "empty loop, spin", "closed loop, clock", "closed loop, bus"}
    for one in loops.values():
        assert 0 <= one["unexplained"] <= one["late"] <= one["cycles"]
        assert one["late"] - one["unexplained"] <= one["near"] <= one["cycles"]
        assert one["cycles"] + one["late"] >= 0.5 * 2.0 * 250
        assert 0.0 <= one["wake"]["p50"] <= one["wake"]["max"]
        assert one["witness"]["p50"] > 0.0
    for name in ("closed loop, clock", "closed loop, bus"):
        for taken in map(loops[name]["footprint"].get, ("plant", "controller")):
            assert taken["collections"] == taken["threads_begun"] == 0
    for name in ("closed loop, bus", "echo, raw frames", "echo, python-can and cantools"):
        assert message["phases"][name]["latency"]["p50"] > 0.0
    assert {ratio["to"] for ratio in message["ratios"]} >= {"its witness", "echo, raw frames"}
    assert judge(message)[0].startswith("this machine is ")


def test_the_knee_is_the_last_rate_before_one_that_is_not_kept() -> None:
    def measured(late: int, failure: str = "") -> Measurements:
        one = Measurements(cycles=10_000, late=late, failure=failure)
        for what in ("wake", "step", "period"):
            one.add(what, np.ones(10))
        taken = {"minor_faults": 2, "major_faults": 1, "preemptions": 9, "collections": 0, "threads_begun": 4}
        one.footprint = {"plant": Counter(taken), "controller": Counter(taken | {"minor_faults": 0})}
        return one

    late = {1000: measured(0), 2000: measured(20), 4000: measured(21), 8000: measured(0), 10_000: measured(0, "gone")}
    rates = {(rate, "clock"): one for rate, one in late.items()}
    message = sweep_document(Setting("local:x", 1000, 3.0, 1, 0, 0.0), [], rates, False)
    assert message["knee_hz"] == {"clock": 2000}
    assert judge_sweep(message) == ("up to 2000 Hz with trigger clock, at most 0.2 % of the cycles are late", True)
    assert [line.split()[-4:] for line in sweep_text(message).splitlines()[4:6]] == [["3", "1", "0", "8"]] * 2
    assert [line.split()[:4] for line in sweep_text(message).splitlines()[4:]] == [
        ["clock", "1000", "1000", "10000"], ["clock", "2000", "500", "10000"], ["clock", "4000", "250", "10000"],
        ["clock", "8000", "125", "10000"], ["clock", "10000", "100", "failed"],
    ]  # fmt: skip
    by_bus = {(1000, "bus"): measured(0), (8000, "bus"): measured(20), (2000, "bus"): measured(1)}
    message = sweep_document(Setting("local:x", 1000, 3.0, 1, 0, 0.0), [], rates | by_bus, False)
    assert message["knee_hz"] == {"clock": 2000, "bus": 8000}
    assert judge_sweep(message)[0].startswith("up to 2000 Hz with trigger clock and 8000 Hz with trigger bus, at most")
    assert [one["rate_hz"] for one in message["rates"]] == [1000, 2000, 4000, 8000, 10_000, 1000, 2000, 8000]
    message = sweep_document(Setting("local:x", 1000, 3.0, 1, 0, 0.0), [], {(1000, "clock"): measured(21)}, False)
    assert judge_sweep(message) == ("no rate is kept with at most 0.2 % late", False)


def test_an_interrupted_measurement_is_no_good_verdict() -> None:
    message = make_document(Setting("local:x", 1000, 3.0, 1, 0, 0.0), [], {}, True)
    assert judge(message) == ("interrupted: what was measured so far is printed", False)
