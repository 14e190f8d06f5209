"""Services: start, watch and end plant and controllers as processes of the bench."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from clutch_hil.command import INTERRUPTED
from protocols.errors import InputError
from protocols.kernels.kernel_cache import describe_keeping
from protocols.realtime.child import list_command, spawn
from protocols.realtime.ring import RingCollector
from protocols.realtime.shared_folder import SharedFolder
from protocols.realtime.stopping import Stop

# s without a line from a service that is starting; while it loads and compiles it prints one every 5 s
_START_TIMEOUT = 60.0
_NOTICE_DELAY = 5.0  # s without a line from any service, after which a line reports that the bench waits
_STOP_TIMEOUT = 10.0  # s for a service to end after the request
_POLL_INTERVAL = 0.05  # s between checks
_BAD_VERDICT = 1  # exit code of a service that ended normally and reported a fault
# Lines of a service that are not passed on: its error is raised, and the others are in its summary
IGNORED_PREFIXES = ("error: ", "plant", "controller", " ", "note: ", "verdict: ")
_PLANT = "plant"  # the service that ends last, so that it receives the safe commands of the controllers


class Services:
    """Processes of `clutch-hil ARGUMENTS...` by name, each with a ring and a summary file; one of them is the plant.

    `signalled`: names of those that were sent a signal. Use as a context manager. Leaving it ends the processes that still run,
    by force where needed, and removes their files.
    """

    def __init__(self, commands: Mapping[str, Sequence[str]]) -> None:
        self._shared = SharedFolder()
        self._folder = self._shared.path
        self._commands = dict(commands)
        self._endings = sorted(commands, key=_PLANT.__eq__)
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._read_to = dict.fromkeys(commands, 0)  # bytes of each service's log already read
        self.signalled: set[str] = set()  # services that may end at any time, and leave no summary

    @property
    def names(self) -> Sequence[str]:
        """Return the names of the services."""
        return list(self._commands)

    def __enter__(self) -> "Services":
        for name, arguments in self._commands.items():
            self._processes[name] = self._spawn(name, arguments)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for name in self._endings:
            if not self._stop(name):
                self._processes[name].kill()
                self._processes[name].wait()
        self._shared.remove()

    def wait_for_rings(self, stop: Stop, tell: Callable[[str], None]) -> tuple[RingCollector, ...]:
        """Wait until all services have started; return their rings, in the order of their commands.

        Meanwhile call `tell` with the lines that they print. Raises InputError when a service does not start, InterruptionError
        when `stop` is requested.
        """
        paths = {name: self._folder / f"{name}.ring" for name in self._commands}
        began = last_notice = time.monotonic()
        last_heard, last_line = dict.fromkeys(paths, began), dict.fromkeys(paths, "")
        while missing := [name for name, path in paths.items() if not path.exists()]:
            now = time.monotonic()
            for name, line in self.read_new_lines():
                last_heard[name], last_line[name], last_notice = now, line, now
                if name in missing and not line.startswith(IGNORED_PREFIXES):
                    tell(f"{name}: {line}")
            self.check()
            stop.check(f"the services had not started; nothing was written; {describe_keeping()}")
            for name in missing:
                if now - last_heard[name] > _START_TIMEOUT:
                    raise InputError(_describe_silence(name, last_line[name]))
            if now - last_notice > _NOTICE_DELAY:
                last_notice = now
                tell(f"waiting for {' and '.join(missing)} to start, {now - began:.0f} s")
            time.sleep(_POLL_INTERVAL)
        return tuple(map(RingCollector, paths.values()))

    def read_new_lines(self) -> list[tuple[str, str]]:
        """Return the complete lines that the services have printed since the last call: pairs of service and line."""
        lines = []
        for name, read_before in self._read_to.items():
            with self._log(name).open("rb") as log:
                log.seek(read_before)
                new = log.read()
            whole = new[: new.rfind(b"\n") + 1]
            lines += [(name, line) for line in whole.decode(errors="replace").splitlines() if line]
            self._read_to[name] += len(whole)
        return lines

    def send_signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a service. From now on its end is no error, and its summary may be missing."""
        self.signalled.add(name)
        self._processes[name].send_signal(number)

    def list_ended(self) -> list[str]:
        """Return the names of the services that have ended. Raises InputError for one that failed."""
        self.check()
        return [name for name, process in self._processes.items() if process.poll() is not None]

    def check(self) -> None:
        """Raise InputError with the service's own message when a service has failed."""
        for name, process in self._processes.items():
            if (code := process.poll()) not in (None, 0) and name not in self.signalled:
                if code in (_BAD_VERDICT, -signal.SIGTERM, INTERRUPTED) and self._read_summary(name).exists():
                    continue  # its verdict is bad, or it ended by itself just before the request
                if code is not None and code < 0:
                    raise InputError(f"the {name} was killed by {signal.Signals(-code).name}")
                lines = self._log(name).read_text(errors="replace").strip().splitlines() or ["no message"]
                raise InputError(f"the {name} stopped: {lines[-1].removeprefix('error: ')}")

    def end(self) -> dict[str, Any]:
        """Stop the services and return their summaries by name; a service that was sent a signal may have none.

        Raises InputError when a service fails or does not stop.
        """
        summaries = {}
        for name in self._endings:
            if not self._stop(name):
                raise InputError(f"the {name} did not stop within {_STOP_TIMEOUT:g} s")
            self.check()
            path = self._read_summary(name)
            if path.exists() or name not in self.signalled:
                summaries[name] = json.loads(path.read_text(encoding="utf-8"))
        return summaries

    def _spawn(self, name: str, arguments: Sequence[str]) -> subprocess.Popen[bytes]:
        files = ["--ring", str(self._folder / f"{name}.ring"), "--summary", str(self._read_summary(name))]
        with self._log(name).open("w") as log:
            # Ctrl-C reaches only this process, so that controllers end before the plant
            return spawn(list_command(*arguments, *files), log)

    def _read_summary(self, name: str) -> Path:
        return self._folder / f"{name}.json"

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def _stop(self, name: str) -> bool:
        """Ask a service to end if it still runs; return whether it ended in time."""
        process = self._processes[name]
        if process.poll() is None:
            process.terminate()
            process.send_signal(signal.SIGCONT)  # a stopped process cannot end
        try:
            process.wait(_STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            return False
        return True


def print_line(line: str) -> None:
    """Print a line on stderr."""
    print(line, file=sys.stderr, flush=True)


def _describe_silence(name: str, last: str) -> str:
    """Return why the wait for a service that has not started was ended."""
    busy, cpus = os.getloadavg()[0], len(os.sched_getaffinity(0))
    last_words = f"after its last message {last!r}" if last else "after its launch, without any message"
    return (
        f"the {name} had not started {_START_TIMEOUT:g} s {last_words} (limit {_START_TIMEOUT:g} s without a message);"
        f" its record did not appear; the machine has a load of {busy:.1f} on {cpus} CPUs"
    )
