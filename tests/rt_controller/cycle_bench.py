"""Test bench of the controller's cycle: a node whose cycle is that of a module, real or changed, and frames for it."""

import copy
from collections.abc import Sequence
from types import ModuleType
from typing import Any, NamedTuple
from unittest.mock import patch
from weakref import WeakKeyDictionary

import numpy as np

import rt_controller.loop.node
from protocols.can.frame_batch import load
from protocols.can.frames import Frame, FrameCodec, load_frames
from tests.mutation.plain import view_records

RATE = 1024  # Hz: the period is a sum of halves, so times add up without rounding
PERIOD = 1.0 / RATE  # s
FRAMES, FRAMES_B = load_frames(), load_frames(clutch="b")
ANALOG, ENCODER, SETPOINT, PLANT = (
    FRAMES[name] for name in ("ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT", "PLANT_HEARTBEAT")
)
# What node.py has from cycle.py: replaced while a bench makes or steps its node
_NAMES = ("NODE", "SETTINGS", "OUTBOX", "RECEIVED_FRAMES", "OTHER_CLUTCH_FRAMES", "SENT_FRAMES", "ControllerMemory")

_nodes: WeakKeyDictionary[ModuleType, dict[str | None, Any]] = WeakKeyDictionary()  # to be copied, by module and clutch


class Sent(NamedTuple):
    """A frame that the controller has sent: counter and values in the units of the DBC."""

    counter: int
    values: Any


class CycleBench:
    """A controller node at 1024 Hz whose cycle is `cycle`; `state` and `settings` are its records."""

    def __init__(self, cycle: ModuleType, clutch: str | None = None) -> None:
        self.cycle = cycle
        names = {name: getattr(cycle, name) for name in _NAMES}

        def run_cycle(states: Any, settings: Any, inbox: Any, count: int, slots: int, outbox: Any) -> int:
            return int(
                cycle.run_cycle(*map(view_records, (states, settings, inbox)), count, slots, view_records(outbox))
            )

        def receive_before_start(states: Any, settings: Any, inbox: Any, count: int) -> int:
            return int(cycle.receive_before_start(*map(view_records, (states, settings, inbox)), count))

        self._names = names | {"run_cycle": run_cycle, "receive_before_start": receive_before_start}
        nodes = _nodes.setdefault(cycle, {})
        if clutch not in nodes:
            with self._in_place():
                nodes[clutch] = rt_controller.loop.node.ControllerNode(RATE, clutch=clutch)
        self.node = copy_node(nodes[clutch])
        self.state = self.node.states.view(np.recarray)[0]
        self.settings = self.node.settings.view(np.recarray)[0]
        self.clutch = clutch or "a"
        self.counters: dict[int, int] = {}

    def _in_place(self) -> Any:
        return patch.multiple(rt_controller.loop.node, **self._names)

    def make(self, codec: FrameCodec, **values: float) -> Frame:
        """The next frame of a kind, from raw integers."""
        counter = self.counters[codec.can_id] = self.counters.get(codec.can_id, -1) + 1
        return Frame(codec.can_id, codec.pack_raw(counter, **values))

    def sample(self, tick: int, pressure: int = 700, torque: int = 0, angle: int = 0) -> list[Frame]:
        """Both frames of a sample of the clutch, from raw integers."""
        frames = FRAMES if self.clutch == "a" else FRAMES_B
        analog = self.make(frames["ANALOG_SENSORS"], cylinder_pressure=pressure, oil_temperature=717)
        encoder = self.make(frames["ENCODER"], sample_tick=tick & 0x3FF, motor_torque=torque, shaft_angle=angle)
        return [analog, encoder]

    def demand(self, request: int = 1, torque: int = 1000, speed: int = 5000, pressure: int = 0) -> Frame:
        """A set-point, from raw integers: 10 Nm at 10 rad/s."""
        codec = (FRAMES if self.clutch == "a" else FRAMES_B)["TORQUE_SETPOINT"]
        return self.make(codec, request=request, torque_demand=torque, speed_demand=speed, pressure_demand=pressure)

    def claim(self, session: int, claimed: int = 1) -> Frame:
        """A claim of the set-points of the clutch."""
        codec = (FRAMES if self.clutch == "a" else FRAMES_B)["SUPERVISOR_CLAIM"]
        counter = self.counters[session] = self.counters.get(session, 0) + 1  # each supervisor counts by itself
        return Frame(codec.can_id, codec.pack_raw(counter, claim=claimed, session=session))

    def beat(self, rate: int = RATE) -> Frame:
        """A heartbeat of the plant."""
        return self.make(PLANT, lifecycle=2, rate=rate, session=1)

    def run(self, frames: Sequence[Frame] = (), slots: int = 1) -> dict[str, Sent]:
        """Run a cycle; return what was sent, by the name of its frame without that of its clutch."""
        with self._in_place():
            sent = self.node.step(list(frames), slots)
        return self.read(sent)

    def try_cycle(self, frames: Sequence[Frame]) -> int:
        """Run a cycle; return the number of frames sent, or minus the Refusal."""
        with self._in_place():
            inbox = self.node._inbox
            module = rt_controller.loop.node
            return int(
                module.run_cycle(self.node.states, self.node.settings, inbox, load(inbox, frames), 1, self.node.outbox)
            )

    def listen(self, frames: Sequence[Frame]) -> int:
        """Take frames before the start; return the Refusal, or 0."""
        with self._in_place():
            inbox = self.node._inbox
            module = rt_controller.loop.node
            return int(module.receive_before_start(self.node.states, self.node.settings, inbox, load(inbox, frames)))

    def read(self, frames: Sequence[Frame]) -> dict[str, Sent]:
        """Decode what was sent; each must have its CRC and come once."""
        sent: dict[str, Sent] = {}
        for can_id, data in frames:
            codec = next(c for c in (*self.node.frames.values(), *FRAMES.values()) if c.can_id == can_id)
            assert codec.is_valid(data)
            name = codec.name.removesuffix("_B")
            assert name not in sent
            sent[name] = Sent(data[2], codec.unpack(data))
        return sent

    def read_column(self, name: str) -> float:
        """A value of the record of the last cycle."""
        return float(self.node.record[[column.name for column in self.node.columns].index(name)])

    def start(self, tick: int = 0) -> None:
        """Two good samples and a request for idle: the guard is armed, the clutch may close."""
        self.run([self.beat(), *self.sample(tick), self.demand(request=0)])
        self.run([*self.sample(tick + 1), self.demand(request=0)])

    def close(self, pressure: int = 700) -> None:
        """Go to slip control without the fill, with the plates in contact, and a demand."""
        self.start()
        self.state.phases.phase, self.state.phases.permitted = 2, False
        self.run([*self.sample(2, pressure), self.demand()])


def copy_node(node: Any) -> Any:
    """Return a node in the state of `node`, with memory of its own."""
    other = copy.copy(node)
    other.states, other.settings, other.outbox = (one.copy() for one in (node.states, node.settings, node.outbox))
    other.record, other._state = other.states["record"].view(np.float64), other.states.view(np.recarray)[0]
    other.memory = type(node.memory)(other.states, other.settings, other.outbox, other.record)
    return other
