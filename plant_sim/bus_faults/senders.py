"""Faults by other senders on the bus: noise, a flood, a masquerade, a plant of another rate."""

from collections.abc import Mapping

from plant_sim.bus_faults.bus_fault import COMMANDS, SAMPLES, SOURCE, BusFault, Surroundings, declare_strengths
from plant_sim.effects.effect import Shape, Strength
from protocols.can.frames import Frame
from protocols.can.lifecycle import Lifecycle

MOST_INSERTED = 100  # frames a sample: ten times what 1 Mbit/s carries in 1 ms
_FOREIGN_IDS = 0x400, 0x6FF  # range of identifiers that the bench does not use
_STANDARD_LENGTH = 8  # bytes
_ERROR_ID = 0x20000088  # CAN_ERR_FLAG of linux/can.h; CAN_ERR_PROT and CAN_ERR_BUSERROR of linux/can/error.h
_FORGED = {  # frames that a masquerade can send in each direction, and the strength that selects each
    COMMANDS: (("VALVE_COMMAND", "valve_voltage"),),
    SAMPLES: (("TORQUE_SETPOINT", "torque_demand"), ("ANALOG_SENSORS", "pressure_error")),
}


class FrameInsertion(BusFault):
    """A number of frames per sample on identifiers of the bench, with random bytes."""

    name = "frame_insertion"
    parameters = declare_strengths("1", 1.0, MOST_INSERTED)

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        chance, identifiers = self.around.chance, sorted(self.around.by_id)
        count = round(values[self.around.direction])
        return [*(Frame(chance.choice(identifiers), chance.randbytes(_STANDARD_LENGTH)) for _ in range(count)), *frames]


class ErrorFrames(BusFault):
    """A number of error frames per sample, as a CAN controller reports a disturbed line; the frames are repeated."""

    name = "error_frames"
    parameters = declare_strengths("1", 1.0, MOST_INSERTED)

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        count = round(values[self.around.direction])
        return [Frame(_ERROR_ID, bytes(_STANDARD_LENGTH))] * count + frames


class BusBabbling(BusFault):
    """A number of frames per sample on identifiers that the bench does not use."""

    name = "bus_babbling"
    parameters = declare_strengths("1", 20.0, MOST_INSERTED)

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        chance, count = self.around.chance, round(values[self.around.direction])
        return [
            *(Frame(chance.randint(*_FOREIGN_IDS), chance.randbytes(_STANDARD_LENGTH)) for _ in range(count)),
            *frames,
        ]


class FrameMasquerade(BusFault):
    """A second sender with correct counters and data IDs: of the valve command, the set-point, or the analog sensors.

    It sends before the right sender, with the counter of its frame; or, with `ahead`, after it, and then counts by itself. With
    `claimed` it takes over the session of the supervisor from the next claim on the bus.
    """

    name = "frame_masquerade"
    parameters = (
        Strength("valve_voltage", "V", 0.0, 9.9, (0.0, 9.9), SOURCE),
        Strength("torque_demand", "Nm", 0.0, 30.0, (0.0, 30.0), SOURCE),
        Strength("pressure_error", "bar", 0.0, -0.9, (-5.0, 5.0), SOURCE),
        Shape("ahead", "1", 0.0, (0.0, 1.0), SOURCE),
        Shape("claimed", "1", 1.0, (0.0, 1.0), SOURCE),
    )

    def __init__(self, around: Surroundings) -> None:
        super().__init__(around)
        self._counters: dict[str, int] = {}  # counters of the masquerade with `ahead`
        self._codecs = dict(around.by_name)

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        ahead = values["ahead"] >= 0.5
        if values["claimed"] >= 0.5:
            self._read_claim(frames)
        forged: list[Frame] = []
        for name, strength in _FORGED[self.around.direction]:
            codec = self._codecs[name]
            own = [data for can_id, data in frames if can_id == codec.can_id and len(data) == codec.length]
            if values[strength] and own:
                counter = codec.read_counter(own[-1])
                if ahead:
                    counter = self._counters[name] = 1 + self._counters.get(name, counter)
                forged.append(Frame(codec.can_id, self._forge(name, counter, own[-1], values[strength])))
        return [*frames, *forged] if ahead else [*forged, *frames]

    def _read_claim(self, frames: list[Frame]) -> None:
        """Take the supervisor's session from its claim, if the frames contain one."""
        claim = self.around.by_name["SUPERVISOR_CLAIM"]
        for can_id, data in frames:
            if can_id == claim.can_id and claim.is_valid(data):
                session = int(claim.raw(data).session)
                self._codecs["TORQUE_SETPOINT"] = self.around.by_name["TORQUE_SETPOINT"].bind(session)

    def _forge(self, name: str, counter: int, data: bytes, value: float) -> bytes:
        """Return a frame with the masquerade's value and otherwise the content of the right frame."""
        codec = self._codecs[name]
        signals = codec.unpack(data)
        if name == "VALVE_COMMAND":
            signals = signals._replace(valve_enable=1, valve_voltage=value)
        elif name == "TORQUE_SETPOINT":
            signals = signals._replace(request=1, torque_demand=value)
        else:
            raw, counts = codec.raw(data), round(value / codec.scale["cylinder_pressure"])
            most = 1 << codec.bits["cylinder_pressure"] - 1
            shown = min(max(raw.cylinder_pressure + counts, -most), most - 1)  # as a converter at the end of its range
            return codec.pack_raw(counter, *raw._replace(cylinder_pressure=shown))
        return codec.pack(counter, *signals)


class HeartbeatRate(BusFault):
    """The plant's heartbeats have another rate."""

    name = "heartbeat_rate"
    parameters = (Strength("rate", "Hz", 0.0, 500.0, (0.0, 4000.0), SOURCE),)

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        beat = self.around.by_name["PLANT_HEARTBEAT"]
        if self.around.direction == COMMANDS:
            return frames
        return [
            Frame(can_id, beat.pack_raw(beat.read_counter(data), *beat.raw(data)._replace(rate=round(values["rate"]))))
            if can_id == beat.can_id and len(data) == beat.length and beat.raw(data).lifecycle == Lifecycle.ACTIVE
            else Frame(can_id, data)
            for can_id, data in frames
        ]


FAULTS = FrameInsertion, ErrorFrames, BusBabbling, FrameMasquerade, HeartbeatRate
