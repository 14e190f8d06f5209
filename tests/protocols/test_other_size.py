"""Frames of a bench of another size are found out, and damage is not taken for them."""

import random
from itertools import islice
from pathlib import Path

import pytest

from protocols.can.frames import DBC_1, Frame, FrameCodec, load_frames
from protocols.can.other_size import SizeWatch, find_key
from protocols.can.size import SHIPPED, compute_key, read_size, write_sized_text
from protocols.errors import InputError

SIZES = {"large": (300.0, 100.0, 25.0), "strong": (300.0,), "fast": (50.0, 250.0)}


@pytest.fixture(scope="module")
def benches(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, FrameCodec]]:
    """Frames of the shipped bench, and of some of other sizes."""
    folder = tmp_path_factory.mktemp("benches")
    paths = {name: folder / f"{name}.dbc" for name in SIZES}
    for name, size in SIZES.items():
        paths[name].write_text(write_sized_text(*size), encoding="utf-8")
    return {name: load_frames(path) for name, path in {"shipped": SHIPPED, **paths}.items()}


def make_frames(codecs: dict[str, FrameCodec]) -> list[Frame]:
    """Frames of a plant in service."""
    return [Frame(codecs[n].can_id, codecs[n].pack(k)) for k in range(3) for n in ("ANALOG_SENSORS", "ENCODER")]


def test_frames_of_another_size_are_told_with_what_to_do(benches: dict[str, dict[str, FrameCodec]]) -> None:
    for here, own in benches.items():
        for there, codecs in benches.items():
            if here == there:
                SizeWatch(own.values(), "on local:x").hear(make_frames(codecs))
                continue
            with pytest.raises(InputError) as refused:
                SizeWatch(own.values(), "on local:x").hear(make_frames(codecs))
            assert str(refused.value).startswith(
                "frames ANALOG_SENSORS, ENCODER on local:x come from a bench of another size, as their CRC fits other data IDs"
            )
            assert "CLUTCH_HIL_DATABASE" in str(refused.value)


def test_frames_may_come_one_at_a_time(benches: dict[str, dict[str, FrameCodec]]) -> None:
    watch = SizeWatch(benches["shipped"].values(), "on local:x")
    heartbeat = benches["large"]["PLANT_HEARTBEAT"]
    watch.hear([Frame(heartbeat.can_id, heartbeat.pack(1, rate=1000))])
    with pytest.raises(InputError, match=r"^frames PLANT_HEARTBEAT on local:x come from a bench of another size"):
        watch.hear([Frame(heartbeat.can_id, heartbeat.pack(2, rate=1000))])


def test_the_key_is_the_difference_of_those_of_both_benches(
    benches: dict[str, dict[str, FrameCodec]], tmp_path: Path
) -> None:
    keys = {"shipped": 0}
    for name, size in SIZES.items():
        path = tmp_path / f"{name}.dbc"
        path.write_text(write_sized_text(*size), encoding="utf-8")
        keys[name] = compute_key(read_size(path))
    for here, own in benches.items():
        for there, codecs in benches.items():
            frame = codecs["PLANT_STATUS"].pack(5, late_cycles=3)
            assert find_key(own["PLANT_STATUS"], frame) == keys[here] ^ keys[there]


def test_one_right_frame_ends_the_watch(benches: dict[str, dict[str, FrameCodec]]) -> None:
    own, other = make_frames(benches["shipped"]), make_frames(benches["large"])
    watch = SizeWatch(benches["shipped"].values(), "on local:x")
    watch.hear(other[:1] + own[:1] + other)
    watch.hear(other)


def test_damage_by_chance_is_not_another_size(benches: dict[str, dict[str, FrameCodec]]) -> None:
    chance, codec = random.Random(3), benches["shipped"]["ENCODER"]
    result = 0
    for _ in range(300):
        watch = SizeWatch([codec], "on local:x")
        try:
            watch.hear(Frame(codec.can_id, chance.randbytes(8)) for _ in range(2))
        except InputError:
            result += 1
    assert result == 0
    single = sum(find_key(codec, chance.randbytes(8)) > 0 for _ in range(2000))
    assert single < 2000 / 8 * 1.3  # 13 bits of 16


def test_set_points_have_sessions_and_other_frames_no_meaning(benches: dict[str, dict[str, FrameCodec]]) -> None:
    own = benches["shipped"]
    setpoint = own["TORQUE_SETPOINT"]
    watch = SizeWatch(own.values(), "on local:x")
    for session in islice(range(0x0800, 0x10000, 7), 2000):
        data = setpoint.bind(session).pack(1, torque_demand=3.0)
        assert find_key(setpoint, data) == 0
        watch.hear([Frame(setpoint.can_id, data), Frame(0x7FF, data)])
    for data in (b"", b"\1\2\3", bytes(7)):
        assert find_key(own["ENCODER"], data) == 0
        watch.hear([Frame(own["ENCODER"].can_id, data)] * 3)
    old = load_frames(DBC_1)["ENCODER"]
    assert find_key(old, benches["large"]["ENCODER"].pack(1)) == 0
