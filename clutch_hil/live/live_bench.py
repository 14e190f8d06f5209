"""Live bench for Python: plant and controller as processes on a bus, which a program drives, tunes, disturbs and records."""

import threading
import time
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from math import inf, isfinite
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any

import zenoh

from clutch_hil.bench.arguments import take_list, take_mapping, take_number
from clutch_hil.bench.in_memory import Values, compose_scenario, take_effects
from clutch_hil.bench.run_file import read_run
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import MANUAL, select_settings
from clutch_hil.bench.up import POLL, Bench
from clutch_hil.live.driving.demand import lock_profile, make_pressure_profile, make_torque_profile
from clutch_hil.live.driving.demand_defaults import PRESSURE_RAMP, SPEED, TORQUE_RAMP
from clutch_hil.live.driving.driver import Driver
from clutch_hil.live.tuning.catalogue import parse_assignments
from clutch_hil.live.tuning.inject import inject, list_injection_values
from clutch_hil.live.tuning.tune import change_parameters, list_parameters
from plant_sim.profiles.profile import load_profile
from protocols.errors import InputError
from protocols.files.run import Run
from protocols.realtime.stopping import Stop
from protocols.telemetry.feed import list_live_nodes
from protocols.telemetry.keys import make_bench_name
from protocols.telemetry.session import open_consumer_session

_TELEMETRY = 10.0  # s for all services to publish; they begin to publish before they run


def start_bench(
    scenario: str | Path | None = None,
    *,
    profile: str | Path | None = None,
    bus: str = "auto",
    lockstep: bool = False,
    seconds: float | None = None,
    rate: int | None = None,
    seed: int | None = None,
    temperature: float | None = None,
    law: str | None = None,
    adaptation: bool | None = None,
    plant_parameters: str | Path | None = None,
    controller_parameters: str | Path | None = None,
    plant: Values | None = None,
    controller: Values | None = None,
    effects: Iterable[str] | Mapping[str, Values] = (),
) -> "LiveBench":
    """Start plant and controller as processes on `bus`, as `clutch-hil up` does, and return when they run.

    Without `scenario` and `profile` the bench waits for calls such as `demand_torque`; otherwise the profile gives the demand.
    `bus` is vcan0, can0, local:NAME, or auto, which is vcan0 if it is up. With `lockstep` the profile is played without a
    clock, as fast as the machine allows, with bit-identical results. Other arguments are those of `simulate`.

    Use it as a context manager in the main thread: the processes end in any case when the block is left. In real time the
    program stays off the CPU of the processes. No run file is kept. Raises InputError.
    """
    settings = select_settings(locals())
    if not isinstance(bus, str):
        raise InputError(f"bus is {bus!r}; allowed is the name of a bus, such as vcan0, local:NAME and auto")
    if not (scenario or profile):
        settings["profile"] = MANUAL
    return LiveBench(compose_scenario(scenario, settings, plant, controller, effects), bus, lockstep)


class LiveBench:
    """A running bench, made by `start_bench`. Its processes end at `stop`, or when its block as a context manager is left."""

    def __init__(self, scenario: Scenario, bus: str, lockstep: bool) -> None:
        self._ending = threading.Event()
        self._error: Exception | None = None
        self._values: dict[str, float] = {}
        self._telemetry: tuple[zenoh.Session, str] | None = None
        self._driver: Driver | None = None
        self._nodes = {"plant", *scenario.rig.plant.controllers}
        with ExitStack() as stack:
            folder = Path(stack.enter_context(TemporaryDirectory()))
            scenario = replace(scenario, settings=replace(scenario.settings, out=folder))
            bench = Bench(scenario, bus, lockstep, telemetry=True)
            self._session = stack.enter_context(bench.start(Stop(), lambda text: None))
            self._recorder = threading.Thread(target=self._record, name="clutch-hil recorder", daemon=True)
            self._recorder.start()
            stack.callback(self._end_recorder)
            if scenario.settings.profile == MANUAL:
                self._driver = stack.enter_context(Driver(self._session.bus))
            self._stack = stack.pop_all()

    def __enter__(self) -> "LiveBench":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()
        self._error = self._error or InputError("this bench ended at the end of its with block; start another one")

    def __repr__(self) -> str:
        return f"<LiveBench on {self.bus}{', ended' if self._error else ''}>"

    @property
    def bus(self) -> str:
        """Return the name of the bus, for other commands such as `clutch-hil view --bus`."""
        return self._session.bus

    def demand_torque(self, torque: float, speed: float = SPEED, ramp: float = TORQUE_RAMP) -> None:
        """Demand a torque [Nm] at a motor speed [rad/s], reached from the present demand with `ramp` [Nm/s]; return at once.

        Raises InputError for an impossible demand, and if the controller did not follow the previous demand.
        """
        torque, speed, ramp = take_number("torque", torque), take_number("speed", speed), take_number("ramp", ramp)
        self._get_driver().follow(lambda now: make_torque_profile(torque, speed, None, ramp, now.torque))

    def demand_pressure(self, pressure: float, speed: float = SPEED, ramp: float = PRESSURE_RAMP) -> None:
        """Demand a cylinder pressure [bar] at a motor speed [rad/s], reached with `ramp` [bar/s]; see `demand_torque`."""
        pressure, speed, ramp = (
            take_number("pressure", pressure),
            take_number("speed", speed),
            take_number("ramp", ramp),
        )
        self._get_driver().follow(lambda now: make_pressure_profile(pressure, speed, None, ramp, now.pressure))

    def demand_lock(self, speed: float = SPEED) -> None:
        """Demand a locked clutch, at a motor speed [rad/s]; see `demand_torque`."""
        speed = take_number("speed", speed)
        self._get_driver().follow(lambda now: lock_profile(speed, None))

    def demand_profile(self, profile: str | Path) -> None:
        """Play the demands of a profile from now on, a shipped name or the path of a CSV file; see `demand_torque`."""
        self._get_driver().follow(lambda now: load_profile(str(profile)))

    def release(self) -> None:
        """Release the clutch, acknowledge a fault, and return when the controller is idle. Raises InputError."""
        self._get_driver().release()

    def wait(self, seconds: float | None = None) -> None:
        """Let the bench run for `seconds` [s], or to the end of its profile if None.

        Raises InputError when a service has ended, or when the controller does not follow the demand.
        """
        if seconds is not None and not 0.0 <= (seconds := take_number("seconds", seconds)) < inf:
            raise InputError(f"seconds is {seconds:g}; allowed are 0 and more")
        if seconds is None and not isfinite(self._session.duration):
            raise InputError("the bench has no profile with an end to wait for; give seconds")
        end = time.monotonic() + (float("inf") if seconds is None else seconds)
        while (left := end - time.monotonic()) > 0.0 and not (seconds is None and self._session.over):
            self._check()
            time.sleep(min(POLL, left))
        self._check()

    def values(self) -> dict[str, float]:
        """Return the newest value of every column of plant and controllers, by its name in a run, in the unit it has there."""
        self._check()
        return dict(self._values)

    def parameters(self) -> dict[str, float]:
        """Return every parameter of plant and controller by full name, as `controller.torque.integral_gain`, in its unit.

        Raises InputError.
        """
        return {
            name: float(entry["value"]) for name, entry in list_parameters(*self._connect_telemetry()).entries.items()
        }

    def tune(self, values: Values) -> list[dict[str, Any]]:
        """Set parameters by name, with or without `plant.` or `controller.` before it, in declared units, between two cycles.

        Return the changes: node, name, old, new, unit, and `row`, the first sample of that node with the new value. All names
        and values are checked before any is set. Raises InputError.
        """
        numbers = {name: take_number(name, value) for name, value in take_mapping("values", values).items()}
        published = self._connect_telemetry()
        wanted = parse_assignments(
            list_parameters(*published), [f"{name}={value!r}" for name, value in numbers.items()]
        )
        return change_parameters(*published, wanted)

    def inject(
        self,
        effects: str | Iterable[str] | Mapping[str, Values] = (),
        *,
        plant: Values | None = None,
        freeze: Iterable[str] = (),
        bias: Values | None = None,
        off: bool = False,
        at: float | None = None,
        after: float | None = None,
        ramp: float | None = None,
        until: float | None = None,
        lasting: float | None = None,
    ) -> list[dict[str, Any]]:
        """Switch effects of the plant on, with typical or given values by short name, or `off`; change parameters and sensors.

        plant: parameters by dotted name, in declared units. freeze: sensors that keep their value. bias: offset by sensor,
        added to its value. The change begins `at` [s of the plant's time], `after` [s from now], or now. It takes `ramp` [s].
        It is undone at `until` [s of the plant's time], or `lasting` [s] after it is complete.

        Return the changes that the plant has planned: name, old, new, unit, `at` [s] and `row`. Raises InputError.
        """
        added = {
            what: {name: take_number(name, value) for name, value in take_mapping(what, values).items()}
            for what, values in (("plant", plant), ("bias", bias))
        }
        values = list_injection_values(
            take_effects(effects), added["plant"], tuple(take_list("freeze", freeze)), added["bias"], off
        )
        if not values:
            raise InputError("the injection has no change; give effects, plant, freeze or bias")
        times = {"at": at, "after": after, "ramp": ramp, "until": until, "for": lasting}
        when = {name: take_number(name, seconds) for name, seconds in times.items() if seconds is not None}
        return inject(*self._connect_telemetry(), values, when)

    def stop(self) -> Run:
        """Release the clutch and end the processes; return the run since the start: columns of a run file, each (samples,).

        A fault of the controller is part of the run and raises no error. Raises InputError if a service failed, if there are
        fewer than two samples, or if the run is too long to be read into memory; with one clutch, 630 s at 1 kHz can be read. A
        run that is not read is kept in a file that the error names.
        """
        self._check_lives()
        if self._driver:
            self._driver.__exit__()
        self._end_recorder()
        if self._error:
            raise self._error
        self._session.finish(interrupted=isfinite(self._session.duration) and not self._session.over)
        try:
            return read_run(self._session.path)
        except InputError as error:
            kept = _keep(self._session.path)
            raise InputError(f"{str(error).replace(str(self._session.path), str(kept))}; it is kept there") from None
        finally:
            self._stack.close()
            self._error = InputError("this bench has been stopped; start another one")

    def _record(self) -> None:
        """Record rows, in the thread of the recorder."""
        names = [
            [f"{prefix}{column.name}" for column in ring.columns]
            for ring, prefix in zip(self._session.rings, ("", "controller_", "controller_b_"), strict=False)
        ]
        try:
            while not (self._ending.is_set() or self._session.over):
                for columns, rows in zip(names, self._session.step(), strict=True):
                    if len(rows):
                        self._values = self._values | dict(zip(columns, rows[-1].tolist(), strict=True))
                self._ending.wait(POLL)
        except Exception as error:  # raised by the next call
            self._error = error

    def _end_recorder(self) -> None:
        self._ending.set()
        self._recorder.join()

    def _check(self) -> None:
        """Raise the error of the recorder or of the driver, if there was one."""
        self._check_lives()
        if self._driver:
            self._driver.check()

    def _check_lives(self) -> None:
        """Raise the error of the recorder, or an InputError if the bench has been stopped."""
        if self._error:
            raise self._error

    def _get_driver(self) -> Driver:
        """Return the driver that sends demands to the controller.

        Raises InputError if the demand comes from a profile, and the error of the recorder, if there was one.
        """
        if self._driver is None:
            raise InputError("this bench plays its profile; for demands, start it without scenario and profile")
        self._check_lives()
        return self._driver

    def _connect_telemetry(self) -> tuple[zenoh.Session, str]:
        """Connect to the telemetry of the bench: return a session and the bench's name. Raises InputError if there is none."""
        self._check_lives()
        if self._telemetry is None:
            session, name = self._stack.enter_context(open_consumer_session()), make_bench_name(self._session.bus)
            deadline = time.monotonic() + _TELEMETRY
            while not self._nodes <= set(list_live_nodes(session, name)):
                self._check()
                if time.monotonic() > deadline:
                    raise InputError(f"the services on {self._session.bus} did not publish within {_TELEMETRY:g} s")
                time.sleep(POLL)
            self._telemetry = session, name
        return self._telemetry


def _keep(path: Path) -> Path:
    """Move a file from a temporary folder to a permanent one; return its new path."""
    return path.rename(Path(mkdtemp(prefix="clutch-hil-run-")) / path.name)
