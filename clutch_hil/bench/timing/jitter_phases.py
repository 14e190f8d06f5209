"""Phases of the jitter measurement: cyclictest, the empty loop, the closed loop and the echo."""

import contextlib
import subprocess
import time
from collections import Counter
from collections.abc import Sequence

import numpy as np

from clutch_hil.bench.services import Services, print_line
from clutch_hil.bench.timing.command_latency import compute_latencies, watch_frames
from clutch_hil.bench.timing.echo import Echo
from clutch_hil.bench.timing.lateness import compute_shortest_spike, find_late_cycles, find_spikes, mark_explained
from clutch_hil.bench.timing.measurements import Measurements, Setting
from clutch_hil.bench.timing.stalls import StallWatch
from clutch_hil.bench.timing.witness import POLL_INTERVAL, START_TIMEOUT, make_stall_watch, run_witness, wait_for_start
from clutch_hil.bench.timing.witness_loop import Pace, read
from protocols.errors import InputError
from protocols.realtime.child import await_end, end_child
from protocols.realtime.rights import PRIORITY
from protocols.realtime.ring import RingReader
from protocols.realtime.shared_folder import SharedFolder
from protocols.realtime.stopping import Stop

_SETTLING_TIME = 1.0  # s of the closed loop that are not measured; chosen: cycles just after the start are not typical
# Hz, highest rate with a witness: it takes 24 to 38 us of the CPU in each period (measured on a slow machine)
_MOST_WITNESSED_RATE = 1000
_HISTOGRAM_RANGE = 20_000  # us, range of the histogram of cyclictest


def measure_cyclictest(setting: Setting, measured: Measurements, stop: Stop) -> None:
    """Measure wake-ups by cyclictest beside the witness. Raises InputError when cyclictest fails."""
    loops, period_us = round(setting.piece * setting.rate), 1_000_000 // setting.rate
    command = [
        "cyclictest", "-q", "-m", "-t1", f"-p{PRIORITY}", f"-a{setting.cpu}", f"-i{period_us}", f"-l{loops}",
        f"-h{_HISTOGRAM_RANGE}",
    ]  # fmt: skip
    with run_witness(setting, setting.piece, 0) as witness:
        process = subprocess.run(command, capture_output=True, text=True, check=False)
    if stop.asked:
        return
    measured.witness.append((witness[1] - witness[0]) / 1e3)
    if process.returncode:
        raise InputError(f"cyclictest failed: {(process.stderr.strip().splitlines() or ['no message'])[-1]}")
    lines = [line.split() for line in process.stdout.splitlines() if line[:1].isdigit()]
    counts = np.array([(int(us), int(count)) for us, count in lines])
    wake = np.repeat(counts[:, 0] + 0.5, counts[:, 1])  # centre of a bin of 1 us
    overflow = next((line for line in process.stdout.splitlines() if line.startswith("# Max Latencies")), "")
    wake = np.append(wake, [float(overflow.rpartition(" ")[2])] if overflow and loops > len(wake) else [])
    measured.add("wake", wake)
    measured.cycles += loops


def measure_empty_loop(setting: Setting, measured: Measurements, spin_us: float) -> None:
    """Measure an empty loop that spins for the last `spin_us` [us] before a slot."""
    folder = SharedFolder()
    out = folder.path / "pace"
    period = 1_000_000_000 // setting.rate
    pace = Pace(str(out), setting.rate, setting.piece, setting.cpu, PRIORITY, period // 2, spin_us)
    try:
        with run_witness(setting, setting.piece, 0) as witness, make_stall_watch(setting, setting.piece, 0) as watch:
            await_end(pace.spawn(), setting.piece + START_TIMEOUT, "loop that does nothing")
        slots, woken, _ = read(out)
    finally:
        folder.remove()
    measured.add("wake", (woken - slots) / 1e3)
    measured.add("period", (np.diff(woken) - period) / 1e3)
    late = find_late_cycles(slots, np.zeros(len(slots)), period)
    _count_cycles(measured, np.column_stack([slots[:-1], woken[1:]]), late, witness, watch, period)


def measure_closed_loop(
    setting: Setting, measured: Measurements, stop: Stop, trigger: str, record_frames: bool = True
) -> None:
    """Measure plant and controller on one CPU from their records and, if `record_frames`, from the stamps of their frames."""
    common = ["--bus", setting.bus, "--rate", str(setting.rate), "--cpu", str(setting.cpu)]
    common += [] if setting.telemetry else ["--no-telemetry"]
    # only the controller spins before a slot; a spinning plant would keep the controller off the CPU
    loop = ["controller", *common, "--trigger", trigger, "--spin-us", str(setting.spin_us)]
    period = 1_000_000_000 // setting.rate
    commands = {"plant": ["plant", *common, "--profile", "engagement", "--seconds", "100000"], "controller": loop}
    with Services(commands) as services:
        rings = services.wait_for_rings(stop, print_line)
        _wait_for_closed_loop(services, rings[1], stop)
        first = _read_rows(rings[1], _SETTLING_TIME, stop)
        column = [c.name for c in rings[1].columns].index("clock_s")
        # the cause of a late cycle lasts until the slot of the witness
        phase = int(first[-1, column] * 1e9) + period // 4
        with contextlib.ExitStack() as stack:
            frames = stack.enter_context(watch_frames(setting.bus)) if record_frames else []
            with contextlib.ExitStack() as beside:
                witnessed = setting.rate <= _MOST_WITNESSED_RATE
                witness = beside.enter_context(run_witness(setting, setting.piece, phase)) if witnessed else []
                watch = beside.enter_context(make_stall_watch(setting, setting.piece, phase))
                rows = _read_rows(rings[1], setting.piece, stop)
            for service, service_summary in services.end().items():
                measured.footprint.setdefault(service, Counter()).update(service_summary["footprint"] or {})
    names = [c.name for c in rings[1].columns]
    clock, wake, work, late = (rows[:, names.index(n)] for n in ("clock_s", "wake_us", "work_us", "late_cycles"))
    measured.add("wake", wake)
    measured.add("step", work[1:])  # a row contains the work time of the previous cycle
    measured.add("period", np.diff(clock) * 1e6 - period / 1e3)
    if record_frames:
        measured.add("latency", compute_latencies(frames))
    begins = clock[:-1] * 1e9
    cycles = np.column_stack([begins - wake[:-1] * 1e3, begins + work[1:] * 1e3])
    _count_cycles(measured, cycles, find_late_cycles(cycles[:, 0], late[:-1], period), witness, watch, period)


def measure_echo(setting: Setting, measured: Measurements, kind: str) -> None:
    """Measure how fast an echo of this `kind` (`clutch_hil.bench.timing.echo`) answers frames. Raises InputError."""
    timing = (setting.bus, setting.rate, setting.piece, setting.cpu, PRIORITY)
    folder = SharedFolder()
    ready = folder.path / "ready"
    echo = Echo(kind, *timing, str(ready)).spawn()
    try:
        with watch_frames(setting.bus) as frames:
            wait_for_start(echo, ready, "echo")
            await_end(Echo("source", *timing).spawn(), setting.piece + START_TIMEOUT, "source of frames")
    finally:
        end_child(echo, START_TIMEOUT)
        folder.remove()
    measured.add("latency", compute_latencies(frames))
    measured.cycles += round(setting.piece * setting.rate)


def _count_cycles(
    measured: Measurements,
    cycles: np.ndarray,
    late: np.ndarray,
    witness: Sequence[np.ndarray],
    watch: StallWatch,
    period: int,
) -> None:
    """Count late and unexplained cycles among those covered by `watch`, and by `witness` if there is one.

    cycles: slot and end of each (n, 2) [ns]. late: indices of the late cycles (k,). witness: see `run_witness`. period: [ns].
    """
    lost, (begin, end) = watch.list_stalls(compute_shortest_spike(period)), watch.watched_span
    if witness:
        slots, woken, ended = witness
        beside = (slots >= cycles[0, 0]) & (slots <= cycles[-1, 1])  # it also ran before and after the cycles
        measured.witness.append((woken - slots)[beside] / 1e3)
        lost = np.concatenate([lost, find_spikes(slots, ended, period)])
        begin, end = max(begin, slots[0]), min(end, slots[-1])
    watched = (cycles[:, 0] >= begin) & (cycles[:, 1] <= end)
    near, late = mark_explained(cycles, lost, period), late[watched[late]]
    measured.cycles += int(watched.sum())
    measured.near += int(near[watched].sum())
    measured.late += len(late)
    measured.unexplained += int((~near[late]).sum())


def _wait_for_closed_loop(services: Services, ring: RingReader, stop: Stop) -> None:
    """Wait until the loop is closed. Raises InputError when it does not close."""
    end = time.monotonic() + START_TIMEOUT
    while not len(ring.read()):
        services.check()
        if stop.asked or time.monotonic() > end:
            raise InputError(f"the loop was not closed within {START_TIMEOUT:g} s")
        time.sleep(POLL_INTERVAL)


def _read_rows(ring: RingReader, seconds: float, stop: Stop) -> np.ndarray:
    """Read the rows of a ring for `seconds` [s], at least once; shape (rows, columns)."""
    rows: list[np.ndarray] = []
    end = time.monotonic() + seconds
    while not rows or (time.monotonic() < end and not stop.asked):
        time.sleep(POLL_INTERVAL)
        rows.append(ring.read())
    return np.concatenate(rows)
