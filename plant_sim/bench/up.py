"""`clutch-hil up`: plant and controller as two processes on a bus, watched, recorded, judged."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from plant_sim.bench.metadata import run_metadata
from plant_sim.bench.recording import Recording, run_path, writable
from plant_sim.bench.result import Result, judge_run
from plant_sim.bench.services import Services
from plant_sim.bench.settings import RunSettings
from plant_sim.bench.status import StatusLine
from protocols.bus import open_bus, resolve
from protocols.child import clutch_hil, spawn
from protocols.errors import InputError
from protocols.ring import RingReader
from protocols.stopping import Stop

_POLL = 0.05  # s between looks at the rings
_VIEWER_END = 5.0  # s for a viewer to end once asked
MANUAL = "manual"  # instead of a profile: the demand comes over the bus, from `clutch-hil demand` or `panel`


@dataclass(frozen=True)
class Bench:
    """A run of two processes on `bus`, on their clocks or in lock-step, published over zenoh unless not `telemetry`.

    `viewer` holds the arguments of `clutch-hil view` beside it; None shows nothing.
    """

    settings: RunSettings
    bus: str
    lockstep: bool = False
    telemetry: bool = True
    router: str | None = None
    viewer: Sequence[str] | None = None

    def run(self, quiet: bool = False) -> Result:
        """Run to the end of the profile or Ctrl-C. Raises InputError; nothing half-written is left then."""
        settings = self.settings
        name, duration = self._demand()
        plant_parameters = settings.loaded_plant_parameters()
        settings.new_controller()  # bad settings of the controller are told before anything starts
        bus = resolve(self.bus)
        open_bus(bus).close()
        writable(settings.out)
        cpus = os.sched_getaffinity(0)
        try:
            with Stop() as stop, Services(self._commands(bus, sorted(cpus))) as services, self._viewing(bus):
                rings = services.rings(stop)
                began = time.monotonic()
                path = run_path(settings.out, name)
                with Recording(path, rings[0].columns, rings[1].columns, settings.rate) as recording:
                    self._watch(services, rings, recording, stop, duration, quiet)
                    elapsed = time.monotonic() - began
                    timing = services.end()
                    recording.add(_until(duration, rings[0].read()), rings[1].read())
                    timing["interrupted"] = stop.asked
                    timing["record_rows_lost"] = rings[0].lost + rings[1].lost
                    if self.lockstep:
                        timing["speed"] = timing["plant"]["samples"] / settings.rate / elapsed
                    mode = {"mode": "lock-step" if self.lockstep else "real time"}
                    metadata = run_metadata(settings.rate, plant_parameters, timing["controller"].pop("parameters"))
                    metadata |= {"settings": settings.as_text() | mode, "bus": bus, "interrupted": stop.asked}
                    metadata |= {"parameter_changes": _changes(timing), "timing": timing}
                    recording.finish(metadata)
        finally:
            os.sched_setaffinity(0, cpus)
        what = f"profile {name} ({duration:g} s)" if duration < inf else "demand from the bus"
        return judge_run(path, f"{what}, bus {bus}, {settings.rate} Hz", timing)

    @contextmanager
    def _viewing(self, bus: str) -> Iterator[None]:
        """A viewer beside the run; whatever becomes of it, the run goes on."""
        if self.viewer is None:
            yield
            return
        view = spawn(clutch_hil("view", "--bus", bus, *_option("--router", self.router), *self.viewer), sys.stderr)
        try:
            yield
        finally:
            view.terminate()
            try:
                view.wait(_VIEWER_END)
            except subprocess.TimeoutExpired:
                view.kill()
                view.wait()

    def _demand(self) -> tuple[str, float]:
        """Name and duration [s] of what is asked of the clutch. Raises InputError."""
        if self.settings.profile != MANUAL:
            profile = self.settings.loaded_profile()
            return profile.name, profile.duration
        if self.lockstep:
            raise InputError("profile 'manual' cannot be played in lock-step; allowed is real time")
        return MANUAL, self.settings.seconds or inf

    def _commands(self, bus: str, cpus: list[int]) -> dict[str, list[str]]:
        """Arguments of both services."""
        settings = self.settings
        common = ["--bus", bus, "--rate", str(settings.rate)]
        if self.lockstep:
            common.append("--lockstep")
        elif len(cpus) > 1:
            # plant and controller take turns on one CPU, everything else stays off it (realtime.md)
            common += ["--cpu", str(cpus[-1])]
            os.sched_setaffinity(0, set(cpus[:-1]))
        common += ([] if self.telemetry else ["--no-telemetry"]) + _option("--router", self.router)
        plant = ["--seed", str(settings.seed), *_option("--temperature", settings.temperature)]
        if settings.profile != MANUAL:
            plant += ["--profile", settings.profile, *_option("--seconds", settings.seconds)]
        plant += _option("--parameters", settings.plant_parameters)
        controller = ["--law", settings.law, "--adaptation" if settings.adaptation else "--no-adaptation"]
        controller += _option("--parameters", settings.controller_parameters)
        return {"plant": common + plant, "controller": common + controller}

    def _watch(
        self,
        services: Services,
        rings: tuple[RingReader, RingReader],
        recording: Recording,
        stop: Stop,
        duration: float,
        quiet: bool,
    ) -> None:
        """Move rows from the rings to the recording and the status line until the run ends or somebody stops it."""
        with StatusLine(rings[0].columns, rings[1].columns, duration, quiet) as status:
            while not stop.asked:
                ended = services.ended()
                if ended and not self.lockstep:
                    raise InputError(f"the {ended[0]} ended before the profile did: somebody stopped it")
                plant, controller = rings[0].read(), rings[1].read()
                recording.add(_until(duration, plant), controller)
                status.show(plant, controller)
                if len(ended) == 2 or (len(plant) and plant[-1, 0] >= duration):
                    return
                time.sleep(_POLL)


def _changes(timing: dict[str, Any]) -> list[dict[str, Any]]:
    """Parameters changed in both services; `row` counts the rows of that service, in which the change is first at work."""
    return [
        {"node": node} | change for node in ("plant", "controller") for change in timing[node].pop("parameter_changes")
    ]


def _until(duration: float, plant: np.ndarray) -> np.ndarray:
    """Rows of the plant before `duration` [s]; in real time it goes on until it is stopped."""
    return plant[plant[:, 0] < duration]


def _option(name: str, value: object) -> list[str]:
    return [] if value is None else [name, str(value)]
