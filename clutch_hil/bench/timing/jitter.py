"""Jitter: measure how punctual the loop is on this machine, compared with what the machine allows at the same time.

Method          phases take turns in several rounds: cyclictest; an empty loop, which sleeps, or spins for the last
                microseconds; the closed loop, triggered by the clock or by the bus; echoes of the same frames. A witness runs
                beside each loop: another empty loop, with a higher priority, on the same CPU, at the same rate, out of phase
Quantities      wake      from the slot of the grid to the first reading of the clock; triggered by the bus: from the frame's
                          stamp
                step      from there to the end of the cycle's work, telemetry included
                latency   from the stamp of a sample's ENCODER frame to that of the VALVE_COMMAND that answers it
                period    time between the beginnings of two cycles minus the period
                late      cycles that end after their slot, and skipped slots. A late cycle is unexplained if no spike of
                          the witness and no stall lies between 2.5 periods before its slot and 2.5 after its end
                          (`lateness.py`). The witness wakes once a period. A stall watch wakes four times a period, or 4000
                          times a second at rates above 1 kHz. A stall is a wake-up that is late by more than the length of
                          a spike. Above 1 kHz only the watch runs: a witness would take an eighth of the time at 4 kHz
                near      share of all cycles, late or not, that have a spike or stall within the same distance. Where it is
                          large, explained late cycles have little meaning
                footprint of both services of the closed loop: page faults, garbage collections, started threads
Assumptions     the stamps of both frames come from one clock (a local bus stamps a frame when it is sent, vcan when it is
                received)
References      rt-tests' cyclictest; numbers: docs/timing.md
"""

import contextlib
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from clutch_hil.bench.timing.jitter_phases import (
    measure_closed_loop,
    measure_cyclictest,
    measure_echo,
    measure_empty_loop,
)
from clutch_hil.bench.timing.loads import Load
from clutch_hil.bench.timing.measurements import Measurements, Setting
from protocols.errors import InputError, InterruptionError
from protocols.kernels.kernel_cache import describe_keeping
from protocols.realtime.stopping import Stop

Phase = Callable[[Setting, Measurements, Stop], None]
Key = TypeVar("Key")
Point = tuple[int, str]  # of a sweep: rate [Hz], and the trigger of a cycle
SWEEP_TRIGGERS = "clock", "bus"  # triggers of a cycle, in this order at each rate of a sweep


def list_phases(setting: Setting) -> dict[str, Phase]:
    """Return every phase by name. `cyclictest` is left out where it is not installed."""
    by_name: dict[str, Phase] = {"cyclictest": measure_cyclictest} if shutil.which("cyclictest") else {}
    by_name |= {
        "empty loop, sleep": lambda s, m, _: measure_empty_loop(s, m, 0.0),
        "empty loop, spin": lambda s, m, _: measure_empty_loop(s, m, setting.spin_us),
        "closed loop, clock": lambda s, m, stop: measure_closed_loop(s, m, stop, "clock"),
        "closed loop, bus": lambda s, m, stop: measure_closed_loop(s, m, stop, "bus"),
        "echo, raw frames": lambda s, m, _: measure_echo(s, m, "raw"),
        "echo, python-can and cantools": lambda s, m, _: measure_echo(s, m, "python-can"),
    }
    return by_name


def sweep(
    setting: Setting, rates: Sequence[int], loads: Sequence[Load], progress: Callable[[float, int], None]
) -> tuple[dict[Point, Measurements], bool]:
    """Measure the closed loop at several rates [Hz], with each trigger of SWEEP_TRIGGERS in turn.

    Return the measurements by rate and trigger, and whether the sweep was interrupted. Raises InputError.
    """

    def make_phase(rate: int, trigger: str) -> Phase:
        def run_phase(setting: Setting, measured: Measurements, stop: Stop) -> None:
            try:
                measure_closed_loop(replace(setting, rate=rate), measured, stop, trigger, record_frames=False)
            except InputError as error:  # services give up at rates that the machine cannot keep
                measured.failure = str(error)

        return run_phase

    points = [(rate, trigger) for rate in rates for trigger in SWEEP_TRIGGERS]
    return _run_in_turn(setting, {point: make_phase(*point) for point in points}, loads, progress)


def measure(
    setting: Setting, loads: Sequence[Load], progress: Callable[[float, int], None]
) -> tuple[dict[str, Measurements], bool]:
    """Measure every phase in turn, `rounds` times; return the measurements by name, and whether it was interrupted.

    Raises InputError.
    """
    return _run_in_turn(setting, list_phases(setting), loads, progress)


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
                stack.enter_context(load.run(setting.bus))
            for _ in range(setting.rounds):
                for name, phase in todo.items():
                    if stop.asked:
                        return results, True
                    try:
                        phase(setting, results[name], stop)
                    except (InputError, InterruptionError):
                        if not stop.asked:  # after a stop request the error is only its consequence
                            raise
                    if not done:
                        stop.check(f"nothing was measured or written; {describe_keeping()}")
                    done += 1
                    progress(done, total)
    finally:
        os.sched_setaffinity(0, allowed_cpus)
    return results, False
