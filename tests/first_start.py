"""The first start of a bench: `clutch-hil up` with an empty kernel cache, and its messages.

`python -m tests.first_start RECORD` runs it with the cache in NUMBA_CACHE_DIR and writes its record to the file RECORD. A
session of all tests (conftest.py) begins with it, so the kernels are compiled once. test_first_minute.py checks the record.
"""

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from protocols.realtime.child import list_command

RECORD = "CLUTCH_HIL_FIRST_START"  # environment variable with the path of the record of this session, if there is one
PATIENCE = 600.0  # s for all kernels, compiled on a busy machine


@dataclass(frozen=True)
class FirstStart:
    """Record of a first start.

    times: 0.0, then the time of each line on stderr since the start [s]. lines: these lines. out: stdout. code: exit code.
    """

    times: list[float]
    lines: list[str]
    out: str
    code: int


def begin(cache: Path, *arguments: str) -> subprocess.Popen[str]:
    """Start a `clutch-hil` command with the kernel cache in the folder `cache`; return its process."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    return subprocess.Popen(
        list_command(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )


def list_words(bus: str, folder: Path, seconds: float) -> list[str]:
    """Return the arguments of an `up` that runs for `seconds` and writes into `folder`."""
    return ["up", "--bus", bus, "--rate", "250", "--seconds", str(seconds), "--out", str(folder), "--json"]


def start_on_empty_cache(cache: Path, bus: str, folder: Path) -> FirstStart:
    """Run `up` for two seconds with an empty kernel cache in the folder `cache`; it writes into `folder`. Return its record."""
    began, times, lines = time.monotonic(), [0.0], []
    process = begin(cache, *list_words(bus, folder, 2.0))
    assert process.stdout
    assert process.stderr
    patience = threading.Timer(PATIENCE, process.kill)
    patience.start()
    for line in process.stderr:
        times.append(time.monotonic() - began)
        lines.append(line.rstrip("\n"))
    patience.cancel()
    return FirstStart(times, lines, process.stdout.read(), process.wait(PATIENCE))


def read_record(path: Path) -> FirstStart:
    """Return the record that `main` has written to a file."""
    return FirstStart(**json.loads(path.read_text(encoding="utf-8")))


def main(record: Path) -> None:
    """Start once, and write the record."""
    with tempfile.TemporaryDirectory(prefix="ch-") as folder:  # short: socket paths have at most 107 bytes
        os.environ["CLUTCH_HIL_BUS_DIR"] = folder
        start = start_on_empty_cache(Path(os.environ["NUMBA_CACHE_DIR"]), "local:bench", Path(folder))
    record.write_text(json.dumps(asdict(start)), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
