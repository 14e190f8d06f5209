"""The stopwatch of tests sees what a process waits for, but not what it waits for a CPU."""

import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
BUSY = "import time\nend = time.monotonic() + 60\nwhile time.monotonic() < end: pass"
SLEEPS = "time.sleep(0.1)"
COMPUTES = "end = time.process_time() + 0.2\nwhile time.process_time() < end: pass"
CPU = max(os.sched_getaffinity(0))


def time_code(code: str) -> tuple[float, float]:
    """What the stopwatch shows of `code` and what the clock does [s], in a process that has one thread, on one CPU."""
    begin = f"import os, time\nfrom tests.stopwatch import Stopwatch\nos.sched_setaffinity(0, [{CPU}])"
    begin += "\nbegan, watch = time.monotonic(), Stopwatch()\n"
    end = "\nprint(watch.read_seconds(), time.monotonic() - began)"
    command = [sys.executable, "-c", begin + code + end]
    shown, elapsed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    return float(shown), float(elapsed)


def test_waiting_for_something_takes_its_time() -> None:
    shown, elapsed = time_code(SLEEPS)
    assert 0.099 <= shown <= elapsed


def test_waiting_for_a_cpu_that_others_have_takes_none() -> None:
    pinned = f"import os\nos.sched_setaffinity(0, [{CPU}])\n{BUSY}"
    crowd = [subprocess.Popen([sys.executable, "-c", pinned]) for _ in range(3)]
    try:
        time.sleep(0.3)  # they compute by then
        shown, elapsed = time_code(COMPUTES)
    finally:
        for process in crowd:
            process.kill()
            process.wait()
    assert elapsed > 0.3
    assert 0.15 < shown < 0.5 * elapsed + 0.1
