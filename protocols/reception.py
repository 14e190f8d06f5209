"""Reception of one kind of frame: length, CRC and alive counter decide whether a payload is believed."""

from protocols.errors import InputError
from protocols.frames import COUNTER_MODULUS, FrameCodec


class Reception:
    """Counts what arrives of one frame and gates its payload.

    `received` accepted frames; `lost` gaps in the alive counter (at least: it wraps at 16); `repeated` frames with the
    counter of the frame before, refused as a stuck sender; `corrupt` frames whose CRC is wrong, refused.
    """

    def __init__(self, codec: FrameCodec) -> None:
        self.codec = codec
        self.received = self.lost = self.repeated = self.corrupt = 0
        self._counter = -1

    def accept(self, data: bytes) -> bool:
        """Whether `data` may be used.

        Raises InputError for a wrong length: the sender has another definition of the frame, nothing it says can be
        believed.
        """
        codec = self.codec
        if len(data) != codec.length:
            raise InputError(
                f"frame {codec.name} (0x{codec.can_id:03X}) came with {len(data)} bytes; its definition has {codec.length}"
            )
        if not codec.valid(data):
            self.corrupt += 1
            return False
        counter = codec.counter(data)
        if counter == self._counter:
            self.repeated += 1
            return False
        if self._counter >= 0:
            self.lost += (counter - self._counter - 1) % COUNTER_MODULUS
        self._counter = counter
        self.received += 1
        return True

    def counts(self) -> dict[str, int]:
        """The four counters by name."""
        return {name: getattr(self, name) for name in ("received", "lost", "repeated", "corrupt")}
