"""Jitter: how punctual the loop is on this machine, compared with what the machine allows at the same time.

Method          phases take turns in several rounds: cyclictest; a loop that does nothing, which sleeps, or spins for the last
                microseconds; the closed loop, begun by the clock or by the bus; echoes of the same frames. Beside each loop
                runs a witness: another loop that does nothing, with a higher priority, on the same CPU, at the same rate, out
                of phase
What counts     wake      from the slot of the grid to the first look at the clock; begun by the bus: from the frame's stamp
                step      from there to the end of the cycle's work, telemetry included
                latency   from the stamp of a sample's ENCODER frame to that of the VALVE_COMMAND that answers it
                period    time between the beginnings of two cycles minus the period
                late      cycles that end after their slot, and slots left out. A late cycle is unexplained if no spike of
                          the witness and no stall lies between two periods before its slot and two after its end
                          (`lateness`). The witness wakes once a period. A watch wakes four times a period, above 1 kHz 4000
                          times a second. Where it wakes later than a spike is long, there was a stall. Above 1 kHz the
                          watch is alone: a witness would take an eighth of the time at 4 kHz
                near      share of all cycles, late or not, that have such a spike or stall as near. Where it is large,
                          explained late cycles mean little
                footprint of both services of the closed loop: page faults, collections of garbage, threads begun
Assumptions     stamps of both frames are of one clock (a local bus stamps a frame when it is sent, vcan when it is received)
References      rt-tests' cyclictest; numbers: docs/timing.md
"""

import contextlib
import os
import shutil
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from clutch_hil.bench.echo import Echo
from clutch_hil.bench.lateness import late_cycles, mark_explained, spike, spikes
from clutch_hil.bench.loads import Load
from clutch_hil.bench.services import Services, print_line
from clutch_hil.bench.stalls import StallWatch
from clutch_hil.bench.witness_loop import Pace, read, start_file
from protocols.buses.bus import Port, open_bus
from protocols.can.frames import load_frames
from protocols.errors import InputError, InterruptionError
from protocols.kernels.kernel_cache import describe_keeping
from protocols.realtime.rights import PRIORITY
from protocols.realtime.ring import RingReader
from protocols.realtime.shared_folder import SharedFolder
from protocols.realtime.stopping import Stop

WITNESS_PRIORITY = 90
_SETTLING_TIME = 1.0  # s of the closed loop that are not measured
_START_TIMEOUT = 60.0  # s for the loop to close, and for other processes to start and to end
_CHECKS_PER_PERIOD = 4  # of the stall watch
_MOST_CHECKS = 4000  # of the stall watch in a second: each takes 10 us
# of the stall watch in a second, for loops above _MOST_CHECKS Hz: 10 us of a period of 125 us would be too much
_FAST_CHECKS = 1000
# Hz, up to which there is a witness: it takes 24 to 38 us of the CPU in each period (measured on a slow machine)
_MOST_WITNESSED_RATE = 1000
_HISTOGRAM_RANGE = 20_000  # us, of the histogram of cyclictest
_POLL_INTERVAL = 0.02  # s
PERCENTILES = (50.0, 99.0, 99.9, 99.99)


@dataclass(frozen=True)
class Setting:
    """What is measured: each phase for `seconds` [s] in total, divided into `rounds`, at `rate` [Hz], on `cpu` and `bus`.

    The loop spins for the last `spin_us` [us] before a slot. `telemetry` is published or not.
    """

    bus: str
    rate: int
    seconds: float
    rounds: int
    cpu: int
    spin_us: float
    telemetry: bool = True

    @property
    def piece(self) -> float:
        """Length of a phase in one round [s]."""
        return self.seconds / self.rounds


@dataclass
class Measurements:
    """Measurements of one phase.

    durations: arrays (n,) [us], one a round, by quantity, such as `wake`. witness: lateness (n,) [us] of the witness, by round.
    cycles, near, late, unexplained: numbers of cycles; see the module. footprint: page faults and the like of each service
    (`protocols.realtime.footprint`). failure: why the phase could not be measured; empty if it could.
    """

    durations: dict[str, list[np.ndarray]] = field(default_factory=dict)
    witness: list[np.ndarray] = field(default_factory=list)
    cycles: int = 0
    near: int = 0
    late: int = 0
    unexplained: int = 0
    footprint: dict[str, Counter[str]] = field(default_factory=dict)
    failure: str = ""

    def add(self, what: str, values: np.ndarray) -> None:
        """Add the durations of one round, shape (n,) [us]."""
        self.durations.setdefault(what, []).append(values)

    def all(self, what: str) -> np.ndarray:
        """Durations of all rounds, shape (n,) [us]."""
        return np.concatenate(self.durations[what])


def summary(values: np.ndarray) -> dict[str, float]:
    """Percentiles and maximum [us] of durations (n,). A percentile with fewer than five values above it is left out."""
    percentiles = {
        f"p{p:g}": float(np.percentile(values, p)) for p in PERCENTILES if len(values) * (100.0 - p) >= 499.9
    }
    return percentiles | {"max": float(values.max())}


Phase = Callable[[Setting, Measurements, Stop], None]
Key = TypeVar("Key")
Point = tuple[int, str]  # of a sweep: rate [Hz], and what begins a cycle
SWEEP_TRIGGERS = "clock", "bus"  # triggers of a sweep


def phases(setting: Setting) -> dict[str, Phase]:
    """Every phase by name. `cyclictest` is left out where it is not installed."""
    by_name: dict[str, Phase] = {"cyclictest": _measure_cyclictest} if shutil.which("cyclictest") else {}
    by_name |= {
        "empty loop, sleep": lambda s, m, _: _measure_empty_loop(s, m, 0.0),
        "empty loop, spin": lambda s, m, _: _measure_empty_loop(s, m, setting.spin_us),
        "closed loop, clock": lambda s, m, stop: _measure_closed_loop(s, m, stop, "clock"),
        "closed loop, bus": lambda s, m, stop: _measure_closed_loop(s, m, stop, "bus"),
        "echo, raw frames": lambda s, m, _: _measure_echo(s, m, "raw"),
        "echo, python-can and cantools": lambda s, m, _: _measure_echo(s, m, "python-can"),
    }
    return by_name


def sweep(
    setting: Setting, rates: Sequence[int], loads: Sequence[Load], progress: Callable[[float, int], None]
) -> tuple[dict[Point, Measurements], bool]:
    """Measure the closed loop at several rates [Hz], begun by each of SWEEP_TRIGGERS in turn.

    Return the measurements by rate and trigger, and whether the sweep was interrupted. Raises InputError.
    """

    def phase_at(rate: int, trigger: str) -> Phase:
        def phase(setting: Setting, measured: Measurements, stop: Stop) -> None:
            try:
                _measure_closed_loop(replace(setting, rate=rate), measured, stop, trigger, record_frames=False)
            except InputError as error:  # beyond what the machine can do the services give up
                measured.failure = str(error)

        return phase

    points = [(rate, trigger) for rate in rates for trigger in SWEEP_TRIGGERS]
    return _run_in_turn(setting, {point: phase_at(*point) for point in points}, loads, progress)


def measure(
    setting: Setting, loads: Sequence[Load], progress: Callable[[float, int], None]
) -> tuple[dict[str, Measurements], bool]:
    """Measure every phase in turn, `rounds` times; return the measurements by name, and whether it was interrupted.

    Raises InputError.
    """
    return _run_in_turn(setting, phases(setting), loads, progress)


def _run_in_turn(
    setting: Setting, todo: Mapping[Key, Phase], loads: Sequence[Load], progress: Callable[[float, int], None]
) -> tuple[dict[Key, Measurements], bool]:
    """Run the phases `todo` under `loads`; return their measurements, and whether it was interrupted. Raises InputError."""
    results = {name: Measurements() for name in todo}
    total, done = setting.rounds * len(todo), 0
    allowed_cpus = os.sched_getaffinity(0)
    others = allowed_cpus - {setting.cpu} or allowed_cpus
    os.sched_setaffinity(0, others)
    try:
        with contextlib.ExitStack() as stack, Stop() as stop:
            for load in loads:
                stack.enter_context(load.running(setting.bus))
            for _ in range(setting.rounds):
                for name, phase in todo.items():
                    if stop.asked:
                        return results, True
                    try:
                        phase(setting, results[name], stop)
                    except (InputError, InterruptionError):
                        if not stop.asked:  # if it was, the error is only its consequence
                            raise
                    if not done:
                        stop.check(f"nothing had been measured; nothing was written, {describe_keeping()}")
                    done += 1
                    progress(done, total)
    finally:
        os.sched_setaffinity(0, allowed_cpus)
    return results, False


@contextlib.contextmanager
def _run_witness(setting: Setting, seconds: float, phase_ns: int) -> Iterator[list[np.ndarray]]:
    """Run a witness while entered. Afterwards the list has three arrays (n,) [ns]: slots, wake-ups, and when it slept again."""
    folder = SharedFolder()
    out = folder.path / "witness"
    times: list[np.ndarray] = []
    pace = Pace(str(out), setting.rate, seconds + _START_TIMEOUT, setting.cpu, WITNESS_PRIORITY, phase_ns)
    process = pace.spawn()
    try:
        _wait_for_start(process, start_file(out), "witness")
        yield times
        process.terminate()
        process.wait(_START_TIMEOUT)
        times += read(out)
    finally:
        process.kill()
        process.wait()
        folder.remove()


def _new_stall_watch(setting: Setting, seconds: float, phase_ns: int) -> StallWatch:
    """Make a watch whose slots lie midway between the slots of the witness and those of the loop."""
    most = _MOST_CHECKS if setting.rate <= _MOST_CHECKS else _FAST_CHECKS
    every = 1_000_000_000 // min(_CHECKS_PER_PERIOD * setting.rate, most)
    return StallWatch(setting.cpu, WITNESS_PRIORITY, every, phase_ns + every // 2, seconds + _START_TIMEOUT)


def _measure_cyclictest(setting: Setting, measured: Measurements, stop: Stop) -> None:
    loops, period_us = round(setting.piece * setting.rate), 1_000_000 // setting.rate
    command = [
        "cyclictest", "-q", "-m", "-t1", f"-p{PRIORITY}", f"-a{setting.cpu}", f"-i{period_us}", f"-l{loops}",
        f"-h{_HISTOGRAM_RANGE}",
    ]  # fmt: skip
    with _run_witness(setting, setting.piece, 0) as witness:
        process = subprocess.run(command, capture_output=True, text=True, check=False)
    if stop.asked:
        return
    measured.witness.append((witness[1] - witness[0]) / 1e3)
    if process.returncode:
        raise InputError(f"cyclictest failed: {(process.stderr.strip().splitlines() or ['it said nothing'])[-1]}")
    lines = [line.split() for line in process.stdout.splitlines() if line[:1].isdigit()]
    counts = np.array([(int(us), int(count)) for us, count in lines])
    wake = np.repeat(counts[:, 0] + 0.5, counts[:, 1])  # a bin of 1 us at its middle
    overflow = next((line for line in process.stdout.splitlines() if line.startswith("# Max Latencies")), "")
    wake = np.append(wake, [float(overflow.rpartition(" ")[2])] if overflow and loops > len(wake) else [])
    measured.add("wake", wake)
    measured.cycles += loops


def _measure_empty_loop(setting: Setting, measured: Measurements, spin_us: float) -> None:
    folder = SharedFolder()
    out = folder.path / "pace"
    period = 1_000_000_000 // setting.rate
    pace = Pace(str(out), setting.rate, setting.piece, setting.cpu, PRIORITY, period // 2, spin_us)
    try:
        with _run_witness(setting, setting.piece, 0) as witness, _new_stall_watch(setting, setting.piece, 0) as watch:
            process = pace.spawn()
            process.wait(setting.piece + _START_TIMEOUT)
        slots, woken, _ = read(out)
    finally:
        folder.remove()
    measured.add("wake", (woken - slots) / 1e3)
    measured.add("period", (np.diff(woken) - period) / 1e3)
    late = late_cycles(slots, np.zeros(len(slots)), period)
    _count_cycles(measured, np.column_stack([slots[:-1], woken[1:]]), late, witness, watch, period)


def _measure_closed_loop(
    setting: Setting, measured: Measurements, stop: Stop, trigger: str, record_frames: bool = True
) -> None:
    """Measure plant and controller on one CPU from their records and, if `record_frames`, from the stamps of their frames."""
    common = ["--bus", setting.bus, "--rate", str(setting.rate), "--cpu", str(setting.cpu)]
    common += [] if setting.telemetry else ["--no-telemetry"]
    # only the controller spins before a slot; a plant that spins would keep the controller off the CPU
    loop = ["controller", *common, "--trigger", trigger, "--spin-us", str(setting.spin_us)]
    period = 1_000_000_000 // setting.rate
    commands = {"plant": ["plant", *common, "--profile", "engagement", "--seconds", "100000"], "controller": loop}
    with Services(commands) as services:
        rings = services.rings(stop, print_line)
        _wait_for_closed_loop(services, rings[1], stop)
        first = _read_rows(rings[1], _SETTLING_TIME, stop)
        column = [c.name for c in rings[1].columns].index("clock_s")
        # what makes a cycle late lasts until the slot of the witness
        phase = int(first[-1, column] * 1e9) + period // 4
        with contextlib.ExitStack() as stack:
            frames = stack.enter_context(_record_frames(setting.bus)) if record_frames else []
            with contextlib.ExitStack() as beside:
                witnessed = setting.rate <= _MOST_WITNESSED_RATE
                witness = beside.enter_context(_run_witness(setting, setting.piece, phase)) if witnessed else []
                watch = beside.enter_context(_new_stall_watch(setting, setting.piece, phase))
                rows = _read_rows(rings[1], setting.piece, stop)
            for service, service_summary in services.end().items():
                measured.footprint.setdefault(service, Counter()).update(service_summary["footprint"] or {})
    names = [c.name for c in rings[1].columns]
    clock, wake, work, late = (rows[:, names.index(n)] for n in ("clock_s", "wake_us", "work_us", "late_cycles"))
    measured.add("wake", wake)
    measured.add("step", work[1:])  # a row has the work of the cycle before
    measured.add("period", np.diff(clock) * 1e6 - period / 1e3)
    if record_frames:
        measured.add("latency", _latencies(frames))
    begins = clock[:-1] * 1e9
    cycles = np.column_stack([begins - wake[:-1] * 1e3, begins + work[1:] * 1e3])
    _count_cycles(measured, cycles, late_cycles(cycles[:, 0], late[:-1], period), witness, watch, period)


def _measure_echo(setting: Setting, measured: Measurements, kind: str) -> None:
    timing = (setting.bus, setting.rate, setting.piece, setting.cpu, PRIORITY)
    folder = SharedFolder()
    ready = folder.path / "ready"
    echo = Echo(kind, *timing, str(ready)).spawn()
    try:
        with _record_frames(setting.bus) as frames:
            _wait_for_start(echo, ready, "echo")
            Echo("source", *timing).spawn().wait(setting.piece + _START_TIMEOUT)
        echo.terminate()
        echo.wait(_START_TIMEOUT)
    finally:
        echo.kill()
        echo.wait()
        folder.remove()
    measured.add("latency", _latencies(frames))
    measured.cycles += round(setting.piece * setting.rate)


def _wait_for_start(process: "subprocess.Popen[bytes]", ready_file: Path, what: str) -> None:
    """Wait for the file `ready_file` that a process makes when it begins. Raises InputError when it does not come."""
    end = time.monotonic() + _START_TIMEOUT
    while not ready_file.exists():
        if process.poll() is not None or time.monotonic() > end:
            raise InputError(f"the {what} of the measurement did not start")
        time.sleep(_POLL_INTERVAL)


def _count_cycles(
    measured: Measurements,
    cycles: np.ndarray,
    late: np.ndarray,
    witness: Sequence[np.ndarray],
    watch: StallWatch,
    period: int,
) -> None:
    """Count late and unexplained cycles, of those that `watch`, and `witness` if there is one, ran beside.

    cycles: slot and end of each (n, 2) [ns]. late: indices of the late ones (k,). witness: see `_run_witness`. period: [ns].
    """
    lost, (begin, end) = watch.stalls(spike(period)), watch.watched_span
    if witness:
        slots, woken, ended = witness
        beside = (slots >= cycles[0, 0]) & (slots <= cycles[-1, 1])  # it also saw both begin and end
        measured.witness.append((woken - slots)[beside] / 1e3)
        lost = np.concatenate([lost, spikes(slots, ended, period)])
        begin, end = max(begin, slots[0]), min(end, slots[-1])
    watched = (cycles[:, 0] >= begin) & (cycles[:, 1] <= end)
    near, late = mark_explained(cycles, lost, period), late[watched[late]]
    measured.cycles += int(watched.sum())
    measured.near += int(near[watched].sum())
    measured.late += len(late)
    measured.unexplained += int((~near[late]).sum())


def _wait_for_closed_loop(services: Services, ring: RingReader, stop: Stop) -> None:
    """Wait until the loop is closed. Raises InputError when it does not close."""
    end = time.monotonic() + _START_TIMEOUT
    while not len(ring.read()):
        services.check()
        if stop.asked or time.monotonic() > end:
            raise InputError(f"the loop was not closed within {_START_TIMEOUT:g} s")
        time.sleep(_POLL_INTERVAL)


def _read_rows(ring: RingReader, seconds: float, stop: Stop) -> np.ndarray:
    """Read the rows of a ring for `seconds` [s], at least once; shape (rows, columns)."""
    rows: list[np.ndarray] = []
    end = time.monotonic() + seconds
    while not rows or (time.monotonic() < end and not stop.asked):
        time.sleep(_POLL_INTERVAL)
        rows.append(ring.read())
    return np.concatenate(rows)


@contextlib.contextmanager
def _record_frames(bus: str) -> Iterator[list[tuple[int, int, int]]]:
    """Record samples and commands on the bus while entered: stamp [ns], identifier and tick of each.

    A thread reads all the time: a participant that does not read fills its queue, and senders count refusals.
    """
    codecs = {codec.can_id: codec for name, codec in load_frames().items() if name in ("ENCODER", "VALVE_COMMAND")}
    frames: list[tuple[int, int, int]] = []
    ending = threading.Event()

    def listen(port: Port) -> None:
        while not ending.is_set():
            if port.wait(_POLL_INTERVAL):
                for stamp, (can_id, data) in port.receive_stamped():
                    if can_id in codecs:
                        frames.append((stamp, can_id, codecs[can_id].raw(data).sample_tick))

    with open_bus(bus) as port:
        thread = threading.Thread(target=listen, args=(port,))
        thread.start()
        try:
            yield frames
        finally:
            ending.set()
            thread.join()


def _latencies(frames: Sequence[tuple[int, int, int]]) -> np.ndarray:
    """Times from each sample to the first command that answers it, shape (n,) [us]. Raises InputError when there is none."""
    encoder = load_frames()["ENCODER"].can_id
    sample_stamps: dict[int, int] = {}
    latencies = []
    for stamp, can_id, tick in sorted(frames):
        if can_id == encoder:
            sample_stamps[tick] = stamp
        elif tick in sample_stamps:
            latencies.append(stamp - sample_stamps.pop(tick))
    if not latencies:
        raise InputError("no sample of the measurement was answered")
    return np.array(latencies) / 1e3
