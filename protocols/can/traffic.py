"""Traffic: counts the frames of the bench on a bus by receptions, for tools that watch a bus or read its log."""

from collections import Counter
from collections.abc import Sequence

from protocols.can.claim import BOUND
from protocols.can.frames import FrameCodec
from protocols.can.reception import Reception

_HEARTBEATS = ("PLANT_HEARTBEAT", "CONTROLLER_HEARTBEAT", "CONTROLLER_HEARTBEAT_B")
_SUPERVISOR = "SUPERVISOR"  # sender without a heartbeat
_MOST_SUPERVISORS = 8  # most recent supervisors whose set-points are accepted; chosen
_MOST_EARLY = 1000  # set-points that wait for the first claim: it comes within 50 ms, i.e. 50 set-points at 1 kHz
_SUPERVISOR_SILENCE = 0.1  # s; a new supervisor is silent for longer than this, then begins its alive counters at 0


class Traffic:
    """Counts frames of `codecs`. A restarted service may begin its alive counters at any value.

    Set-points of every supervisor are correct, with or without a claim. If watching begins during a run, set-points arrive
    before the first claim: those with a wrong CRC wait for it.

    frames: number by name; by identifier for other frames.
    """

    def __init__(self, codecs: Sequence[FrameCodec]) -> None:
        self.frames: Counter[str] = Counter()
        self._codecs = {codec.can_id: codec for codec in codecs}
        self._receptions = {codec.can_id: Reception(codec) for codec in codecs}
        self._past: Counter[str] = Counter()  # counts before the receptions were restarted
        self._sessions: dict[str, int] = {}  # session number of each service, by its heartbeat frame
        by_name = {codec.name: codec for codec in codecs}
        bound = [(by_name[claim], by_name[name]) for claim, name in BOUND.items() if {claim, name} <= by_name.keys()]
        self._claims = {claim.can_id: setpoint for claim, setpoint in bound}
        self._supervisors = {setpoint.can_id: [setpoint] for _, setpoint in bound}  # first that without a claim
        self._early: dict[int, list[bytes]] = {setpoint.can_id: [] for _, setpoint in bound}
        self._last_supervised = 0.0  # s, time stamp of the newest frame of a supervisor

    def take(self, stamp: float, can_id: int, data: bytes) -> bool:
        """Count a frame received at `stamp` [s]; return whether a receiver would use it."""
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
        if can_id in self._claims and codec.is_valid(data):
            self._hear_claim(self._claims[can_id], codec.unpack(data).session)
        return (
            self._take_setpoint(codec, data) if can_id in self._supervisors else self._receptions[can_id].accept(data)
        )

    def count(self, what: str) -> int:
        """Return the number of frames of the kind `what`, a count of `Reception`: lost, repeated, corrupt or misshapen."""
        early = sum(map(len, self._early.values())) if what == "corrupt" else 0
        return self._past[what] + early + sum(getattr(reception, what) for reception in self._receptions.values())

    def _hear_claim(self, setpoint: FrameCodec, session: int) -> None:
        """Accept the set-points of a supervisor from now on, and check those that waited for the first claim."""
        known = self._supervisors[setpoint.can_id]
        bound = setpoint.bind(session)
        if bound.data_id in [one.data_id for one in known]:
            return
        self._supervisors[setpoint.can_id] = [setpoint, bound, *known[1:_MOST_SUPERVISORS]]
        early, self._early[setpoint.can_id] = self._early[setpoint.can_id], []
        for data in early:
            self._take_setpoint(setpoint, data)

    def _take_setpoint(self, codec: FrameCodec, data: bytes) -> bool:
        """Count a set-point by the data ID of its supervisor."""
        known, early = self._supervisors[codec.can_id], self._early[codec.can_id]
        valid = [one for one in known if one.is_valid(data)]
        if not valid and len(known) == 1 and len(data) == codec.length and len(early) < _MOST_EARLY:
            early.append(data)
            return False
        reception = self._receptions[codec.can_id]
        reception.codec = valid[0] if valid else codec
        return reception.accept(data)

    def _restart_receptions(self, sender: str) -> None:
        """Accept any alive counter as the next one of a restarted sender."""
        for can_id, codec in self._codecs.items():
            if codec.sender == sender:
                self._past.update(self._receptions[can_id].read_counts())
                self._receptions[can_id] = Reception(codec)
