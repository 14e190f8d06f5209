"""`clutch-hil up`: plant and controller as two processes on a bus, watched, recorded, judged."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from plant_sim.bench.metadata import run_metadata
from plant_sim.bench.recording import Recording, run_path
from plant_sim.bench.result import Result, judge_run
from plant_sim.bench.status import StatusLine
from plant_sim.profile import load_profile
from plant_sim.rigs import wet_clutch
from protocols.bus import open_bus, resolve
from protocols.errors import InputError
from protocols.ring import RingReader
from protocols.stopping import Stop

_START = 120.0  # s for both services to come up: compiling the kernel for the first time takes some of it
_STOP = 10.0  # s for a service to end once asked
_POLL = 0.05  # s between looks at the rings
Services = dict[str, subprocess.Popen]


@dataclass(frozen=True)
class Bench:
    """Settings of a run. rate [Hz], seconds [s], temperature [degC]; `out` is the folder of the run file."""

    bus: str
    rate: int
    profile: str
    seconds: float | None
    lockstep: bool
    plant_parameters: Path | None
    controller_parameters: Path | None
    seed: int
    temperature: float | None
    law: str
    adaptation: bool
    out: Path

    def run(self, quiet: bool = False) -> Result:
        """Run to the end of the profile or Ctrl-C. Raises InputError; nothing half-written is left then."""
        profile = load_profile(self.profile, self.seconds)
        plant_parameters = wet_clutch.nominal(self.plant_parameters)
        bus = resolve(self.bus)
        open_bus(bus).close()  # a bad bus is told before anything starts
        path = run_path(self.out, profile.name)
        with _workplace() as folder, Stop() as stop:
            cpus = os.sched_getaffinity(0)
            services = self._start(folder, bus)
            try:
                rings = _await_rings(folder, services, stop)
                began = time.monotonic()
                with Recording(path, rings[0].columns, rings[1].columns, self.rate) as recording:
                    self._watch(folder, services, rings, recording, stop, profile.duration, quiet)
                    elapsed = time.monotonic() - began
                    ended: dict[str, Any] = _end(folder, services)
                    plant = rings[0].read()
                    recording.add(plant[plant[:, 0] < profile.duration], rings[1].read())
                    ended["record_rows_lost"] = rings[0].lost + rings[1].lost
                    if self.lockstep:
                        ended["speed"] = ended["plant"]["samples"] / self.rate / elapsed
                    settings = {name: str(value) for name, value in asdict(self).items() if value is not None}
                    recording.finish(
                        run_metadata(self.rate, plant_parameters, ended["controller"].pop("parameters"))
                        | {"settings": settings, "bus": bus, "interrupted": stop.asked, "timing": ended}
                    )
            finally:
                os.sched_setaffinity(0, cpus)
                _abandon(services)
        return judge_run(path, f"profile {profile.name} ({profile.duration:g} s), bus {bus}, {self.rate} Hz", ended)

    def _start(self, folder: Path, bus: str) -> Services:
        cpus = sorted(os.sched_getaffinity(0))
        common = ["--bus", bus, "--rate", str(self.rate)]
        if self.lockstep:
            common.append("--lockstep")
        elif len(cpus) > 1:
            # plant and controller take turns on one CPU, everything else stays off it (realtime.md)
            common += ["--cpu", str(cpus[-1])]
            os.sched_setaffinity(0, set(cpus[:-1]))
        plant = ["plant", *common, "--profile", self.profile, "--seed", str(self.seed)]
        controller = [
            "controller",
            *common,
            "--law",
            self.law,
            "--adaptation" if self.adaptation else "--no-adaptation",
        ]
        plant += _option("--seconds", self.seconds) + _option("--temperature", self.temperature)
        plant += _option("--parameters", self.plant_parameters)
        controller += _option("--parameters", self.controller_parameters)
        return {"plant": _spawn(folder, plant), "controller": _spawn(folder, controller)}

    def _watch(
        self,
        folder: Path,
        services: Services,
        rings: tuple[RingReader, RingReader],
        recording: Recording,
        stop: Stop,
        duration: float,
        quiet: bool,
    ) -> None:
        """Move rows from the rings to the recording and the status line until the plant ends or somebody stops it."""
        with StatusLine(rings[0].columns, rings[1].columns, duration, quiet) as status:
            while not stop.asked:
                ended = [name for name, process in services.items() if process.poll() is not None]
                _check(folder, services)
                if ended and not self.lockstep:
                    raise InputError(f"the {ended[0]} ended before the profile did: somebody stopped it")
                plant, controller = rings[0].read(), rings[1].read()
                recording.add(plant[plant[:, 0] < duration], controller)
                status.show(plant, controller)
                if len(ended) == len(services) or (len(plant) and plant[-1, 0] >= duration):
                    return
                time.sleep(_POLL)


@contextmanager
def _workplace() -> Iterator[Path]:
    """A folder for rings and summaries, in memory where there is /dev/shm; gone afterwards."""
    shared = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(prefix="clutch-hil-", dir=shared if os.access(shared, os.W_OK) else None))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _spawn(folder: Path, arguments: list[str]) -> subprocess.Popen:
    name = arguments[0]
    files = ["--ring", str(folder / f"{name}.ring"), "--summary", str(folder / f"{name}.json")]
    with (folder / f"{name}.log").open("w") as log:
        command = [sys.executable, "-m", "protocols", *arguments, *files]
        return subprocess.Popen(command, stdout=log, stderr=log, stdin=subprocess.DEVNULL)


def _option(name: str, value: object) -> list[str]:
    return [] if value is None else [name, str(value)]


def _check(folder: Path, services: Services) -> None:
    """Raise InputError with a service's own sentence when it has failed."""
    for name, process in services.items():
        if process.poll() not in (None, 0):
            lines = (folder / f"{name}.log").read_text(errors="replace").strip().splitlines() or ["no message"]
            raise InputError(f"the {name} stopped: {lines[-1].removeprefix('error: ')}")


def _await_rings(folder: Path, services: Services, stop: Stop) -> tuple[RingReader, RingReader]:
    deadline = time.monotonic() + _START
    paths = [folder / f"{name}.ring" for name in ("plant", "controller")]
    while not all(path.exists() for path in paths):
        _check(folder, services)
        if stop.asked or time.monotonic() > deadline:
            raise InputError("the services were stopped before they had started")
        time.sleep(_POLL)
    return RingReader(paths[0]), RingReader(paths[1])


def _abandon(services: Services) -> None:
    """End what still runs, by force if need be, controller first."""
    for name in ("controller", "plant"):
        process = services[name]
        if process.poll() is None:
            process.terminate()
            try:
                process.wait(_STOP)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _end(folder: Path, services: Services) -> dict[str, Any]:
    """Stop the services, controller first, so that its safe command still meets a plant; return their summaries."""
    summaries = {}
    for name in ("controller", "plant"):
        process = services[name]
        if process.poll() is None:
            process.terminate()
        try:
            process.wait(_STOP)
        except subprocess.TimeoutExpired:
            raise InputError(f"the {name} did not stop within {_STOP:g} s") from None
        _check(folder, {name: process})
        summaries[name] = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    return summaries
