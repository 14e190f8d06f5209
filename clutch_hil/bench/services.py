"""Services: plant and controllers as processes of the bench, started, watched and ended together."""

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
from protocols.realtime.child import clutch_hil, spawn
from protocols.realtime.ring import RingReader
from protocols.realtime.shared_folder import SharedFolder
from protocols.realtime.stopping import Stop

_START = 60.0  # s without a word of a service that has not started; while it loads and compiles it says one every 5 s
_SILENCE = 5.0  # s without a word of any, after which we say that we wait
_STOP = 10.0  # s for a service to end once asked
_POLL = 0.05  # s between looks
_JUDGED = 1  # exit code of a service that ended as it should, and has told a fault
# with which a service begins and ends: its error is raised, the rest is in the summary
IGNORED_PREFIXES = ("error: ", "plant", "controller", " ", "note: ", "verdict: ")
_PLANT = "plant"  # the service that ends last, so that every safe command still meets a plant


class Services:
    """Processes of `clutch-hil ARGUMENTS...` by name, with a ring and a summary file each; one of them is the plant.

    Use as a context manager: leaving it ends what still runs, by force if need be, and removes their files.
    """

    def __init__(self, commands: Mapping[str, Sequence[str]]) -> None:
        self._shared = SharedFolder()
        self._folder = self._shared.path
        self._commands = dict(commands)
        self._endings = sorted(commands, key=_PLANT.__eq__)
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._heard = dict.fromkeys(commands, 0)  # characters of a service's log that have been told

    def __enter__(self) -> "Services":
        for name, arguments in self._commands.items():
            self._processes[name] = self._spawn(name, arguments)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for name in self._endings:
            if not self._stopped(name):
                self._processes[name].kill()
                self._processes[name].wait()
        self._shared.remove()

    def rings(self, stop: Stop, tell: Callable[[str], None]) -> tuple[RingReader, ...]:
        """Rings of the services, in the order of their commands, once all have started; meanwhile `tell` what they say.

        Raises InputError when one does not, InterruptionError when `stop` is asked.
        """
        paths = {name: self._folder / f"{name}.ring" for name in self._commands}
        began = told = time.monotonic()
        heard, last = dict.fromkeys(paths, began), dict.fromkeys(paths, "")
        while missing := [name for name, path in paths.items() if not path.exists()]:
            now = time.monotonic()
            for name, line in self.said():
                heard[name], last[name], told = now, line, now
                if name in missing and not line.startswith(IGNORED_PREFIXES):
                    tell(f"{name}: {line}")
            self.check()
            stop.check(f"the services had not started; nothing was written, {describe_keeping()}")
            for name in missing:
                if now - heard[name] > _START:
                    raise InputError(_late(name, last[name]))
            if now - told > _SILENCE:
                told = now
                tell(f"waiting for {' and '.join(missing)} to start, {now - began:.0f} s")
            time.sleep(_POLL)
        return tuple(map(RingReader, paths.values()))

    def said(self) -> list[tuple[str, str]]:
        """Whole lines the services have said since the last call, with the service's name."""
        lines = []
        for name, told in self._heard.items():
            text = self._log(name).read_text(errors="replace")
            end = text.rfind("\n") + 1
            lines += [(name, line) for line in text[told:end].splitlines() if line]
            self._heard[name] = max(end, told)
        return lines

    def ended(self) -> list[str]:
        """Names of the services that have ended well. Raises InputError for one that has not."""
        self.check()
        return [name for name, process in self._processes.items() if process.poll() is not None]

    def check(self) -> None:
        """Raise InputError with a service's own sentence when it has failed."""
        for name, process in self._processes.items():
            if (code := process.poll()) not in (None, 0):
                if code in (_JUDGED, -signal.SIGTERM, INTERRUPTED) and self._summary(name).exists():
                    continue  # its own verdict is bad, or it had ended already when it was asked to
                if code is not None and code < 0:
                    raise InputError(f"the {name} was killed by {signal.Signals(-code).name}")
                lines = self._log(name).read_text(errors="replace").strip().splitlines() or ["it said nothing"]
                raise InputError(f"the {name} stopped: {lines[-1].removeprefix('error: ')}")

    def end(self) -> dict[str, Any]:
        """Stop the services and return their summaries by name. Raises InputError when one fails or does not stop."""
        summaries = {}
        for name in self._endings:
            if not self._stopped(name):
                raise InputError(f"the {name} did not stop within {_STOP:g} s")
            self.check()
            summaries[name] = json.loads(self._summary(name).read_text(encoding="utf-8"))
        return summaries

    def _spawn(self, name: str, arguments: Sequence[str]) -> subprocess.Popen[bytes]:
        files = ["--ring", str(self._folder / f"{name}.ring"), "--summary", str(self._summary(name))]
        with self._log(name).open("w") as log:
            return spawn(clutch_hil(*arguments, *files), log)  # Ctrl-C is ours: controllers end first

    def _summary(self, name: str) -> Path:
        return self._folder / f"{name}.json"

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def _stopped(self, name: str) -> bool:
        """Ask a service to end, if it has not; whether it did in time."""
        process = self._processes[name]
        if process.poll() is None:
            process.terminate()
        try:
            process.wait(_STOP)
        except subprocess.TimeoutExpired:
            return False
        return True


def say(line: str) -> None:
    """Tell a person what a service says."""
    print(line, file=sys.stderr, flush=True)


def _late(name: str, last: str) -> str:
    """Why a service is given up."""
    busy, cpus = os.getloadavg()[0], len(os.sched_getaffinity(0))
    said = f"after it said {last!r}" if last else "after it was begun, and it said nothing"
    return (
        f"the {name} had not started {_START:g} s {said} (limit {_START:g} s without a word); its record was waited for;"
        f" the machine has a load of {busy:.1f} on {cpus} CPUs"
    )
