"""Test bench of the plant's bus interface: its steps are those of a module, real or changed; its rig is a made-up record."""

import copy
from collections.abc import Sequence
from types import ModuleType
from typing import Any, NamedTuple
from unittest.mock import patch
from weakref import WeakKeyDictionary

import numpy as np

import plant_sim.node.interface
from plant_sim.node.noise import find_address
from plant_sim.node.plant_node import STATE
from plant_sim.node.schedule import Schedule
from plant_sim.rigs import wet_clutch
from protocols.can.frame_batch import load, unload
from protocols.can.frames import Frame, FrameCodec, load_frames
from tests.mutation.plain import view_records

RATE = 1024  # Hz: the period is a sum of halves
PERIOD = 1.0 / RATE  # s
FRAMES, FRAMES_B = load_frames(), load_frames(clutch="b")
VALVE, MOTOR, BEAT = (FRAMES[name] for name in ("VALVE_COMMAND", "MOTOR_COMMAND", "CONTROLLER_HEARTBEAT"))
NOMINAL = wet_clutch.load_nominal()
RIG, _ = Schedule(NOMINAL).make_rig(0.0)
VOLT = 0.000152587890625 * 16384  # V: 16384 counts of the valve's voltage


class Sent(NamedTuple):
    """A frame that the plant has sent: its name, counter and values in the units of the DBC."""

    name: str
    counter: int
    values: Any


class _Board(plant_sim.node.interface.Interface):
    """An interface without a rig."""

    columns = ()

    def show(self) -> int:
        raise AssertionError("a board has no rig")

    def advance(self) -> None:
        raise AssertionError("a board has no rig")


_boards: WeakKeyDictionary[ModuleType, dict[int, Any]] = WeakKeyDictionary()  # to be copied, by module and clutches


def _make_board(plant_cycle: ModuleType, clutches: int) -> _Board:
    names = {
        name: getattr(plant_cycle, name) for name in ("INTERFACE", "SETTINGS", "OUTBOX", "STALE_CYCLES", "GAP_MEMORY")
    }
    with patch.multiple(plant_sim.node.interface, **names):
        return _Board(RATE, [NOMINAL] * clutches, [1, 2][:clutches], 7, np.zeros((0, 5, 1)))


def _copy_board(board: _Board) -> _Board:
    """A board in the state of `board`, with memory and noise of its own."""
    other = copy.copy(board)
    other._interfaces, other._settings = board._interfaces.copy(), board._settings.copy()
    other._generators = [np.random.default_rng(seed) for seed in (1, 2)]
    for k, generator in enumerate(other._generators):
        other._settings["clutches"]["noise_source"][0, k] = find_address(generator)
    return other


class PlantBench:
    """The interface of a plant at 1024 Hz with one or two clutches; `state` and `settings` are its records."""

    def __init__(self, plant_cycle: ModuleType, clutches: int = 1, setpoints: np.ndarray | None = None) -> None:
        self.module = plant_cycle
        boards = _boards.setdefault(plant_cycle, {})
        if clutches not in boards:
            boards[clutches] = _make_board(plant_cycle, clutches)
        self.node = _copy_board(boards[clutches])
        if setpoints is not None:
            self.node._setpoints = setpoints
        self.state = self.node._interfaces.view(np.recarray)[0]
        self.settings = self.node._settings.view(np.recarray)[0]
        self.y = np.zeros(1, STATE)  # of the rig: its sensors read 0
        self.tick, self.late_cycles = -1, 0
        self.counters: dict[int, int] = {}

    def make(self, codec: FrameCodec, **values: float) -> Frame:
        """The next frame of a kind, from raw integers."""
        counter = self.counters[codec.can_id] = self.counters.get(codec.can_id, -1) + 1
        return Frame(codec.can_id, codec.pack_raw(counter, **values))

    def valve(self, tick: int, on: int = 1, counts: int = 16384, codec: FrameCodec = VALVE) -> Frame:
        """A valve command that answers a sample."""
        return self.make(codec, valve_enable=on, valve_voltage=counts, sample_tick=tick & 0x3FF)

    def motor(self, tick: int, on: int = 1) -> Frame:
        """A motor command that answers a sample: 5 rad/s, 20 Nm."""
        return self.make(MOTOR, motor_enable=on, sample_tick=tick & 0x7F, speed_demand=5000, torque_limit=20000)

    def beat(self, rate: int = RATE, lifecycle: int = 2, codec: FrameCodec = BEAT) -> Frame:
        """A heartbeat of a controller."""
        return self.make(codec, lifecycle=lifecycle, rate=rate, session=1)

    def take(self, *frames: Frame) -> int:
        """Take frames; return the Refusal, or 0."""
        node = self.node
        inbox, count = node._inbox, load(node._inbox, frames)
        return int(self.module.take(*map(view_records, (node._interfaces, node._settings, inbox)), count))

    def skip(self, periods: int) -> None:
        """Account for missed periods."""
        self.module.skip_periods(*map(view_records, (self.node._interfaces, self.node._settings)), periods)

    def begin(self, tick: int) -> list[Sent]:
        """Begin the sample `tick`; return the frames of plant and supervisor."""
        node = self.node
        memory = view_records(node._interfaces), view_records(node._settings)
        self.tick = tick
        sent = self.module.begin(*memory, tick, self.late_cycles, node._setpoints, view_records(node.outbox))
        return self.read(0, int(sent))

    def show(self, k: int = 0, sent: int = 0) -> list[Sent]:
        """Show the sensors of clutch `k`; return their frames."""
        node = self.node
        memory = view_records(node._interfaces), view_records(node._settings)
        after = self.module.show(
            *memory, k, self.tick, view_records(self.y), np.zeros(0), view_records(RIG.record), RIG.table.kernel,
            view_records(node.outbox), sent,
        )  # fmt: skip
        return self.read(sent, int(after))

    def read(self, first: int, end: int) -> list[Sent]:
        """Decode frames of the outbox; each must have its CRC."""
        frames = []
        for can_id, data in unload(self.node.outbox[first:end]):
            codec = next(c for c in (*FRAMES.values(), *FRAMES_B.values()) if c.can_id == can_id)
            if codec.name.startswith("TORQUE_SETPOINT"):
                codec = codec.bind(int(self.settings.claim_session))
            assert codec.is_valid(data)
            frames.append(Sent(codec.name, data[2], codec.unpack(data)))
        return frames

    def sample(self, tick: int, *frames: Frame) -> Any:
        """Take frames and make the sample `tick`; return the record of clutch a."""
        self.take(*frames)
        self.begin(tick)
        self.show()
        return self.clutch

    def go_to(self, tick: int) -> None:
        """Begin the sample `tick`, without commands before."""
        self.begin(tick)

    @property
    def clutch(self) -> Any:
        """The record of clutch a."""
        return self.state.clutches[0]

    def list_rejected(self) -> tuple[int, int, int, int]:
        """Refusal, identifier, value and clutch of the first frame that was not used."""
        names = ("why", "id", "value", "clutch")
        why, can_id, value, k = (int(getattr(self.state, f"rejected_{name}")) for name in names)
        return why, can_id, value, k


def read_names(sent: Sequence[Sent]) -> list[str]:
    return [one.name for one in sent]
