"""Messages of python-can on a made-up channel, to the bit. Each test has the module as argument, so that it can run on mutants
(tests/mutation)."""

import errno
import os
import select
import struct
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import can
import pytest

import protocols.buses.local_bus
from protocols.buses.local_channel import OwnFrame
from tests.mutation.mutants import load_mutant, parse_plain

EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000  # linux/can.h
BRS, ESI, FDF = 1, 2, 4


@pytest.fixture
def local_bus() -> ModuleType:
    return load_mutant(parse_plain(protocols.buses.local_bus))


def pack(identifier: int, data: bytes, length: int | None = None) -> bytes:
    """A struct can_frame."""
    return struct.pack("=IB3x8s", identifier, len(data) if length is None else length, data)


def pack_fd(identifier: int, length: int, flags: int, data: bytes) -> bytes:
    """A struct canfd_frame."""
    return struct.pack("=IBB2x64s", identifier, length, flags, data)


class Descriptors:
    """Events that do not block, for a bus and its channel. Each is closed once: another may have its number then."""

    def __init__(self) -> None:
        self.open = set[int]()

    def make(self, initial: int) -> int:
        self.open.add(made := os.eventfd(initial, os.EFD_NONBLOCK))
        return made

    def close(self, descriptor: int) -> None:
        self.open.remove(descriptor)
        os.close(descriptor)


class Channel:
    """A made-up channel; `refusals` are what its sends return. It is readable while `comes` has frames."""

    def __init__(self, name: str, receives_own: bool, descriptors: Descriptors) -> None:
        self.name, self.receives_own, self.log = name, receives_own, list[tuple[Any, ...]]()
        self.refusals, self.participants, self._comes = list[int](), list[str](), list[tuple[int, bytes]]()
        self.descriptors, self._descriptor, self._waited = descriptors, descriptors.make(0), False

    def bring(self, *frames: bytes) -> None:
        """Frames come, at 1, 2, .. s."""
        self._comes = [(n * 1_000_000_000, frame) for n, frame in enumerate(frames, 1)]
        os.eventfd_write(self._descriptor, 1)

    def send(self, frame: bytes) -> int:
        self.log.append(("send", frame))
        return self.refusals.pop(0) if self.refusals else 0

    def wait(self, timeout: float | None) -> bool:
        self.log.append(("wait", timeout))
        self._waited = bool(self._comes)
        return self._waited

    def receive(self) -> list[tuple[int, bytes]]:
        assert self._waited
        self._waited = False
        os.eventfd_read(self._descriptor)
        comes, self._comes = self._comes, []
        return comes

    def fileno(self) -> int:
        return self._descriptor

    def close(self) -> None:
        self.log.append(("close",))
        self.descriptors.close(self._descriptor)


@contextmanager
def opened(local_bus: ModuleType, *arguments: Any, **named: Any) -> Iterator[tuple[Any, Channel]]:
    """A bus on a made-up channel."""
    descriptors = Descriptors()
    local_bus.LocalChannel = lambda name, own: Channel(name, own, descriptors)  # type: ignore[attr-defined]
    local_bus.os = SimpleNamespace(  # type: ignore[attr-defined]
        eventfd=descriptors.make, eventfd_read=os.eventfd_read, eventfd_write=os.eventfd_write, close=descriptors.close
    )
    local_bus.LocalBus.__del__ = lambda self: None  # python-can's shuts down what a mutant has left open
    try:
        bus = local_bus.LocalBus(*(arguments or ("b",)), **named)
        yield bus, bus.raw
        bus.shutdown()
    finally:
        for descriptor in set(descriptors.open):
            descriptors.close(descriptor)


def is_readable(bus: Any) -> bool:
    return bool(select.select([bus], [], [], 0.0)[0])


def receive(local_bus: ModuleType, frame: bytes) -> can.Message:
    """The message that a bus with CAN FD makes of a frame at 1 s."""
    with opened(local_bus, fd=True) as (bus, channel):
        channel.bring(frame)
        message = bus.recv(0)
        assert message is not None
        return message


# --- opening and closing ---------------------------------------------------------------------------------------------


def test_a_bus_has_the_name_of_its_channel(local_bus: ModuleType) -> None:
    for channel, name in (("b", "b"), (5, "5"), (None, "")):
        with opened(local_bus, channel) as (bus, raw):
            assert (raw.name, raw.receives_own, bus.channel_info) == (name, False, f"local:{name}")
            assert bus.protocol == can.CanProtocol.CAN_20
    with opened(local_bus, receive_own_messages=True, fd=True) as (bus, raw):
        assert (raw.receives_own, bus.protocol) == (True, can.CanProtocol.CAN_FD)


def test_a_bus_that_is_shut_down_leaves_no_descriptor_and_says_so(local_bus: ModuleType) -> None:
    with opened(local_bus) as (bus, channel):
        bus.shutdown()
        bus.shutdown()
        assert channel.descriptors.open == set()
        with pytest.raises(ValueError, match="closed"):
            bus.fileno()
        assert channel.log == [("close",)]
        for call in (lambda: bus.recv(0), lambda: bus.send(can.Message())):
            with pytest.raises(can.CanOperationError, match="local:b is shut down") as sentence:
                call()
            assert sentence.value.error_code == errno.EBADF
        assert channel.log == [("close",)]


def test_a_bus_is_found_by_the_sockets_of_its_participants(local_bus: ModuleType) -> None:
    with tempfile.TemporaryDirectory() as root:
        local_bus.find_bus_root = lambda: Path(root)  # type: ignore[attr-defined]
        for name, files in {"c": ["12-1"], "b": ["12-2", "13-1", "lock"], "empty": ["lock"]}.items():
            (Path(root) / name).mkdir()
            for file in files:
                (Path(root) / name / file).touch()
        result = [{"interface": "local", "channel": name} for name in ("b", "c")]
        assert local_bus.LocalBus._detect_available_configs() == result


# --- sending ---------------------------------------------------------------------------------------------------------


def list_sent(local_bus: ModuleType, messages: Sequence[can.Message]) -> list[bytes]:
    """The frames that a bus with CAN FD sends."""
    with opened(local_bus, fd=True) as (bus, channel):
        for message in messages:
            bus.send(message)
        return [frame for _, frame in channel.log]


def test_a_classic_message_is_a_can_frame(local_bus: ModuleType) -> None:
    standard = {"is_extended_id": False}
    for message, frame in (
        (can.Message(arbitration_id=0x122, data=b"abc", **standard), pack(0x122, b"abc")),
        (can.Message(arbitration_id=0x7FF, data=b"12345678", **standard), pack(0x7FF, b"12345678")),
        (can.Message(arbitration_id=0x1ABCDEF0, data=b""), pack(0x1ABCDEF0 | EXTENDED, b"")),
        (can.Message(arbitration_id=0x122, is_remote_frame=True, dlc=5, **standard), pack(0x122 | REMOTE, b"", 5)),
        (can.Message(arbitration_id=0x4, is_error_frame=True, data=b"e", **standard), pack(0x4 | ERROR, b"e")),
        (can.Message(arbitration_id=0x4, is_remote_frame=True, dlc=1), pack(0x4 | EXTENDED | REMOTE, b"", 1)),
        (can.Message(arbitration_id=0x122, data=b"abc", dlc=8, **standard), pack(0x122, b"abc")),
    ):
        assert list_sent(local_bus, [message]) == [frame]


def test_an_fd_message_is_a_canfd_frame_of_a_length_that_exists(local_bus: ModuleType) -> None:
    full = bytes(range(64))
    for given, flags in (
        ({}, FDF), ({"bitrate_switch": True}, FDF | BRS), ({"error_state_indicator": True}, FDF | ESI),
        ({"bitrate_switch": True, "error_state_indicator": True}, FDF | BRS | ESI),
    ):  # fmt: skip
        message = can.Message(arbitration_id=0x122, is_extended_id=False, is_fd=True, data=full, **given)
        assert list_sent(local_bus, [message]) == [pack_fd(0x122, 64, flags, full)]
    for length, sentence in ((0, 0), (7, 7), (8, 8), (9, 12), (12, 12), (13, 16), (33, 48), (49, 64)):
        message = can.Message(arbitration_id=0x122, is_fd=True, data=full[:length])
        assert list_sent(local_bus, [message]) == [pack_fd(0x122 | EXTENDED, sentence, FDF, full[:length])]


def test_a_message_with_too_much_data_is_refused(local_bus: ModuleType) -> None:
    for is_fd, most in ((False, 8), (True, 64)):
        message = can.Message(is_fd=is_fd, data=bytes(most + 1))
        with pytest.raises(can.CanOperationError) as sentence:
            list_sent(local_bus, [message])
        assert sentence.value.error_code == errno.EINVAL
        assert f"message of {most + 1} data bytes; allowed are up to {most}" in str(sentence.value)


def test_without_fd_an_fd_message_is_refused(local_bus: ModuleType) -> None:
    with opened(local_bus) as (bus, channel):
        with pytest.raises(can.CanOperationError, match="sent on local:b, opened without fd") as sentence:
            bus.send(can.Message(is_fd=True))
        assert sentence.value.error_code == errno.EINVAL
        assert channel.log == []
        bus.send(can.Message())
        assert len(channel.log) == 1


def test_a_send_fails_where_all_participants_refuse(local_bus: ModuleType) -> None:
    for others, refusals, fails in (
        (0, 0, False),
        (2, 0, False),
        (2, 1, False),
        (2, 2, True),
        (1, 2, True),
        (1, 1, True),
    ):
        with opened(local_bus) as (bus, channel):
            channel.participants, channel.refusals = ["other"] * others, [refusals]
            if fails:
                with pytest.raises(can.CanOperationError, match=f"all {refusals} participants of local:b") as sentence:
                    bus.send(can.Message())
                assert sentence.value.error_code == errno.ENOBUFS
            else:
                bus.send(can.Message())


# --- receiving -------------------------------------------------------------------------------------------------------


def test_a_can_frame_is_a_classic_message(local_bus: ModuleType) -> None:
    """Of a standard identifier 11 bits count, of an extended one 29."""
    for identifier, arbitration_id, extended, remote, error in (
        (0x122, 0x122, False, False, False), (0x7FF, 0x7FF, False, False, False), (0x1922, 0x122, False, False, False),
        (EXTENDED | 0x1FFFFFFF, 0x1FFFFFFF, True, False, False), (EXTENDED | 0x1922, 0x1922, True, False, False),
        (REMOTE | 0x122, 0x122, False, True, False), (ERROR | 0x4, 0x4, False, False, True),
    ):  # fmt: skip
        message = receive(local_bus, pack(identifier, b"abc"))
        assert (message.arbitration_id, message.is_extended_id) == (arbitration_id, extended)
        assert (message.is_remote_frame, message.is_error_frame, message.is_fd) == (remote, error, False)
        assert (message.bitrate_switch, message.error_state_indicator) == (False, False)
        assert (message.dlc, bytes(message.data)) == (3, b"" if remote else b"abc")
        assert (message.timestamp, message.channel, message.is_rx) == (1.0, "b", True)


def test_a_canfd_frame_is_an_fd_message(local_bus: ModuleType) -> None:
    data = bytes(range(12))
    for flags, switches, indicates in ((FDF, False, False), (FDF | BRS, True, False), (FDF | ESI, False, True)):
        message = receive(local_bus, pack_fd(0x123, 12, flags, data))
        assert (message.arbitration_id, message.is_extended_id, message.is_fd) == (0x123, False, True)
        assert (message.bitrate_switch, message.error_state_indicator) == (switches, indicates)
        assert (message.dlc, bytes(message.data)) == (12, data)


def test_an_own_message_is_marked_as_sent(local_bus: ModuleType) -> None:
    assert receive(local_bus, OwnFrame(pack(0x123, b""))).is_rx is False


def test_without_fd_fd_frames_are_not_received(local_bus: ModuleType) -> None:
    frames = pack(1, b""), pack_fd(2, 0, FDF, b""), pack(3, b"")
    for fd, identifiers in ((False, [1, 3]), (True, [1, 2, 3])):
        with opened(local_bus, fd=fd) as (bus, channel):
            channel.bring(*frames)
            assert [message.arbitration_id for message in iter(lambda bus=bus: bus.recv(0), None)] == identifiers


def test_messages_pass_the_filters_of_when_they_come(local_bus: ModuleType) -> None:
    """python-can is told that they have passed: it looks no more."""
    with opened(local_bus, can_filters=[{"can_id": 2, "can_mask": 0x7FE, "extended": False}]) as (bus, channel):
        channel.bring(*(pack(identifier, b"") for identifier in (1, 2, 3, 4)))
        message, passed = bus._recv_internal(0)
        assert (message.arbitration_id, passed) == (2, True)
        bus.set_filters([{"can_id": 9, "can_mask": 0x7FF}])
        message, passed = bus._recv_internal(0)
        assert (message.arbitration_id, passed) == (3, True)
        assert bus._recv_internal(0) == (None, True)


def test_messages_are_waited_for_where_none_is_there(local_bus: ModuleType) -> None:
    with opened(local_bus) as (bus, channel):
        assert bus._recv_internal(0.25) == (None, True)
        channel.bring(pack(1, b""), pack(2, b""))
        for identifier in (1, 2):
            assert bus._recv_internal(0.5)[0].arbitration_id == identifier
        assert bus._recv_internal(None) == (None, True)
        assert channel.log == [("wait", 0.25), ("wait", 0.5), ("wait", None)]


def test_a_bus_is_readable_while_a_message_is_there(local_bus: ModuleType) -> None:
    """In its channel or, as all of a burst were taken with its first, in itself."""
    with opened(local_bus) as (bus, channel):
        for identifiers in ([], [1], [1, 2, 3], [], [1, 2]):
            assert not is_readable(bus)
            if identifiers:
                channel.bring(*(pack(identifier, b"") for identifier in identifiers))
            for identifier in identifiers:
                assert is_readable(bus)
                assert bus.recv(0).arbitration_id == identifier
            assert not is_readable(bus)
            assert bus.recv(0) is None
