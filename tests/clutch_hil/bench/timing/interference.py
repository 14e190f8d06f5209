"""The closed loop in one process, and what may happen to the plant's frames on their way to the controller."""

from collections.abc import Callable

import numpy as np

from clutch_hil.bench.in_process import Played, play
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import Profile
from protocols.can.frames import Frame, load_frames
from protocols.node import load_node

Interference = Callable[[int, list[Frame]], list[Frame]]  # of a tick and its frames

_SENSORS = {load_frames()[name].can_id: load_frames()[name] for name in ("ANALOG_SENSORS", "ENCODER")}
controller_node = load_node("controller")


def play_undisturbed(profile: Profile, **controller: object) -> Played:
    """Plant and controller, undisturbed."""
    return play(PlantNode(profile=profile), controller_node(**controller))


def play_with_changes(change: Interference, profile: Profile) -> tuple[Played, list[list[Frame]]]:
    """Play with the plant's frames changed by `change(tick, frames)`; also what the controller sent, by tick."""
    plant, controller = PlantNode(profile=profile), controller_node()
    sent: list[list[Frame]] = []
    plant_rows, controller_rows = [], []
    inbox: list[Frame] = []
    while not plant.finished:
        frames = plant.step(inbox)
        inbox = controller.step(change(plant.tick, frames))
        sent.append(inbox)
        plant_rows.append(plant.make_row())
        controller_rows.append(controller.make_row())
    plant_record, record = np.array(plant_rows, float), np.array(controller_rows, float)
    return Played(plant_record, (record,), tuple(plant.columns), (tuple(controller.columns),)), sent


def make_interference(since: int = 0, noise: int = 0, **counts: int) -> Interference:
    """From tick `since` on, channels of the sensors that show the given counts, in frames that are valid.

    They are above them by `noise` counts in every second frame.
    """

    def change(tick: int, frames: list[Frame]) -> list[Frame]:
        if tick < since:
            return frames
        now = {name: value + noise * (tick & 1) for name, value in counts.items()}
        return [_with_counts(tick, frame, now) for frame in frames]

    return change


def _with_counts(tick: int, frame: Frame, counts: dict[str, int]) -> Frame:
    """A sensor frame with those of the `counts` that it has; another frame as it is."""
    codec = _SENSORS.get(frame.can_id)
    own = {name: count for name, count in counts.items() if codec and name in codec.signals}
    if codec is None or not own:
        return frame
    return Frame(frame.can_id, codec.pack_raw(tick, *codec.raw(frame.data)._replace(**own)))


def play_restart(profile: Profile, at: int) -> list[float]:
    """The last record of a controller that was started anew at tick `at`."""
    plant, controller = PlantNode(profile=profile), controller_node()
    inbox: list[Frame] = []
    while not plant.finished:
        if plant.tick == at:
            controller = controller_node()
        inbox = controller.step(plant.step(inbox))
    return list(controller.make_row())
