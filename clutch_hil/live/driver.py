"""Driver: a supervisor in a thread of its own, which asks for what it was last told to, so that a program can do other things.

A program that keeps Python busy for more than 0.1 s without a pause misses set-points, and the controller lets the clutch go.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from clutch_hil.live.demand_defaults import SPEED
from clutch_hil.live.supervisor import ReceivedFrames, Supervisor
from plant_sim.profiles.profile import IDLE_FIRST, LATEST_TIME, Profile, Setpoint
from protocols.buses.bus import Port, listen, open_bus
from protocols.can.request import Request
from protocols.errors import InputError

# s for the controller to send its phase and to become idle; on a busy machine it may load for so long
_READY_TIMEOUT = 60.0
_LISTEN_TIME = 0.1  # s, as often as the controller's heartbeat comes
_CHECK_INTERVAL = 0.01  # s between looks whether the clutch is released
_IDLE = Profile("idle", (0.0, LATEST_TIME), (0.0, 0.0), (SPEED, SPEED))


@dataclass(frozen=True)
class _Goal:
    """What is asked for: `profile` since `began` [s of the monotonic clock]; `release` the clutch first."""

    profile: Profile
    began: float
    release: bool = False


class Driver:
    """Asks the controller on `bus` for idle, then for what `follow` gives. Use as a context manager: leaving it releases the
    clutch. Raises InputError when there is no controller, or another supervisor.
    """

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._goal = _Goal(_IDLE, time.monotonic())
        self._setpoint = Setpoint(Request.IDLE, 0.0, SPEED, 0.0)
        self._error: Exception | None = None
        self._objection: str | None = None  # why the controller does not do what it was asked for
        self._ready, self._ending = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._drive, name="clutch-hil driver", daemon=True)

    def __enter__(self) -> "Driver":
        self._thread.start()
        if not self._ready.wait(_READY_TIMEOUT):
            self._ending.set()
            raise InputError(f"the controller on {self._bus} did not become idle within {_READY_TIMEOUT:g} s")
        self.check()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()

    def check(self) -> None:
        """Raise InputError for what stopped the set-points, or why the controller does not do what it was asked for."""
        if self._error:
            raise self._error
        if self._objection:
            raise InputError(f"{self._objection}; release() acknowledges it")

    def follow(self, make: Callable[[Setpoint], Profile]) -> None:
        """Ask from now on for the profile that `make` makes of the set-point that is asked for. Raises InputError."""
        self.check()
        # idle has been asked for since the driver began, so that the time for it at a profile's begin is over
        self._goal = _Goal(make(self._setpoint), time.monotonic() - IDLE_FIRST)

    def release(self) -> None:
        """Release the clutch and acknowledge what the controller objects to; return when it is idle. Raises InputError."""
        self._goal = goal = _Goal(_IDLE, time.monotonic(), release=True)
        while self._goal is goal:
            if self._error:
                raise self._error
            time.sleep(_CHECK_INTERVAL)
        self.check()

    def _drive(self) -> None:
        """What the thread does."""
        try:
            with open_bus(self._bus) as port:
                self._await_controller(port)
                with Supervisor(port) as supervisor:
                    supervisor.idle(SPEED)
                    self._ready.set()
                    while not self._ending.is_set():
                        self._ask(supervisor)
                    supervisor.release(self._setpoint.speed)
        except Exception as error:  # told to whoever calls next
            self._error = error
        finally:
            self._ready.set()

    def _await_controller(self, port: Port) -> None:
        """Until the controller tells its phase, which it does once it hears the plant, or nobody waits for it."""
        frames = ReceivedFrames()
        while frames.answer().phase is None and not self._ending.is_set():
            frames.take(listen(port, _LISTEN_TIME))

    def _ask(self, supervisor: Supervisor) -> None:
        """One set-point, or a release."""
        goal = self._goal
        if goal.release:
            supervisor.release(self._setpoint.speed)
            self._objection = None
            try:
                supervisor.idle(self._setpoint.speed)  # which acknowledges a fault
            except InputError as error:
                self._objection = str(error)
            self._goal = _Goal(_IDLE, time.monotonic())
            return
        setpoint = goal.profile.at(time.monotonic() - goal.began)
        if self._objection:
            setpoint = Setpoint(Request.RELEASE, 0.0, setpoint.speed, 0.0)
        supervisor.ask(*setpoint)
        self._setpoint = setpoint
        if setpoint.request.closes:
            self._objection = supervisor.objection()
