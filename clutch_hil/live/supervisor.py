"""Supervisor: asks the controller for torque, pressure or lock over the bus (TORQUE_SETPOINT), hears what the services answer.

It lives on the bus alone, without telemetry, so that it works beside a real rig too. A supervisor that stops, dies or
hangs is missed by the controller after 0.1 s, and the clutch is released.
"""

import contextlib
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from clutch_hil.bench.clutch_state import clutch_state
from protocols.buses.bus import Port, listen
from protocols.buses.heartbeat import LISTEN
from protocols.can.frames import Frame, load_frames
from protocols.can.request import Request
from protocols.errors import InputError
from protocols.realtime.clock import Clock

RATE = 200  # Hz: twenty set-points within the 0.1 s after which the controller misses its supervisor
_PRIORITY = 40  # SCHED_FIFO: above ordinary work, below the loops of the services at 80
_SILENCE = 0.5  # s: ten heartbeats or five status frames that did not come
_ANSWER = 0.3  # s, three status frames: what was asked for shows in the status by then
_RELEASE = 2.0  # s to wait for a clutch to be released; it takes 0.2 s


@dataclass(frozen=True)
class Answer:
    """What the bus says now; None is what has not been heard lately.

    `controller` and `plant` are lifecycle states, or `silent`; slip [rad/s] is measured between two looks.
    """

    controller: str
    plant: str
    phase: str | None = None
    fault: str | None = None
    sticking: bool | None = None  # plates touch and stand
    torque_estimate: float | None = None  # Nm, signed as the slip
    friction_level: float | None = None
    pressure: float | None = None  # bar, measured
    temperature: float | None = None  # degC, measured
    clutch_torque: float | None = None  # Nm, measured
    slip: float | None = None  # rad/s

    @property
    def clutch(self) -> str | None:
        """State of the clutch in a word."""
        if self.phase is None or self.sticking is None:
            return None
        return clutch_state(self.phase, self.sticking)


class Heard:
    """The newest frame of each kind and when it came."""

    def __init__(self) -> None:
        frames = load_frames()
        self._codecs = {codec.can_id: codec for codec in frames.values()}
        self._newest: dict[str, tuple[float, Any]] = {}
        self._angle: tuple[int, float] | None = None  # sample tick and shaft angle of the look before
        self._slip: float | None = None
        self._phases = frames["CONTROLLER_STATUS"].choices("phase")
        self._faults = frames["CONTROLLER_STATUS"].choices("fault")
        self._lifecycles = frames["CONTROLLER_HEARTBEAT"].choices("lifecycle")

    def take(self, frames: Sequence[Frame]) -> None:
        """Keep the newest believable frame of each kind."""
        now = time.monotonic()
        for can_id, data in dict(frames).items():
            codec = self._codecs.get(can_id)
            if codec and len(data) == codec.length and codec.valid(data):
                self._newest[codec.name] = now, codec.unpack(data)

    def values(self, name: str) -> Any | None:
        """Values of the newest frame of that name, None when it did not come lately."""
        came, values = self._newest.get(name, (0.0, None))
        return values if time.monotonic() - came <= _SILENCE else None

    def answer(self) -> Answer:
        """Everything at once, for people."""
        status, analog = self.values("CONTROLLER_STATUS"), self.values("ANALOG_SENSORS")
        answer: dict[str, Any] = {"slip": self._measured_slip()}
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
        return Answer(self._lifecycle("CONTROLLER_HEARTBEAT"), self._lifecycle("PLANT_HEARTBEAT"), **answer)

    def _lifecycle(self, name: str) -> str:
        heartbeat = self.values(name)
        return self._lifecycles.get(heartbeat.lifecycle, "unknown") if heartbeat else "silent"

    def _measured_slip(self) -> float | None:
        """Slip from the turn since the look before; a new look needs 20 ms, or the last digit of the encoder shows."""
        encoder, heartbeat = self.values("ENCODER"), self.values("PLANT_HEARTBEAT")
        if encoder is None or heartbeat is None:
            self._angle = self._slip = None
            return None
        if self._angle is None:
            self._angle = encoder.sample_tick, encoder.shaft_angle
        before, angle = self._angle
        seconds = (encoder.sample_tick - before & 0xFFFF) / max(heartbeat.rate, 1)
        if seconds >= 0.02:
            self._slip = (encoder.shaft_angle - angle) / seconds
            self._angle = encoder.sample_tick, encoder.shaft_angle
        return self._slip


class Supervisor:
    """The one supervisor of a bus. `ask` must be called in every cycle of RATE; nothing is sent before.

    Use as a context manager: entering it listens whether the bus is free for it, and makes the process punctual.
    """

    def __init__(self, port: Port) -> None:
        frames = load_frames()
        self.heard = Heard()
        self._port, self._setpoint = port, frames["TORQUE_SETPOINT"]
        self._clock = Clock(1_000_000_000 // RATE)
        self._closing_since: float | None = None
        self._sent = 0

    def __enter__(self) -> "Supervisor":
        """Listen before speaking. Raises InputError when another supervisor speaks or no controller lives."""
        self._take(listen(self._port, LISTEN))
        if (state := self.heard.answer().controller) in ("silent", "finalized"):
            raise InputError(f"no controller is on {self._port.name} ({state}); start one: clutch-hil controller")
        self._policy = os.sched_getscheduler(0), os.sched_getparam(0)
        with contextlib.suppress(PermissionError):  # then a busy machine may delay us by more than the 0.1 s
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_PRIORITY))
        self._clock.start(time.monotonic_ns())
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, *self._policy)

    def ask(self, request: Request, torque: float = 0.0, speed: float = 0.0, pressure: float = 0.0) -> None:
        """Wait for the next slot of the grid, hear the bus, send one set-point.

        torque [Nm], motor speed [rad/s], pressure [bar]. Raises InputError when another supervisor begins to speak.
        """
        self._clock.wait()
        self._take(self._port.receive())
        if not request.closes:
            self._closing_since = None
        elif self._closing_since is None:
            self._closing_since = time.monotonic()
        payload = self._setpoint.pack(self._sent, request, torque, speed, pressure)
        self._port.send(Frame(self._setpoint.can_id, payload))
        self._sent += 1

    def objection(self) -> str | None:
        """Why the controller does not do what it was asked for; None while it does."""
        answer = self.heard.answer()
        if answer.controller in ("silent", "finalized"):
            return f"the controller has gone ({answer.controller})"
        if answer.phase is None:
            return "the controller sends no status: it waits for a plant"
        if answer.phase == "fault":
            return f"fault: {answer.fault}"
        asked_for = time.monotonic() - self._closing_since if self._closing_since is not None else 0.0
        if asked_for > _ANSWER and answer.phase in ("idle", "release"):
            return "clutch let go, as set-points came too late; the controller waits for idle"
        return None

    def idle(self, speed: float) -> None:
        """Ask for idle, which each engagement needs before it, until the controller is. Raises InputError."""
        for cycle in range(round(_RELEASE * RATE)):
            self.ask(Request.IDLE, speed=speed)
            if cycle > _ANSWER * RATE and self.heard.answer().phase == "idle":
                return
        raise InputError(f"the controller on {self._port.name} does not become idle: {self._reason()}")

    def release(self, speed: float) -> bool:
        """Ask for release until the clutch is, 2 s at most, then for idle; return whether it is.

        A fault, which closes the valve too, is left as it is, so that people see it.
        """
        for cycle in range(round(_RELEASE * RATE)):
            self.ask(Request.RELEASE, speed=speed)
            phase = self.heard.answer().phase
            if cycle > _ANSWER * RATE and phase in ("idle", "fault"):
                break
        if phase == "idle":
            for _ in range(round(_ANSWER * RATE)):
                self.ask(Request.IDLE, speed=speed)
        return phase in ("idle", "fault")

    def _reason(self) -> str:
        return self.objection() or f"it is in phase {self.heard.answer().phase}"

    def _take(self, frames: Sequence[Frame]) -> None:
        if any(frame.can_id == self._setpoint.can_id for frame in frames):
            raise InputError(
                f"another supervisor sends TORQUE_SETPOINT on {self._port.name}, as a plant that plays a profile does; "
                "use clutch-hil up --profile manual, or clutch-hil plant without --profile"
            )
        self.heard.take(frames)
