"""Telemetry consumers: monitor, recorder and viewer beside a bench, and commands that start one after the other."""

import itertools
import os
import signal
import subprocess
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from benchmarks.request_sender import MOST_REASON
from protocols.realtime.child import list_command

_CONSUMERS = {"monitor": (), "record": ("seen.parquet",), "view": ("--web", "--no-open")}
# Commands that start while the requests are sent
_COMMANDS = ("monitor", "--once"), ("tune",), ("inject",), ("record", "late.parquet", "--seconds", "1")
_END_PATIENCE = 30.0  # s for a consumer to end


class LateConsumers:
    """Consumers that start while a peer publishes invalid data, one after the other, from a thread.

    counts: by command, how many were `fine`, or `refused` in one sentence. broken: output of all others.
    """

    def __init__(self, bus: str, folder: Path) -> None:
        self.counts: dict[str, Counter[str]] = {}
        self.broken: list[str] = []
        self._bus, self._folder = bus, folder
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run_commands)

    def __enter__(self) -> "LateConsumers":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.finish()

    def finish(self) -> None:
        """Wait for the last consumer to end."""
        self._over.set()
        self._thread.join()

    def _run_commands(self) -> None:
        for number in itertools.count():
            name, *arguments = _COMMANDS[number % len(_COMMANDS)]
            if self._over.is_set():
                return
            words = [
                str(self._folder / f"{number}-{word}") if word.endswith(".parquet") else word for word in arguments
            ]
            command = list_command(name, *words, "--bus", self._bus)
            try:
                done = subprocess.run(command, capture_output=True, text=True, timeout=_END_PATIENCE, check=False)
                code, error = done.returncode, done.stderr.strip()
            except subprocess.TimeoutExpired:
                code, error = -1, f"it did not end within {_END_PATIENCE:g} s"
            last = error.splitlines()[-1] if error else ""
            became = "fine" if code in (0, 1) else "refused" if code == 2 and last.startswith("error: ") else "broken"
            if became == "broken" or "Traceback" in error or len(last) >= MOST_REASON:
                became = "broken"
                self.broken.append(f"{name}: {error[-2000:]}")
            self.counts.setdefault(name, Counter())[became] += 1


@contextmanager
def run_consumers(bus: str, folder: Path) -> Iterator[dict[str, "subprocess.Popen[str]"]]:
    """Run the consumers of the telemetry during the `with` block, and yield them."""
    running: dict[str, subprocess.Popen[str]] = {}
    try:
        for name, arguments in _CONSUMERS.items():
            words = [str(folder / word) if word.endswith(".parquet") else word for word in arguments]
            with (folder / f"{name}.log").open("w") as log:
                running[name] = subprocess.Popen(
                    list_command(name, *words, "--bus", bus), stdin=subprocess.DEVNULL, stdout=log,
                    stderr=log, text=True, start_new_session=True,
                )  # fmt: skip
        yield running
    finally:
        for process in running.values():
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def read_last_line(log: Path) -> str:
    lines = log.read_text(errors="replace").strip().splitlines()
    return lines[-1] if lines else ""


def end_consumer(consumer: "subprocess.Popen[str]") -> str:
    """Ask a consumer to end; return how it ended if it failed."""
    if consumer.poll() is None:
        consumer.send_signal(signal.SIGINT)
    try:
        code = consumer.wait(_END_PATIENCE)
    except subprocess.TimeoutExpired:
        return f"it did not end within {_END_PATIENCE:g} s"
    return "" if code in (0, 1) else f"exit code {code}"
