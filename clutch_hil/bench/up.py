"""`clutch-hil up`: run, watch, record and judge plant and controllers as processes on a bus."""

import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.bench.faults.bench_fault import BenchFaults, Surroundings
from clutch_hil.bench.faults.fault_requests import FaultRequests, answer_request
from clutch_hil.bench.label import Label
from clutch_hil.bench.metadata import make_run_metadata
from clutch_hil.bench.recording import Recording, TooShortError, make_writable, reserve_run_path
from clutch_hil.bench.recovery import recover_folder
from clutch_hil.bench.result import Result
from clutch_hil.bench.scenario import Scenario, load_scenario
from clutch_hil.bench.sealed import SealedRecording
from clutch_hil.bench.services import IGNORED_PREFIXES, Services, print_line
from clutch_hil.bench.settings import MANUAL, RunSettings
from clutch_hil.bench.status import StatusLine
from plant_sim.node.plant_node import convert_initial_temperature
from protocols.buses.bus import open_bus, resolve
from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError, name_file_in_errors
from protocols.files.disk import Disk
from protocols.realtime.child import end_child, list_command, spawn
from protocols.realtime.ring import RingReader
from protocols.realtime.shared_folder import SharedFolder
from protocols.realtime.stopping import Stop
from protocols.telemetry.lab import choose_viewer_network, read_bench_lab
from protocols.telemetry.outlet import RING_ROWS

POLL = 0.05  # s between reads of the rings, which hold several seconds
_VIEWER_TIMEOUT = 5.0  # s for a viewer to end after the request


@dataclass(frozen=True)
class Bench:
    """A scenario on `bus`, run by a plant and a controller for each clutch, each in a separate process.

    lockstep: services wait for each other instead of for the clock. telemetry: publish over zenoh, by `router` (session.py).
    viewer: arguments of an additional `clutch-hil view`; None starts no viewer. blind: keep the truth out of the run file.
    pace: arguments of `clutch-hil controller` that select what triggers its cycles. Raises InputError if it cannot be run.
    """

    scenario: Scenario
    bus: str
    lockstep: bool = False
    telemetry: bool = True
    router: str | None = None
    viewer: Sequence[str] | None = None
    blind: bool = False
    pace: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Raise InputError if the scenario cannot be run."""
        self.scenario.rig.plant.check_blind(self.blind)
        for fault in self.scenario.bench_faults:
            fault.check(resolve(self.bus), self.telemetry)
            if self.lockstep:
                raise InputError(
                    f"the scenario has the fault {fault.what!r}, which --lockstep does not allow, because there both"
                    " sides wait for each other; run it in real time"
                )
        if (celsius := self.scenario.settings.temperature) is not None:
            with name_file_in_errors("scenario", self.scenario.path):
                convert_initial_temperature(celsius)
        if self.lockstep and self.pace:
            raise InputError(f"{self.pace[0]} and --lockstep cannot be combined; lock-step has no clock")

    @property
    def label(self) -> Label:
        """Return the label of the scenario for the result."""
        return Label.of(self.scenario, self.blind)

    def run(self, quiet: bool = False) -> Result:
        """Run to the end of the profile or until Ctrl-C; judge the run. After an InputError the samples until then are kept."""
        self.scenario.rig.check_parts()
        with Stop() as stop, self.start(stop, print_line) as session:
            self._watch(session, stop, quiet)
            try:
                timing = session.finish(interrupted=stop.asked)
            except TooShortError as error:
                stop.check(str(error))  # an interruption soon after the start is no error of the user
                raise
        result: Result = self.scenario.rig.judge(session.path, session.read, self.scenario.limits, timing)
        return result

    @contextmanager
    def start(self, stop: Stop, tell: Callable[[str], None]) -> Iterator["Session"]:
        """Start the services and a run file. Leaving the block ends the services and finishes the run file.

        `tell` is called with the lines that the services print until they have started. Raises InputError, and
        InterruptionError when `stop` is requested.
        """
        settings = self.scenario.settings
        with name_file_in_errors("scenario", self.scenario.path):
            what, duration = self._describe_demand()
            profile = None if settings.profile == MANUAL else self.scenario.load_profile()
            self.scenario.make_controllers(profile)  # raises InputError for bad settings before anything starts
        read_bench_lab(self.router)  # raises InputError for a wrong or expired file, or one of another role
        bus = resolve(self.bus)
        open_bus(bus).close()
        recover_folder(make_writable(settings.out), tell)
        cpus = os.sched_getaffinity(0)
        try:
            with (
                SharedFolder() as folder,
                Services(self._list_commands(bus, sorted(cpus), folder)) as services,
                self._run_viewer(bus),
            ):
                rings = services.wait_for_rings(stop, tell)
                path = reserve_run_path(settings.out, self.label.name)
                read = f"{what}, bus {bus}, {settings.rate} Hz"
                around = Surroundings(services, Disk(), bus, self.telemetry, choose_viewer_network(self.router))
                with (  # a full disk is one until the recording is left
                    BenchFaults(self.scenario.bench_faults, around) as faults,
                    FaultRequests(bus) as requests,
                    self._make_recording(path, rings, around.disk) as recording,
                ):
                    recording.keep_journal(self._make_first_metadata(bus))
                    yield Session(self, read, duration, services, rings, recording, faults, requests)
        finally:
            os.sched_setaffinity(0, cpus)

    def _make_recording(self, path: Path, rings: Sequence[RingReader], disk: Disk) -> Recording:
        plant, *controllers = (ring.columns for ring in rings)
        recorder = SealedRecording if self.blind else Recording
        return recorder(path, plant, controllers, self.scenario.settings.rate, disk=disk)

    def _make_metadata(self, timing: dict[str, Any]) -> dict[str, Any]:
        """Return the metadata of the run; moves parameters and injections out of the summaries in `timing`."""
        scenario, parameters = self.scenario, self._list_controller_parameters()
        for name in parameters:
            if name in timing:  # a service that was killed has no summary
                timing[name].pop("injections")
                parameters[name] = timing[name].pop("parameters")
        injections = timing["plant"].pop("injections") if "plant" in timing else []
        mode = "lock-step" if self.lockstep else "real time"
        return make_run_metadata(scenario, parameters, injections, mode)

    def _make_first_metadata(self, bus: str) -> dict[str, Any]:
        """Return the metadata known at the start of the run; planned injections may not have begun."""
        mode = "lock-step" if self.lockstep else "real time"
        return make_run_metadata(self.scenario, self._list_controller_parameters(), [], mode) | {"bus": bus}

    def _list_controller_parameters(self) -> dict[str, Mapping[str, float]]:
        """Return the parameters with which each controller starts, by its name."""
        settings = self.scenario.settings
        return {
            name: settings.make_controller(clutch).parameters.as_values()
            for name, clutch in self.scenario.rig.plant.controllers.items()
        }

    def _show_status(self, rings: Sequence[RingReader], duration: float, quiet: bool) -> StatusLine:
        status: StatusLine = self.scenario.rig.status(rings[0].columns, rings[1].columns, duration, quiet, self.blind)
        return status

    @contextmanager
    def _run_viewer(self, bus: str) -> Iterator[None]:
        """Run a viewer while entered, if one is wanted. Its failure does not stop the run."""
        if self.viewer is None:
            yield
            return
        network = _format_option("--router", choose_viewer_network(self.router))
        view = spawn(list_command("view", "--bus", bus, *network, *self.viewer), sys.stderr)
        try:
            yield
        finally:
            end_child(view, _VIEWER_TIMEOUT)

    def _describe_demand(self) -> tuple[str, float]:
        """Return the source of the demand as text, and its length [s]. Raises InputError."""
        scenario, settings = self.scenario, self.scenario.settings
        if settings.profile != MANUAL:
            duration = scenario.duration
            return self.label.read(duration), duration
        if self.lockstep:
            raise InputError("profile 'manual' cannot be played in lock-step; run it in real time")
        return f"demand from the bus{self.label.changes}", settings.seconds or inf

    def _list_commands(self, bus: str, cpus: list[int], folder: Path) -> dict[str, list[str]]:
        """Return the arguments of the services by name; files that they read are written to `folder`."""
        scenario, settings, rig = self.scenario, self.scenario.settings, self.scenario.rig.plant
        common = ["--bus", bus, "--rate", str(settings.rate)]
        if self.lockstep:
            common.append("--lockstep")
        elif len(cpus) > 1:
            # plant and controller take turns on one CPU; everything else stays off it (docs/timing.md)
            common += ["--cpu", str(cpus[-1])]
            os.sched_setaffinity(0, set(cpus[:-1]))
        common += ([] if self.telemetry else ["--no-telemetry"]) + _format_option("--router", self.router)
        plant = [
            "--rig",
            rig.name,
            "--seed",
            str(settings.seed),
            *_format_option("--temperature", settings.temperature),
        ]
        plant += ["--profile", settings.profile, *_format_option("--seconds", settings.seconds)]
        plant += _format_option("--scenario", scenario.path) + _format_option(
            "--parameters", self._write_plant_file(folder)
        )
        plant += ["--blind"] if self.blind else []
        controller = ["--law", settings.law, "--adaptation" if settings.adaptation else "--no-adaptation"]
        controllers = {
            name: [
                "controller", *common, *controller,
                *_format_option("--parameters", settings.write_controller_file(folder, clutch)),
                *self.pace, *_format_option("--clutch", clutch),
            ]
            for name, clutch in rig.controllers.items()
        }  # fmt: skip
        return {"plant": ["plant", *common, *plant], **controllers}

    def _write_plant_file(self, folder: Path) -> Path | None:
        """Return a file, new in `folder` where needed, with the plant changes that are not in the scenario's file."""
        scenario, settings = self.scenario, self.scenario.settings
        if scenario.plant.as_values() == self._read_plant_values(settings.plant_parameters):
            return settings.plant_parameters
        shipped, path = self._read_plant_values(None), folder / "plant.toml"
        changed = {name: value for name, value in scenario.plant.as_values().items() if value != shipped[name]}
        path.write_text("".join(f"{name} = {value!r}\n" for name, value in changed.items()), encoding="utf-8")
        return path

    def _read_plant_values(self, changed: Path | None) -> Mapping[str, float]:
        """Return the parameters of the plant as its process reads them from the scenario's file and the file `changed`."""
        scenario = self.scenario
        if scenario.path:
            return load_scenario(str(scenario.path), {"plant_parameters": changed}).plant.as_values()
        return Scenario.of(RunSettings(plant_parameters=changed), scenario.rig.name).plant.as_values()

    def _watch(self, session: "Session", stop: Stop, quiet: bool) -> None:
        """Step a session and show its status until the run ends or is stopped."""
        with self._show_status(session.rings, session.duration, quiet) as status:
            while not (stop.asked or session.over):
                plant, controller, *_ = session.step()
                for line in session.take_news():
                    status.note(line)
                status.show(plant, controller)
                if not session.over:
                    time.sleep(POLL)


class Session:
    """A running bench: its services, whose rows it moves to the run file at `path`.

    read: description of the run. duration: of the profile [s], infinite where the demand comes from the bus.
    """

    def __init__(
        self,
        bench: Bench,
        read: str,
        duration: float,
        services: Services,
        rings: Sequence[RingReader],
        recording: Recording,
        faults: BenchFaults,
        requests: FaultRequests,
    ) -> None:
        self.bus, self.read, self.duration = faults.around.bus, read, duration
        self.rings, self.path = rings, recording.path
        self.over = False  # whether the profile has ended
        self._bench, self._services, self._recording = bench, services, recording
        self._faults, self._requests = faults, requests
        self._end = duration  # s: later rows of the plant do not belong to the run
        self._began = time.monotonic()

    def step(self) -> list[np.ndarray]:
        """Move new rows to the run file; return those of the plant, then of each controller, shape (rows, columns).

        Call it every POLL [s]. Raises InputError when a service has failed or was stopped.
        """
        try:
            ended_services = self._services.list_ended()
            if ended_services and not (self._bench.lockstep or self._services.signalled):
                raise InputError(f"the {ended_services[0]} ended before the end of the profile: somebody stopped it")
        except InputError:
            self._take_rows()  # the last rows are kept as well
            raise
        plant, *controllers = self._take_rows()
        self._faults.play(plant[-1, 0] if len(plant) else None)
        self._requests.answer(partial(answer_request, self._faults, end=self.duration))
        self.over = len(ended_services) == len(self.rings) or bool(len(plant) and plant[-1, 0] >= self.duration)
        self.over = self.over or ("plant" in self._services.signalled and "plant" in ended_services)
        return [plant, *controllers]

    def _take_rows(self) -> list[np.ndarray]:
        """Move new rows to the run file; return those of the plant, then of each controller.

        Raises InputError where rows are missing: a run has a row for each sample.
        """
        plant, *controllers = [ring.read() for ring in self.rings]
        if lost := sum(ring.lost for ring in self.rings):
            raise InputError(
                f"{lost} rows of the services were overwritten before they were read: this process was stopped, or had no CPU,"
                f" for {RING_ROWS / self._bench.scenario.settings.rate:.0f} s"
            )
        self._recording.add(plant[plant[:, 0] < self._end], *controllers)
        return [plant, *controllers]

    def take_news(self) -> list[str]:
        """Return the lines that the services have printed since the last call, with their names."""
        return [
            f"{name}: {line}" for name, line in self._services.read_new_lines() if not line.startswith(IGNORED_PREFIXES)
        ]

    def finish(self, interrupted: bool) -> dict[str, Any]:
        """Stop the services and finish the run file; return the summaries of the services. Raises InputError.

        The run ends with the present rows: later rows are from after the end of the controllers.
        """
        bench = self._bench
        self._take_rows()
        self._end = 0.0
        elapsed = time.monotonic() - self._began
        self._faults.end_all()  # a flood of requests would prevent the telemetry from ending
        timing = self._services.end()
        self._take_rows()
        timing["interrupted"] = interrupted
        if bench.lockstep:
            timing["speed"] = timing["plant"]["samples"] / bench.scenario.settings.rate / elapsed
        metadata = bench._make_metadata(timing)
        metadata |= {
            "bus": self.bus,
            "interrupted": interrupted,
            "parameter_changes": _take_changes(timing),
            "requests": _take_requests(timing),
            "bench_faults": self._faults.log,
            "timing": timing,
        }
        self._recording.finish(metadata)
        return timing


def _take_changes(timing: dict[str, Any]) -> list[dict[str, Any]]:
    """Return parameter changes in the services, and remove them from `timing`. `row`: its first row in that service."""
    return [
        {"node": node} | change
        for node in ("plant", *CONTROLLERS)
        if node in timing
        for change in timing[node].pop("parameter_changes")
    ]


def _take_requests(timing: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the changes and demands that the services accepted, in order of time, and remove them from `timing`."""
    nodes = [node for node in ("plant", *CONTROLLERS) if node in timing]
    logged = [{"node": node} | request for node in nodes for request in timing[node].pop("requests")]
    return sorted(logged, key=lambda request: request["time"])


def _format_option(name: str, value: object) -> list[str]:
    return [] if value is None else [name, str(value)]
