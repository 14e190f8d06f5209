"""Supervisor: demand torque, pressure or lock over the bus (TORQUE_SETPOINT), and read the status of the services.

It claims the set-points (SUPERVISOR_CLAIM) from its first set-point until it ends, so that the controller follows no other
supervisor. It uses only the bus, without telemetry, so that it also works with a real rig. If it stops, dies or hangs, the
controller notices after 0.1 s and releases the clutch.
"""

import contextlib
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from clutch_hil.bench.clutch_state import find_clutch_state
from protocols.buses.bus import Port, listen
from protocols.buses.heartbeat import LISTEN_SECONDS, make_session
from protocols.can.claim import make_claim_session
from protocols.can.frames import Frame, load_frames
from protocols.can.other_size import SizeWatch
from protocols.can.request import Request
from protocols.errors import InputError
from protocols.realtime.clock import Clock

RATE = 200  # Hz: twenty set-points within the 0.1 s after which the controller detects a missing supervisor
_PRIORITY = 40  # SCHED_FIFO: above ordinary work, below the loops of the services at 80
_FRAME_TIMEOUT = 0.5  # s: ten missing heartbeats or five missing status frames
_STATUS_DELAY = 0.3  # s, three status frames: by then the status shows the effect of a demand
_RELEASE_TIMEOUT = 2.0  # s for a clutch to be released; it takes 0.2 s


@dataclass(frozen=True)
class Answer:
    """Present state on the bus; None for values without a frame in the last half second.

    controller, plant: lifecycle states, or `silent`. slip [rad/s]: measured between two calls.
    """

    controller: str
    plant: str
    phase: str | None = None
    fault: str | None = None
    sticking: bool | None = None  # plates in contact without slip
    torque_estimate: float | None = None  # Nm, with the sign of the slip
    friction_level: float | None = None
    pressure: float | None = None  # bar, measured
    temperature: float | None = None  # degC, measured
    clutch_torque: float | None = None  # Nm, measured
    slip: float | None = None  # rad/s
    supervisor: str | None = None  # unclaimed, claimed or contested: whether a supervisor has claimed the set-points

    @property
    def clutch(self) -> str | None:
        """Return the state of the clutch: open, sliding, sticking or locked; None when unknown."""
        if self.phase is None or self.sticking is None:
            return None
        return find_clutch_state(self.phase, self.sticking)

    def describe_clutch(self) -> str:
        """Return the end of a verdict: state of the clutch, pressure and slip at the end of a demand; "" when unknown."""
        if self.clutch is None or self.pressure is None or self.slip is None:
            return ""
        return f"; at its end the clutch was {self.clutch}, with {self.pressure:.2f} bar and a slip of {self.slip:.1f} rad/s"


class ReceivedFrames:
    """The newest frame of each kind, with its arrival time."""

    def __init__(self) -> None:
        frames = load_frames()
        self._codecs = {codec.can_id: codec for codec in frames.values()}
        self._encoder = encoder = frames["ENCODER"]
        self._turn = encoder.scale["shaft_angle"] * 2 ** encoder.bits["shaft_angle"]  # rad, at which the angle wraps
        self._newest: dict[str, tuple[float, Any]] = {}
        self._angle: tuple[int, float] | None = None  # sample tick and shaft angle of the previous call
        self._slip: float | None = None
        self._phases = frames["CONTROLLER_STATUS"].list_choices("phase")
        self._faults = frames["CONTROLLER_STATUS"].list_choices("fault")
        self._lifecycles = frames["CONTROLLER_HEARTBEAT"].list_choices("lifecycle")
        self._supervisions = frames["CONTROLLER_HEARTBEAT"].list_choices("supervisor")

    def take(self, frames: Sequence[Frame]) -> None:
        """Store the newest valid frame of each kind."""
        now = time.monotonic()
        for can_id, data in dict(frames).items():
            codec = self._codecs.get(can_id)
            if codec and len(data) == codec.length and codec.is_valid(data):
                self._newest[codec.name] = now, codec.unpack(data)

    def find_values(self, name: str) -> Any | None:
        """Return the values of the newest frame of that name; None when it is older than half a second."""
        came, values = self._newest.get(name, (0.0, None))
        return values if time.monotonic() - came <= _FRAME_TIMEOUT else None

    def answer(self) -> Answer:
        """Return the present state of the bus."""
        status, analog = self.find_values("CONTROLLER_STATUS"), self.find_values("ANALOG_SENSORS")
        answer: dict[str, Any] = {"slip": self._measure_slip()}
        if heartbeat := self.find_values("CONTROLLER_HEARTBEAT"):
            answer["supervisor"] = self._supervisions.get(heartbeat.supervisor, str(heartbeat.supervisor))
        if status:
            answer |= {
                "phase": self._phases.get(status.phase, str(status.phase)),
                "fault": self._faults.get(status.fault, str(status.fault)),
                "sticking": bool(status.sticking),
                "torque_estimate": status.torque_estimate,
                "friction_level": status.friction_level,
            }
        if analog:
            answer |= {
                "pressure": analog.cylinder_pressure,
                "temperature": analog.oil_temperature,
                "clutch_torque": analog.clutch_torque,
            }
        return Answer(self._find_lifecycle("CONTROLLER_HEARTBEAT"), self._find_lifecycle("PLANT_HEARTBEAT"), **answer)

    def _find_lifecycle(self, name: str) -> str:
        heartbeat = self.find_values(name)
        return self._lifecycles.get(heartbeat.lifecycle, "unknown") if heartbeat else "silent"

    def _measure_slip(self) -> float | None:
        """Return the slip [rad/s] from the angle since the previous call, 20 ms ago or more for the encoder's resolution."""
        encoder, heartbeat = self.find_values("ENCODER"), self.find_values("PLANT_HEARTBEAT")
        if encoder is None or heartbeat is None:
            self._angle = self._slip = None
            return None
        if self._angle is None:
            self._angle = encoder.sample_tick, encoder.shaft_angle
        before, angle = self._angle
        seconds = self._encoder.wrap("sample_tick", encoder.sample_tick - before) / max(heartbeat.rate, 1)
        if seconds >= 0.02:
            self._slip = ((encoder.shaft_angle - angle + 0.5 * self._turn) % self._turn - 0.5 * self._turn) / seconds
            self._angle = encoder.sample_tick, encoder.shaft_angle
        return self._slip


class Supervisor:
    """The one supervisor of a bus. `ask` must be called at RATE; before its first call nothing is sent.

    Use as a context manager: entering it checks that there is no other supervisor, and raises the priority of the process.
    """

    def __init__(self, port: Port) -> None:
        frames = load_frames()
        self.received = ReceivedFrames()
        self._session = make_claim_session(make_session())
        self._port, self._setpoint = port, frames["TORQUE_SETPOINT"].bind(self._session)
        self._claim = frames["SUPERVISOR_CLAIM"]
        self._claim_every = round(self._claim.cycle_time * RATE)
        self._clock = Clock(1_000_000_000 // RATE)
        self._closing_since: float | None = None
        self._sent = 0

    def __enter__(self) -> "Supervisor":
        """Listen before sending. Raises InputError for another supervisor, no controller, or another number of clutches."""
        heard = listen(self._port, LISTEN_SECONDS)
        SizeWatch(load_frames().values(), f"on {self._port.name}").hear(heard)
        self._take(heard)
        if (state := self.received.answer().controller) in ("silent", "finalized"):
            raise InputError(
                f"no controller is on {self._port.name} ({state}); start one:"
                f" clutch-hil controller --bus {self._port.name}"
            )
        self._policy = os.sched_getscheduler(0), os.sched_getparam(0)
        with contextlib.suppress(PermissionError):  # without it, a busy machine may delay set-points by more than 0.1 s
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_PRIORITY))
        self._clock.start(time.monotonic_ns())
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, *self._policy)
        if self._sent:
            with contextlib.suppress(OSError):  # the bus no longer exists: the controller notices the silence
                self._send_claim(claimed=False)

    def ask(self, request: Request, torque: float = 0.0, speed: float = 0.0, pressure: float = 0.0) -> None:
        """Wait for the next slot of the clock, receive frames, and send one set-point.

        torque [Nm], motor speed [rad/s], pressure [bar]. Raises InputError when another supervisor starts to send.
        """
        self._clock.wait()
        self._take(self._port.receive())
        if not request.closes:
            self._closing_since = None
        elif self._closing_since is None:
            self._closing_since = time.monotonic()
        payload = self._setpoint.pack(
            self._sent, request=request, torque_demand=torque, speed_demand=speed, pressure_demand=pressure
        )
        if self._sent % self._claim_every == 0:
            self._send_claim(claimed=True)
        self._port.send(Frame(self._setpoint.can_id, payload))
        self._sent += 1

    def explain_objection(self) -> str | None:
        """Return why the controller does not follow the demand; None while it does."""
        answer = self.received.answer()
        if answer.controller in ("silent", "finalized"):
            return f"the controller has gone ({answer.controller})"
        if answer.phase is None:
            return "the controller sends no status: it waits for a plant"
        if answer.phase == "fault":
            return f"fault: {answer.fault}"
        asked_for = time.monotonic() - self._closing_since if self._closing_since is not None else 0.0
        if asked_for > _STATUS_DELAY and answer.phase in ("idle", "release"):
            if answer.supervisor == "contested":
                return "another supervisor has claimed the set-points"
            return (
                "clutch released: set-points came too late, or were beyond the controller's torque.demand_limit,"
                " phases.speed_limit or torque.pressure_limit; the controller waits for idle"
            )
        return None

    def demand_idle(self, speed: float) -> None:
        """Demand idle, which must precede each engagement, until the controller is idle. Raises InputError."""
        for cycle in range(round(_RELEASE_TIMEOUT * RATE)):
            self.ask(Request.IDLE, speed=speed)
            if cycle > _STATUS_DELAY * RATE and self.received.answer().phase == "idle":
                return
        raise InputError(f"the controller on {self._port.name} does not become idle: {self._explain_refusal()}")

    def release(self, speed: float) -> bool:
        """Demand release until the clutch is released, for at most 2 s, then idle; return whether it is released.

        A fault closes the valve as well. It is not acknowledged here, so that people see it.
        """
        for cycle in range(round(_RELEASE_TIMEOUT * RATE)):
            self.ask(Request.RELEASE, speed=speed)
            phase = self.received.answer().phase
            if cycle > _STATUS_DELAY * RATE and phase in ("idle", "fault"):
                break
        if phase == "idle":
            for _ in range(round(_STATUS_DELAY * RATE)):
                self.ask(Request.IDLE, speed=speed)
        return phase in ("idle", "fault")

    def _send_claim(self, claimed: bool) -> None:
        counter = -(-self._sent // self._claim_every)  # claims sent before
        self._port.send(Frame(self._claim.can_id, self._claim.pack(counter, claim=claimed, session=self._session)))

    def _explain_refusal(self) -> str:
        return self.explain_objection() or f"it is in phase {self.received.answer().phase}"

    def _take(self, frames: Sequence[Frame]) -> None:
        if any(frame.can_id == self._setpoint.can_id for frame in frames):
            raise InputError(
                f"another supervisor sends TORQUE_SETPOINT on {self._port.name}: end it, such as a panel or a demand; if it is"
                " the plant, which plays a profile, use clutch-hil up --profile manual, or clutch-hil plant without --profile"
            )
        self.received.take(frames)
