"""Driver: a supervisor in a separate thread. It sends the set-points of the last demand while the program does other things.

If the program blocks Python for more than 0.1 s without a pause, set-points are missing, and the controller releases the
clutch.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from clutch_hil.live.driving.demand_defaults import SPEED
from clutch_hil.live.driving.supervisor import ReceivedFrames, Supervisor
from plant_sim.profiles.profile import IDLE_FIRST, LATEST_TIME, Profile, Setpoint
from protocols.buses.bus import Port, listen, open_bus
from protocols.can.frames import load_frames
from protocols.can.other_size import SizeWatch
from protocols.can.request import Request
from protocols.errors import InputError

# s for the controller to send its phase and to become idle; on a busy machine loading may take this long
_READY_TIMEOUT = 60.0
_LISTEN_TIME = 0.1  # s, the period of the controller's heartbeat
_CHECK_INTERVAL = 0.01  # s between checks whether the clutch is released
_IDLE = Profile("idle", (0.0, LATEST_TIME), (0.0, 0.0), (SPEED, SPEED))


@dataclass(frozen=True)
class _Goal:
    """The present demand: `profile`, played since `began` [s of the monotonic clock], or a `release` of the clutch."""

    profile: Profile
    began: float
    release: bool = False


class Driver:
    """Demand idle from the controller on `bus`, then the profile of the last `follow`.

    Use as a context manager: leaving it releases the clutch. Raises InputError if there is no controller, or if there is
    another supervisor.
    """

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._goal = _Goal(_IDLE, time.monotonic())
        self._setpoint = Setpoint(Request.IDLE, 0.0, SPEED, 0.0)
        self._error: Exception | None = None
        self._objection: str | None = None  # reason why the controller does not follow the demand
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
        """Raise InputError if the set-points have stopped, or if the controller does not follow the demand."""
        if self._error:
            raise self._error
        if self._objection:
            raise InputError(f"{self._objection}; acknowledge it with release()")

    def follow(self, make: Callable[[Setpoint], Profile]) -> None:
        """Demand the profile `make(setpoint)` from now on, made from the present set-point. Raises InputError."""
        self.check()
        # a profile begins with idle for the time IDLE_FIRST; the driver has demanded idle before, so that part is skipped
        self._goal = _Goal(make(self._setpoint), time.monotonic() - IDLE_FIRST)

    def release(self) -> None:
        """Release the clutch and acknowledge a fault; return when the controller is idle. Raises InputError."""
        self._goal = goal = _Goal(_IDLE, time.monotonic(), release=True)
        while self._goal is goal:
            if self._error:
                raise self._error
            time.sleep(_CHECK_INTERVAL)
        self.check()

    def _drive(self) -> None:
        """Run the supervisor, in the thread."""
        try:
            with open_bus(self._bus) as port:
                self._await_controller(port)
                with Supervisor(port) as supervisor:
                    supervisor.demand_idle(SPEED)
                    self._ready.set()
                    while not self._ending.is_set():
                        self._ask(supervisor)
                    supervisor.release(self._setpoint.speed)
        except Exception as error:  # raised by the next call of `check` or `release`
            self._error = error
        finally:
            self._ready.set()

    def _await_controller(self, port: Port) -> None:
        """Wait until the controller sends its phase, which it does once it hears the plant, or until the driver ends."""
        frames, watch = ReceivedFrames(), SizeWatch(load_frames().values(), f"on {port.name}")
        while frames.answer().phase is None and not self._ending.is_set():
            heard = listen(port, _LISTEN_TIME)
            watch.hear(heard)
            frames.take(heard)

    def _ask(self, supervisor: Supervisor) -> None:
        """Send one set-point, or release the clutch."""
        goal = self._goal
        if goal.release:
            supervisor.release(self._setpoint.speed)
            self._objection = None
            try:
                supervisor.demand_idle(self._setpoint.speed)  # idle acknowledges a fault
            except InputError as error:
                self._objection = str(error)
            self._goal = _Goal(_IDLE, time.monotonic())
            return
        setpoint = goal.profile.interpolate(time.monotonic() - goal.began)
        if self._objection:
            setpoint = Setpoint(Request.RELEASE, 0.0, setpoint.speed, 0.0)
        supervisor.ask(*setpoint)
        self._setpoint = setpoint
        if setpoint.request.closes:
            self._objection = supervisor.explain_objection()
