"""Traffic: the frames of the bench on a bus, counted by their receptions; for tools that watch a bus or read its log."""

from collections import Counter
from collections.abc import Sequence

from protocols.can.frames import FrameCodec
from protocols.can.reception import Reception

_HEARTBEATS = ("PLANT_HEARTBEAT", "CONTROLLER_HEARTBEAT", "CONTROLLER_HEARTBEAT_B")
_SUPERVISOR = "SUPERVISOR"  # sender without a heartbeat
_SUPERVISOR_SILENCE = 0.1  # s; a new supervisor is silent for longer than this, then begins its alive counters at 0


class Traffic:
    """Counts frames of `codecs`. A service that starts anew may begin its alive counters anywhere.

    frames: number by name, by identifier for others.
    """

    def __init__(self, codecs: Sequence[FrameCodec]) -> None:
        self.frames: Counter[str] = Counter()
        self._codecs = {codec.can_id: codec for codec in codecs}
        self._receptions = {codec.can_id: Reception(codec) for codec in codecs}
        self._past: Counter[str] = Counter()  # counts before the receptions were restarted
        self._sessions: dict[str, int] = {}  # session number of each service, by its heartbeat frame
        self._last_supervised = 0.0  # s, time stamp of the newest frame of a supervisor

    def take(self, stamp: float, can_id: int, data: bytes) -> bool:
        """Count a frame that came at `stamp` [s]; return whether a receiver would use it."""
        codec = self._codecs.get(can_id)
        if codec is None:
            self.frames[f"0x{can_id:03X}"] += 1
            return False
        self.frames[codec.name] += 1
        if codec.name in _HEARTBEATS and codec.is_valid(data):
            session = codec.unpack(data).session
            if self._sessions.get(codec.name) != session:
                self._sessions[codec.name] = session
                self._restart_receptions(codec.sender)
        if codec.sender == _SUPERVISOR:
            if stamp - self._last_supervised > _SUPERVISOR_SILENCE:
                self._restart_receptions(_SUPERVISOR)
            self._last_supervised = stamp
        return self._receptions[can_id].accept(data)

    def count(self, what: str) -> int:
        """Number of frames that are `what`, a count of `Reception`: lost, repeated, corrupt or misshapen."""
        return self._past[what] + sum(getattr(reception, what) for reception in self._receptions.values())

    def _restart_receptions(self, sender: str) -> None:
        """Accept any alive counter as the next of a sender that has started anew."""
        for can_id, codec in self._codecs.items():
            if codec.sender == sender:
                self._past.update(self._receptions[can_id].read_counts())
                self._receptions[can_id] = Reception(codec)
