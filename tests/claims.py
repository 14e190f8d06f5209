"""Frames of supervisors, with and without a claim of the set-points."""

from collections.abc import Sequence

from protocols.can.frames import Frame, FrameCodec, load_frames


class Supervisor:
    """Makes the claims and set-points of a supervisor of one clutch, with its own counters. session 0: without a claim."""

    def __init__(self, session: int, counter: int = 0, clutch: str = "a") -> None:
        frames = load_frames(clutch=clutch)
        self.session, self.asked, self.claimed = session, counter, counter
        self._claim = frames["SUPERVISOR_CLAIM"]
        self._setpoint = frames["TORQUE_SETPOINT"].bind(session)

    def claim(self, claimed: bool = True) -> Frame:
        self.claimed += 1
        return Frame(self._claim.can_id, self._claim.pack(self.claimed, claim=claimed, session=self.session))

    def ask(self, request: int, torque: float = 0.0, speed: float = 10.0) -> Frame:
        self.asked += 1
        return Frame(self._setpoint.can_id, self._setpoint.pack(self.asked, request, torque, speed, 0.0))


def drop(frames: Sequence[Frame], *names: str) -> list[Frame]:
    """Return `frames` without those with one of the names `names`, of clutch a."""
    dropped = {load_frames()[name].can_id for name in names}
    return [frame for frame in frames if frame.can_id not in dropped]


def drop_claims(frames: Sequence[Frame]) -> list[Frame]:
    """Return the frames of a supervisor without a claim: no claims, and set-points with the data ID of the DBC."""
    setpoint = load_frames()["TORQUE_SETPOINT"]
    kept = drop(frames, "SUPERVISOR_CLAIM")
    return [Frame(i, rebind(setpoint, data)) if i == setpoint.can_id else Frame(i, data) for i, data in kept]


def rebind(codec: FrameCodec, data: bytes) -> bytes:
    """Return the payload `data` with the CRC of `codec`; the counter and all signals stay the same."""
    return codec.pack_raw(codec.read_counter(data), **codec.raw(data)._asdict())
