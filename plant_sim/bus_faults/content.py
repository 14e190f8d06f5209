"""Faults of the content of frames: bits, length, identifier."""

from collections.abc import Mapping

from plant_sim.bus_faults.bus_fault import SOURCE, BusFault, declare_shares
from plant_sim.effects.effect import Shape
from protocols.can.frames import Frame

_BITS = 8  # of a byte


class FrameCorruption(BusFault):
    """A burst of wrong bits in the payload, as by a gateway; a CAN bus would repeat the frame."""

    name = "frame_corruption"
    parameters = (*declare_shares(0.1), Shape("burst", "1", 16.0, (1.0, 64.0), SOURCE))

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        share = values[self.around.direction]
        return [
            self._corrupt(frame, round(values["burst"])) if self.around.chance.random() < share else frame
            for frame in frames
        ]

    def _corrupt(self, frame: Frame, burst: int) -> Frame:
        """Return the frame with a burst of at most `burst` bits, whose first and last bit are wrong."""
        bits, chance = _BITS * len(frame.data), self.around.chance
        if not bits:
            return frame
        length = chance.randint(1, min(burst, bits))
        wrong = chance.getrandbits(length) | 1 | 1 << length - 1
        word = int.from_bytes(frame.data, "little") ^ wrong << chance.randint(0, bits - length)
        return Frame(frame.can_id, word.to_bytes(len(frame.data), "little"))


class FrameTruncation(BusFault):
    """Frames arrive with fewer bytes."""

    name = "frame_truncation"
    parameters = declare_shares(0.1)

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        share, chance = values[self.around.direction], self.around.chance
        return [
            Frame(can_id, data[: chance.randrange(len(data))])
            if data and chance.random() < share
            else Frame(can_id, data)
            for can_id, data in frames
        ]


class FrameMisaddressing(BusFault):
    """The payload of one frame arrives under the identifier of another one, after the frames of the sample."""

    name = "frame_misaddressing"
    parameters = declare_shares(0.1)

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        share, chance, identifiers = values[self.around.direction], self.around.chance, sorted(self.around.by_id)
        wrong = [
            Frame(chance.choice([one for one in identifiers if one != frame.can_id]), frame.data)
            for frame in frames
            if chance.random() < share
        ]
        return frames + wrong


FAULTS = FrameCorruption, FrameTruncation, FrameMisaddressing
