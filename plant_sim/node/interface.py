"""Interface: what is between the bus and the clutches of a rig: commands in, the frames of a sample out.

Decoding, checks, data acquisition and encoding are compiled calls (`cycle.py`), as the controller's cycle is.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from plant_sim.node.noise import address
from plant_sim.node.plant_cycle import (
    CLUTCH_FRAMES,
    INTERFACE,
    OUTBOX,
    SETTINGS,
    SHARED_FRAMES,
    Refusal,
    begin,
    show,
    slept,
    take,
)
from plant_sim.rigs.wet_clutch import Rig, Whole
from protocols.can.frame_batch import batch, load, unload
from protocols.can.frames import Frame, FrameCodec, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.can.reception import counted, receptions
from protocols.can.two_clutches import CLUTCHES
from protocols.can.words import frame_definition
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.node import Column

INBOX = 4096  # frames that `receive` takes at once: more than a bus of 1 Mbit/s carries in 0.2 s
_NO_FRAME = -1  # an identifier that no frame has


class Interface(ABC):
    """The clutches of a rig on the bus: the base of its node, which moves them and tells of them.

    rate [Hz]; `parameters`, `seeds` of the sensors' noise: one of each clutch; `session` tells two plants apart; `setpoints`
    are the tables of the clutches' profiles, shape (clutches, 5, rows), see `profile.setpoint`, or (0, 5, 0).

    Of the last sample `tick` is the number, -1 before the first, `outbox` holds the frames, shape (OUTBOX,) of batch.FRAME, and
    `record` the row, shape (columns,).
    """

    columns: tuple[Column, ...]

    def __init__(
        self, rate: int, parameters: Sequence[ParameterSet], seeds: Sequence[int], session: int, setpoints: np.ndarray
    ) -> None:
        self.rate, self.tick = rate, -1
        self.late_cycles = 0  # set by the service for PLANT_STATUS
        self.outbox, self.record = batch(OUTBOX), np.zeros(len(self.columns))
        self._period, self._session, self._setpoints = 1.0 / rate, session, setpoints
        self._names = CLUTCHES[: len(parameters)]
        self._inbox = batch(INBOX)
        self._interfaces, self._settings = np.zeros(1, INTERFACE), np.zeros(1, SETTINGS)
        self._interface = self._interfaces.view(np.recarray)[0]
        self._generators = [np.random.default_rng(seed) for seed in seeds]
        by_clutch = [load_frames(clutch=name) for name in self._names]
        self._connect(by_clutch, parameters)

    def _connect(self, by_clutch: Sequence[dict[str, FrameCodec]], parameters: Sequence[ParameterSet]) -> None:
        """Fill records and settings for the frames of each clutch."""
        frames, interface = by_clutch[0], self._interface
        fixed = self._settings.view(np.recarray)[0]
        for name in SHARED_FRAMES:
            setattr(fixed, name.lower(), frame_definition(frames[name]))
        self._heartbeat, status = frames["PLANT_HEARTBEAT"], frames["PLANT_STATUS"]
        self.heartbeat_period = self._heartbeat.cycle_time  # s
        own = [self._heartbeat, status]
        self._heard = [frames["MOTOR_COMMAND"]]
        for k, (codecs, of_clutch) in enumerate(zip(by_clutch, parameters, strict=True)):
            clutch, its = interface.clutches[k], fixed.clutches[k]
            heard = [codecs["VALVE_COMMAND"], codecs["CONTROLLER_HEARTBEAT"]]
            clutch.valve, clutch.heartbeat = receptions(heard)
            clutch.answered_tick = -1
            its.noise_source = address(self._generators[k])
            its.dac_range, its.dac_bits = of_clutch["sensors.dac_range"].value, int(of_clutch["sensors.dac_bits"].value)
            for name in CLUTCH_FRAMES:
                its[name.lower()] = frame_definition(codecs[name])
            own += [codecs["ANALOG_SENSORS"], codecs["ENCODER"]]
            self._heard += heard
        interface.motor = receptions(self._heard[:1])[0]
        self._own = {codec.can_id: codec.name for codec in own}
        fixed.own = [*self._own, *[_NO_FRAME] * (OUTBOX - len(self._own))]
        fixed.rate, fixed.period, fixed.session, fixed.count = self.rate, self._period, self._session, len(self._names)
        fixed.status_every = max(1, round(status.cycle_time * self.rate))
        fixed.heartbeat_every = max(1, round(self.heartbeat_period * self.rate))

    @abstractmethod
    def show(self) -> int:
        """The frames of the present tick to the outbox: heartbeat, status, set-points, sensors; return their number."""

    @abstractmethod
    def advance(self) -> None:
        """Let the rig run for one period with the inputs held."""

    @property
    def steady(self) -> bool:
        """Whether a compiled call can make the next sample (`PlantNode.turns`): nothing but time goes on until then."""
        return False

    def step(self, inbox: Sequence[Frame]) -> list[Frame]:
        """One sample, and on by a period. Raises InputError when the bus has a second plant or speaks another protocol."""
        self.receive(inbox)
        frames = self.sample()
        self.advance()
        return frames

    def sample(self) -> list[Frame]:
        """The frames of the present tick as objects; see `show`."""
        return unload(self.outbox[: self.show()])

    def row(self) -> tuple[float, ...]:
        """The record of the last sample, in the order of `columns`."""
        return tuple(self.record.tolist())

    def receive(self, inbox: Sequence[Frame]) -> None:
        """Take commands; they act from the next sample on. Raises InputError as `take`."""
        for first in range(0, len(inbox), INBOX):
            self.take(self._inbox, load(self._inbox, inbox[first : first + INBOX]))

    def take(self, inbox: np.ndarray, count: int) -> None:
        """The same with the first `count` frames of a batch.

        Raises InputError when the bus has a second plant, another rate or another protocol.
        """
        if why := take(self._interfaces, self._settings, inbox, count):
            raise InputError(self._refusal(Refusal(why)))

    def slept(self, periods: int) -> None:
        """The machine has slept through `periods`, whose samples come now, at once: nobody could answer them.

        They age commands by one at most, as the controller may have slept, too.
        """
        slept(self._interfaces, self._settings, periods)

    def heartbeat(self, lifecycle: Lifecycle) -> Frame:
        """The next heartbeat."""
        self._interface.beats += 1
        data = self._heartbeat.pack(int(self._interface.beats), lifecycle, self.rate, self._session)
        return Frame(self._heartbeat.can_id, data)

    def safe(self) -> list[Frame]:
        """A plant commands nothing: it says that it ends."""
        return [self.heartbeat(Lifecycle.FINALIZED)]

    @property
    def answered_tick(self) -> int:
        """SAMPLE_TICK that every controller has answered, of those that have not ended; -1 while they differ."""
        clutches = self._clutches()
        ticks = {
            int(c["answered_tick"]) for c in clutches if c["controller"] != Lifecycle.FINALIZED or len(clutches) == 1
        }
        return ticks.pop() if len(ticks) == 1 else -1

    @property
    def controller(self) -> Lifecycle:
        """The state of all controllers, inactive while theirs differ: active once all are, finalized when all have ended."""
        states = {int(clutch["controller"]) for clutch in self._clutches()}
        return Lifecycle(states.pop()) if len(states) == 1 else Lifecycle.INACTIVE

    def reception_counts(self) -> dict[str, dict[str, int]]:
        """Counts of `protocols.can.reception.Reception` by frame name."""
        rows = [self._interfaces[0]["motor"]]
        for clutch in self._clutches():
            rows += [clutch["valve"], clutch["heartbeat"]]
        return {codec.name: counted(row) for codec, row in zip(self._heard, rows, strict=True)}

    def _clutches(self) -> np.ndarray:
        """Records of the clutches, shape (clutches,) of CLUTCH."""
        rows: np.ndarray = self._interfaces[0]["clutches"][: len(self._names)]
        return rows

    def _begin(self) -> int:
        """Go on to the next tick; frames of the plant itself and of the supervisor to the outbox: return their number."""
        self.tick += 1
        sent: int = begin(self._interfaces, self._settings, self.tick, self.late_cycles, self._setpoints, self.outbox)
        return sent

    def _show(self, k: int, rig: Rig, whole: Whole, sent: int) -> int:
        """Sensor frames of clutch `k` to the outbox behind `sent` others; its effects' states move on. Return their number."""
        shown: int = show(
            self._interfaces, self._settings, k, self.tick, *whole, rig.record, rig.table.kernel, self.outbox, sent
        )
        return shown

    def _refusal(self, why: Refusal) -> str:
        """What an unusable bus said, in a sentence."""
        can_id, said = int(self._interface.refused_id), int(self._interface.refused_value)
        if why is Refusal.SECOND_PLANT:
            return f"a second plant is on the bus: it sends {self._own[can_id]} (0x{can_id:03X})"
        if why is Refusal.LENGTH:
            (codec,) = (codec for codec in self._heard if codec.can_id == can_id)
            return f"frame {codec.name} (0x{can_id:03X}) came with {said} bytes; its definition has {codec.length}"
        clutch = f" of clutch {self._names[self._interface.refused_clutch]}" if len(self._names) > 1 else ""
        if why is Refusal.RATE:
            return f"the controller{clutch} runs at {said} Hz, this plant at {self.rate} Hz: give both one rate"
        return f"lifecycle {said} of the controller{clutch} is unknown; allowed are 0 to 3"
