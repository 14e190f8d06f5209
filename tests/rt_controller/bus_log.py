"""Writes a bus log of plant and controller in lock-step from one process: the frames are equal on every computer."""

from collections import Counter
from pathlib import Path

import can

from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.can.frames import DBC_1, Frame, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.node import load_node
from tests.claims import drop, drop_claims

ENCODER = load_frames()["ENCODER"]


def write_log(path: Path, seconds: float, claimed: bool = True) -> None:
    """Write the frames of the first `seconds` [s] of the profile `engagement` to a log, with claims or as before them."""
    plant, controller = PlantNode(profile=load_profile("engagement", seconds)), load_node("controller")()
    inbox: list[Frame] = []
    with can.Logger(path) as log:

        def put(frames: list[Frame]) -> None:
            for can_id, data in frames:
                log(can.Message(plant.tick * 1e-3 + 1.0, can_id, is_extended_id=False, data=data, channel=0))

        put([plant.make_heartbeat(Lifecycle.INACTIVE)])
        while not plant.finished:
            sensors = plant.step(inbox) if claimed else drop_claims(plant.step(inbox))
            put(sensors)
            inbox = controller.step(sensors)
            put(inbox)


class _OldFrames:
    """Frames of version 2 as those of version 1 that a bench of before would have sent."""

    def __init__(self) -> None:
        self._old = {codec.can_id: codec for codec in load_frames(DBC_1).values()}
        self._new = {codec.can_id: codec for codec in load_frames().values()}
        self._counts: Counter[int] = Counter()
        self._angle = 0

    def translate(self, tick: int, frames: list[Frame]) -> list[Frame]:
        """The frames of a sample, or their answers: `tick` is that of the sample."""
        values: dict[str, int] = {}
        for can_id, data in frames:
            if can_id == ENCODER.can_id:
                self._angle += (ENCODER.raw(data).shaft_angle - self._angle + 2**17) % 2**18 - 2**17
                values = {"shaft_angle": self._angle, "motor_torque": ENCODER.raw(data).motor_torque}
        old = []
        for can_id, data in drop(frames, "SUPERVISOR_CLAIM"):
            codec, new = self._old[can_id], self._new[can_id]
            counts = new.raw(data)._asdict() | values | {"sample_tick": tick % 2**16}
            for name in codec.signals:
                counts[name] = round(counts[name] * new.scale.get(name, codec.scale[name]) / codec.scale[name])
            old.append(Frame(can_id, codec.pack_raw(self._counts[can_id], *(counts[name] for name in codec.signals))))
            self._counts[can_id] += 1
        return old


def write_log_of_version_1(path: Path, seconds: float) -> None:
    """Write the frames of `write_log` as frames of version 1."""
    plant, controller = PlantNode(profile=load_profile("engagement", seconds)), load_node("controller")()
    inbox: list[Frame] = []
    with can.Logger(path) as log:
        frames = _OldFrames()

        def put(tick: int, sent: list[Frame]) -> None:
            for can_id, data in frames.translate(tick, sent):
                log(can.Message(plant.tick * 1e-3 + 1.0, can_id, is_extended_id=False, data=data, channel=0))

        put(0, [plant.make_heartbeat(Lifecycle.INACTIVE)])
        while not plant.finished:
            sensors = plant.step(inbox)
            put(plant.tick, sensors)
            inbox = controller.step(sensors)
            put(plant.tick, inbox)
