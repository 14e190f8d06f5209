"""The frame with which a plant ends. Each test has the module as argument, so that it can run on mutants (tests/mutation)."""

from types import ModuleType

import numpy as np
import pytest

import plant_sim.node.interface
from plant_sim.rigs import wet_clutch
from protocols.can.frames import load_frames
from protocols.can.lifecycle import Lifecycle

BEAT = load_frames()["PLANT_HEARTBEAT"]


@pytest.fixture(scope="module")
def interface() -> ModuleType:
    return plant_sim.node.interface


def test_a_plant_ends_with_a_last_heartbeat(interface: ModuleType) -> None:
    class Board(interface.Interface):  # type: ignore[name-defined,misc]
        columns = ()
        show = advance = lambda self: None

    board = Board(500, [wet_clutch.load_nominal()], [1], 9, np.zeros((0, 5, 1)))
    for beats in (1, 2):
        ((can_id, data),) = board.list_safe_frames()
        assert (can_id, data[2]) == (BEAT.can_id, beats)
        assert BEAT.is_valid(data)
        assert BEAT.unpack(data) == (Lifecycle.FINALIZED, 500, 9)
    assert BEAT.unpack(board.make_heartbeat(Lifecycle.INACTIVE).data).lifecycle == Lifecycle.INACTIVE


def test_a_plant_that_has_claimed_set_points_releases_them_first(interface: ModuleType) -> None:
    class Board(interface.Interface):  # type: ignore[name-defined,misc]
        columns = ()
        show = advance = lambda self: None

    board = Board(500, [wet_clutch.load_nominal()] * 2, [1, 2], 9, np.zeros((2, 5, 1)))
    claims = [load_frames(clutch=clutch)["SUPERVISOR_CLAIM"] for clutch in ("a", "b")]
    for releases in (1, 2):
        *released, (can_id, _) = board.list_safe_frames()
        assert can_id == BEAT.can_id
        for codec, frame in zip(claims, released, strict=True):
            assert (frame.can_id, frame.data[2]) == (codec.can_id, releases)
            assert codec.is_valid(frame.data)
            assert (codec.unpack(frame.data).claim, codec.unpack(frame.data).session) == (0, 0x8009)
