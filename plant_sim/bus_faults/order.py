"""Faults of the order of frames: loss, delay, repetition."""

from collections import deque
from collections.abc import Mapping

from plant_sim.bus_faults.bus_fault import SOURCE, BusFault, Surroundings, declare_shares, declare_strengths
from plant_sim.effects.effect import Shape, Strength
from protocols.can.frames import Frame

_MS = 1e-3  # s


class FrameLoss(BusFault):
    """Frames are lost; a share of 1 is an interface that is down."""

    name = "frame_loss"
    parameters = declare_shares(1.0)

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        around = self.around
        return [frame for frame in frames if around.chance.random() >= values[around.direction]]


class FrameDelay(BusFault):
    """Frames arrive late by a delay in ms, in their order; along a ramp the delay grows."""

    name = "frame_delay"
    parameters = declare_strengths("ms", 20.0, 1000.0)

    def __init__(self, around: Surroundings) -> None:
        super().__init__(around)
        self._waiting: deque[tuple[int, Frame]] = deque()  # tick at which a frame arrives

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        late = round(values[self.around.direction] * _MS * self.around.rate)
        self._waiting.extend((tick + late, frame) for frame in frames)
        come = []
        while self._waiting and self._waiting[0][0] <= tick:
            come.append(self._waiting.popleft()[1])
        return come


class FrameRepetition(BusFault):
    """Frames arrive twice: at once, or again after a number of samples."""

    name = "frame_repetition"
    parameters = (*declare_shares(0.3), Shape("after", "1", 0.0, (0.0, 100.0), SOURCE))

    def __init__(self, around: Surroundings) -> None:
        super().__init__(around)
        self._again: deque[tuple[int, list[Frame]]] = deque()  # tick at which frames come again

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        after, share = round(values["after"]), values[self.around.direction]
        come: list[Frame] = []
        again: list[Frame] = []
        for frame in frames:
            come.append(frame)
            if self.around.chance.random() < share:
                (again if after else come).append(frame)
        self._again.append((tick + after, again))
        while self._again and self._again[0][0] <= tick:
            come += self._again.popleft()[1]
        return come


class FrameReordering(BusFault):
    """Frames come after those of the next sample."""

    name = "frame_reordering"
    parameters = declare_shares(0.003)

    def __init__(self, around: Surroundings) -> None:
        super().__init__(around)
        self._held: list[Frame] = []

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        share = values[self.around.direction]
        late = [self.around.chance.random() < share for _ in frames]
        come = [frame for frame, held in zip(frames, late, strict=True) if not held] + self._held
        self._held = [frame for frame, held in zip(frames, late, strict=True) if held]
        return come


class FrameReplay(BusFault):
    """The frames of a window are sent repeatedly instead of new ones, unchanged or with present counters."""

    name = "frame_replay"
    parameters = (
        *declare_strengths("1", 1.0, 1.0),
        Shape("window", "ms", 200.0, (1.0, 1000.0), SOURCE),
        Shape("renewed", "1", 0.0, (0.0, 1.0), SOURCE),
    )

    def __init__(self, around: Surroundings) -> None:
        super().__init__(around)
        self._kept: list[list[Frame]] = []  # of the window, which begins when the fault is switched on
        self._next = 0

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        if len(self._kept) < max(1, round(values["window"] * _MS * self.around.rate)):
            self._kept.append(frames)
            return frames
        old = self._kept[self._next]
        self._next = (self._next + 1) % len(self._kept)
        if values["renewed"] < 0.5:
            return old
        contents = dict(old)
        return [self._renew(frame, contents.get(frame.can_id, frame.data)) for frame in frames]

    def _renew(self, frame: Frame, content: bytes) -> Frame:
        """Return the old `content` with the counter of `frame`.

        Set-points of a claim stay new, because their CRC includes a session.
        """
        codec = self.around.by_id.get(frame.can_id)
        if codec is None or not codec.is_valid(content):
            return frame
        return Frame(frame.can_id, codec.pack_raw(codec.read_counter(frame.data), *codec.raw(content)))


class BusOff(BusFault):
    """The plant's CAN controller is off the bus for a time in ms. Then the waiting frames of both sides are sent first."""

    name = "bus_off"
    parameters = (
        Strength("length", "ms", 0.0, 100.0, (0.0, 10_000.0), SOURCE),
        Shape("queue", "1", 10.0, (0.0, 1000.0), "[D] txqueuelen of a CAN interface in Linux"),
    )

    def __init__(self, around: Surroundings) -> None:
        super().__init__(around)
        self._began: int | None = None  # tick
        self._queue: list[Frame] = []

    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """See `BusFault`."""
        self._began = tick if self._began is None else self._began
        if tick < self._began + round(values["length"] * _MS * self.around.rate):
            self._queue += frames[: max(0, round(values["queue"]) - len(self._queue))]
            return []
        waiting, self._queue = self._queue, []
        return waiting + frames


FAULTS = FrameLoss, FrameDelay, FrameRepetition, FrameReordering, FrameReplay, BusOff
