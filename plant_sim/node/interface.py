"""Interface between the bus and the clutches of a rig: it takes command frames and makes the frames of a sample.

Decoding, checks, data acquisition and encoding are compiled calls (`plant_cycle.py`).
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NoReturn

import numpy as np

from plant_sim.bus_faults.catalogue import select_bus_faults
from plant_sim.node.disturbed_bus import DisturbedBus
from plant_sim.node.injection import Injection
from plant_sim.node.noise import find_address
from plant_sim.node.plant_cycle import (
    CLUTCH_FRAMES,
    COMMAND_AGE,
    FAULT_TOLERANT_TIME,
    GAP_MEMORY,
    INTERFACE,
    OUTBOX,
    SETTINGS,
    SHARED_FRAMES,
    STALE_CYCLES,
    Refusal,
    begin,
    show,
    skip_periods,
    take,
)
from plant_sim.rigs.wet_clutch import Rig, Whole
from protocols.can.claim import bind_data_id, make_claim_session
from protocols.can.frame_batch import load, make_batch, unload
from protocols.can.frames import Frame, FrameCodec, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.can.reception import make_receptions, read_counts
from protocols.can.two_clutches import CLUTCHES
from protocols.can.words import make_frame_definition
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.node import Column

INBOX = 4096  # frames in one call of `take`: more than a bus of 1 Mbit/s carries in 0.2 s
MOST_SENT = 512  # frames in a sample with bus faults: twice the number that one fault adds, plus delayed frames
_YOUNGEST_LIMIT = 2  # ticks: even at a low rate a command may answer the previous sample
_NO_FRAME = -1  # marks an unused place: no frame has this identifier


class Interface(ABC):
    """The clutches of a rig on the bus: base class of the rig's node.

    rate [Hz]. `parameters` and `seeds` (of the sensor noise) have one entry for each clutch. `session` is a number that
    distinguishes two plants. `setpoints` are the profile tables, shape (clutches, 5, rows), see
    `profile.interpolate_setpoint`; without a profile their shape is (0, 5, 0).

    Attributes of the last sample: `tick` is its number, -1 before the first; `outbox` has its frames, shape (MOST_SENT,) of
    frame_batch.FRAME; `record` is its row, shape (columns,). `bus` has the faults of the bus, `injected_changes` the changes by
    injections that have begun. In `lockstep` no bus fault is possible: each sample waits for its answer.
    """

    columns: tuple[Column, ...]

    def __init__(
        self, rate: int, parameters: Sequence[ParameterSet], seeds: Sequence[int], session: int, setpoints: np.ndarray
    ) -> None:
        self.rate, self.tick = rate, -1
        self.late_cycles = 0  # set by the service for PLANT_STATUS
        self.lockstep = False  # set by the service
        self.injected_changes: list[dict[str, Any]] = []
        self.outbox, self.record = make_batch(MOST_SENT), np.zeros(len(self.columns))
        self._period, self._session, self._setpoints = 1.0 / rate, session, setpoints
        self._names = CLUTCHES[: len(parameters)]
        self._inbox = make_batch(INBOX)
        self._interfaces, self._settings = np.zeros(1, INTERFACE), np.zeros(1, SETTINGS)
        self._interface = self._interfaces.view(np.recarray)[0]
        self._generators = [np.random.default_rng(seed) for seed in seeds]
        by_clutch = [load_frames(clutch=name) for name in self._names]
        self._connect(by_clutch, parameters)
        self.bus = DisturbedBus(rate, seeds[0], list({c.can_id: c for own in by_clutch for c in own.values()}.values()))

    def _connect(self, by_clutch: Sequence[dict[str, FrameCodec]], parameters: Sequence[ParameterSet]) -> None:
        """Fill the records and settings of the interface from the frames and parameters of each clutch."""
        frames, interface = by_clutch[0], self._interface
        fixed = self._settings.view(np.recarray)[0]
        for name in SHARED_FRAMES:
            setattr(fixed, name.lower(), make_frame_definition(frames[name]))
        self._heartbeat, status = frames["PLANT_HEARTBEAT"], frames["PLANT_STATUS"]
        self.heartbeat_period = self._heartbeat.cycle_time  # s
        own = [self._heartbeat, status]
        fixed.claim_session = session = make_claim_session(self._session)
        self._claims = [codecs["SUPERVISOR_CLAIM"] for codecs in by_clutch][: len(self._setpoints)]
        self._received = [frames["MOTOR_COMMAND"]]
        for k, (codecs, values) in enumerate(zip(by_clutch, parameters, strict=True)):
            clutch, its = interface.clutches[k], fixed.clutches[k]
            received = [codecs["VALVE_COMMAND"], codecs["CONTROLLER_HEARTBEAT"]]
            clutch.valve, clutch.heartbeat = make_receptions(received)
            clutch.answered_tick = -1
            its.noise_source = find_address(self._generators[k])
            its.dac_range, its.dac_bits = values["sensors.dac_range"].value, int(values["sensors.dac_bits"].value)
            for name in CLUTCH_FRAMES:
                its[name.lower()] = make_frame_definition(codecs[name])
            its.torque_setpoint.data_id = bind_data_id(codecs["TORQUE_SETPOINT"].data_id, session)
            own += [codecs["ANALOG_SENSORS"], codecs["ENCODER"]]
            self._received += received
        interface.motor, interface.tick = make_receptions(self._received)[0], -1
        self._own = {codec.can_id: codec.name for codec in own}
        fixed.own = [*self._own, *[_NO_FRAME] * (OUTBOX - len(self._own))]
        interface.own[: len(own)] = make_receptions(own)
        fixed.rate, fixed.period, fixed.session, fixed.count = self.rate, self._period, self._session, len(self._names)
        fixed.oldest = max(_YOUNGEST_LIMIT, round(COMMAND_AGE * self.rate))
        fixed.latch_after = max(STALE_CYCLES + 1, round(FAULT_TOLERANT_TIME * self.rate))
        fixed.gap_memory = round(GAP_MEMORY * self.rate)
        fixed.status_every = max(1, round(status.cycle_time * self.rate))
        fixed.heartbeat_every = max(1, round(self.heartbeat_period * self.rate))
        fixed.claim_every = max(1, round(frames["SUPERVISOR_CLAIM"].cycle_time * self.rate))

    @abstractmethod
    def show(self) -> int:
        """Write the frames of the present tick to the outbox: heartbeat, status, set-points, sensors; return their number."""

    @abstractmethod
    def advance(self) -> None:
        """Advance the rig by one period with constant inputs."""

    @property
    def steady(self) -> bool:
        """Whether a compiled call can make the next sample (`PlantNode.run_real_time`): no parameter changes until then."""
        return False

    def step(self, inbox: Sequence[Frame]) -> list[Frame]:
        """Take frames, make a sample, advance by a period; return the sample's frames. Raises InputError as `take`."""
        self.receive(inbox)
        frames = self.sample()
        self.advance()
        return frames

    def sample(self) -> list[Frame]:
        """Make the frames of the present tick (`show`) and return them as objects."""
        return unload(self.outbox[: self.show()])

    def _pass_samples(self, sent: int) -> int:
        """Change the first `sent` frames of the outbox as the bus does; return the number of frames there now."""
        time = self.tick * self._period
        if self.bus.is_clear(time):
            return sent
        self.injected_changes += [change.to_dict(self.rate) for change in self.bus.begin(time)]
        return load(self.outbox, self.bus.pass_samples(self.tick, unload(self.outbox[:sent]))[:MOST_SENT])

    def _split_injections(self, injections: Sequence[Injection]) -> tuple[list[Injection], list[Injection]]:
        """Return the parts of injections that change the rig, and those that are faults of the bus. Raises InputError."""
        rig, bus = [], []
        for injection in injections:
            faults = select_bus_faults(injection.values)
            others = {name: value for name, value in injection.values.items() if name not in faults}
            rig += [replace(injection, values=others)] if others else []
            bus += [replace(injection, values=faults)] if faults else []
        if bus and self.lockstep:
            raise InputError(
                f"{next(iter(bus[0].values))} is a fault of the bus, and in lock-step each sample waits for its answer;"
                " play it in real time, or with simulate"
            )
        self.bus.check(bus, self._now)
        return rig, bus

    @property
    def _now(self) -> float:
        """Time of the next sample [s]."""
        return (self.tick + 1) * self._period

    def make_row(self) -> tuple[float, ...]:
        """Return the record of the last sample, in the order of `columns`."""
        return tuple(self.record.tolist())

    def receive(self, inbox: Sequence[Frame]) -> None:
        """Take command frames; they act from the next sample on. Raises InputError as `take`."""
        for first in range(0, max(len(inbox), 1), INBOX):  # also without frames, as a period has passed
            self.take(self._inbox, load(self._inbox, inbox[first : first + INBOX]))

    def take(self, inbox: np.ndarray, count: int) -> None:
        """Take the first `count` command frames of the batch `inbox`, shape (n,) of FRAME; they act from the next sample on.

        Raises InputError when another plant is on the bus, or a controller has another rate. A frame that cannot be used is
        counted (`count_receptions`).
        """
        if self.tick >= 0 and not self.bus.is_clear(self._now):
            come = self.bus.pass_commands(self.tick + 1, unload(inbox[:count]))[:INBOX]
            inbox, count = self._inbox, load(self._inbox, come)
        if why := take(self._interfaces, self._settings, inbox, count):
            self._refuse(why)

    def skip_periods(self, periods: int) -> None:
        """Account for `periods` that the computer has missed. Their samples are sent at once, so no controller can answer them.

        Together they age the commands by only one period, because the controller may have been stopped too.
        """
        skip_periods(self._interfaces, self._settings, periods)

    def make_heartbeat(self, lifecycle: Lifecycle) -> Frame:
        """Return the next heartbeat frame, with the state `lifecycle`."""
        self._interface.beats += 1
        data = self._heartbeat.pack(
            int(self._interface.beats), lifecycle=lifecycle, rate=self.rate, session=self._session
        )
        return Frame(self._heartbeat.can_id, data)

    def list_safe_frames(self) -> list[Frame]:
        """Return the frames to send at the end: the claims of the set-points are released, then the final heartbeat.

        A plant has no actuator to make safe.
        """
        self._interface.claims += 1
        released = {"session": int(self._settings[0]["claim_session"])}
        claims = [Frame(codec.can_id, codec.pack(int(self._interface.claims), **released)) for codec in self._claims]
        return [*claims, self.make_heartbeat(Lifecycle.FINALIZED)]

    @property
    def answered_tick(self) -> int:
        """SAMPLE_TICK of the last answers of the running controllers; -1 while these differ."""
        clutches = self._read_clutches()
        ticks = {
            int(c["answered_tick"]) for c in clutches if c["controller"] != Lifecycle.FINALIZED or len(clutches) == 1
        }
        return ticks.pop() if len(ticks) == 1 else -1

    @property
    def controller(self) -> Lifecycle:
        """State that all controllers have in common; inactive while their states differ."""
        states = {int(clutch["controller"]) for clutch in self._read_clutches()}
        return Lifecycle(states.pop()) if len(states) == 1 else Lifecycle.INACTIVE

    def count_receptions(self) -> dict[str, dict[str, int]]:
        """Return the counts of `protocols.can.reception.Reception` by frame name."""
        rows = [self._interfaces[0]["motor"]]
        for clutch in self._read_clutches():
            rows += [clutch["valve"], clutch["heartbeat"]]
        counted = zip(self._received, rows, strict=True)
        return {codec.name: read_counts(row) for codec, row in counted}

    def count_strays(self) -> dict[str, dict[str, int]]:
        """Return the counts of the frames that others sent on this service's own identifiers, by frame name."""
        rows = zip(self._own.values(), self._interfaces[0]["own"], strict=False)
        return {name: counts for name, row in rows if any((counts := read_counts(row)).values())}

    @property
    def first_rejected(self) -> str:
        """Reason why the first rejected frame (wrong length or values) was not used; "" if there was none."""
        first = self._interface
        if not first.rejected_why:
            return ""
        return self._describe(
            Refusal(int(first.rejected_why)),
            int(first.rejected_id),
            int(first.rejected_value),
            int(first.rejected_clutch),
        )

    def _read_clutches(self) -> np.ndarray:
        """Return the records of the clutches, shape (clutches,) of CLUTCH."""
        rows: np.ndarray = self._interfaces[0]["clutches"][: len(self._names)]
        return rows

    def _begin(self) -> int:
        """Go to the next tick and write the frames of plant and supervisor to the outbox; return their number."""
        self.tick += 1
        sent: int = begin(self._interfaces, self._settings, self.tick, self.late_cycles, self._setpoints, self.outbox)
        return sent

    def _show(self, k: int, rig: Rig, whole: Whole, sent: int) -> int:
        """Write the sensor frames of clutch `k` to the outbox, after `sent` others; return the number of frames there now.

        The states of the effects advance.
        """
        count: int = show(
            self._interfaces, self._settings, k, self.tick, *whole, rig.record, rig.table.kernel, self.outbox, sent
        )
        return count

    def _refuse(self, why: int) -> NoReturn:
        """Raise InputError for the frame that ends the service; `why` is a Refusal."""
        last = self._interface
        raise InputError(
            self._describe(Refusal(why), int(last.refused_id), int(last.refused_value), int(last.refused_clutch))
        )

    def _describe(self, why: Refusal, can_id: int, value: int, k: int) -> str:
        """Return the message for a frame of clutch `k` that was not used."""
        if why is Refusal.SECOND_PLANT:
            return f"a second plant is on the bus: it sends {self._own[can_id]} (0x{can_id:03X})"
        if why is Refusal.AGE:
            name = next(codec.name for codec in self._received if codec.can_id == can_id)
            return (
                f"frame {name} (0x{can_id:03X}) answers a sample of {value} ticks ago;"
                f" allowed are {self._settings[0]['oldest']}"
            )
        if why is Refusal.LENGTH:
            (codec,) = (codec for codec in self._received if codec.can_id == can_id)
            return f"frame {codec.name} (0x{can_id:03X}) was received with {value} bytes; its definition has {codec.length}"
        clutch = f" of clutch {self._names[k]}" if len(self._names) > 1 else ""
        if why is Refusal.RATE:
            return f"the controller{clutch} runs at {value} Hz, this plant at {self.rate} Hz: give both one rate"
        return f"lifecycle {value} of the controller{clutch} is unknown; allowed are 0 to 3"
