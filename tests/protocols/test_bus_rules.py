"""Buses by name, and what their ports count. Each test has the module as argument, so that it can run on mutants
(tests/mutation). It is the source of bus.py with channels, sockets, interfaces and clock made up."""

import errno
import os
import socket
import struct
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import can
import pytest

import protocols.buses.bus
from protocols.can.frames import Frame
from protocols.errors import InputError
from tests.mutation.mutants import load_mutant, parse_plain

FULL, DOWN = (errno.ENOBUFS, errno.EAGAIN, errno.ENOMEM), (errno.ENETDOWN, errno.ENXIO, errno.ENODEV)
SECOND = 1_000_000_000  # ns


@pytest.fixture
def bus() -> ModuleType:
    return load_mutant(parse_plain(protocols.buses.bus))


def pack(can_id: int, data: bytes, length: int | None = None) -> bytes:
    """A struct can_frame of linux/can.h."""
    return struct.pack("=IB3x8s", can_id, len(data) if length is None else length, data)


class Raw:
    """A made-up bus below a port: `results` are what its sends return or raise, `waiting` what has come."""

    def __init__(self, listener: int | None = None) -> None:
        self.listener, self.log = listener, list[tuple[Any, ...]]()
        self.results, self.waiting = list[int | OSError](), list[tuple[int, bytes]]()

    def send(self, packed: bytes) -> int:
        self.log.append(("send", packed))
        result = self.results.pop(0) if self.results else 0
        if isinstance(result, OSError):
            raise result
        return result

    def receive(self) -> list[tuple[int, bytes]]:
        waiting, self.waiting = self.waiting, []
        return waiting

    def wait(self, timeout: float) -> str:
        return f"waited {timeout:g}"

    def note_refusals(self, descriptor: int, refused: int) -> None:
        self.log.append(("note", descriptor, refused))

    def close(self) -> None:
        self.log.append(("close",))


def make_port(bus: ModuleType, listener: int | None = None) -> tuple[Any, Raw]:
    raw = Raw(listener)
    return bus.Port("made-up", raw), raw


def count(port: Any) -> tuple[int, ...]:
    """Frames sent, received, refused, down, ignored."""
    counts = port.read_counts()
    assert list(counts) == ["sent", "received", "refused", "down", "ignored"]
    return tuple(counts.values())


# --- sending ---------------------------------------------------------------------------------------------------------


def test_a_frame_is_sent_as_the_kernel_has_it(bus: ModuleType) -> None:
    port, raw = make_port(bus)
    assert (port.name, count(port)) == ("made-up", (0, 0, 0, 0, 0))
    port.send(Frame(0x701, b"\x01\x02\x03"))
    assert raw.log == [("send", b"\x01\x07\0\0" + b"\x03\0\0\0" + b"\x01\x02\x03\0\0\0\0\0")]
    assert count(port) == (1, 0, 0, 0, 0)


def test_what_a_bus_does_not_take_is_counted(bus: ModuleType) -> None:
    port, raw = make_port(bus)
    raw.results = [0, 1, 0, 1, 1]
    for _ in range(5):
        port.send(Frame(0x080, b""))
    assert count(port) == (5, 0, 3, 0, 0), "sent to others, refused by one"
    for codes, counts in ((FULL, (0, 0, 3, 0, 0)), (DOWN, (0, 0, 0, 3, 0))):
        port, raw = make_port(bus)
        raw.results = [OSError(code, "made up") for code in codes]
        for _ in codes:
            port.send(Frame(0x080, b""))
        assert count(port) == counts


def test_another_error_of_a_send_is_raised(bus: ModuleType) -> None:
    for code in (errno.EBADF, errno.EPIPE, errno.EPERM):
        port, raw = make_port(bus)
        raw.results = [OSError(code, "made up")]
        with pytest.raises(OSError, match="made up") as sentence:
            port.send(Frame(0x080, b""))
        assert sentence.value.errno == code
        assert count(port) == (0, 0, 0, 0, 0)


def test_frames_that_a_can_socket_lost_are_counted(bus: ModuleType) -> None:
    for codes, counts in ((FULL, (7, 0, 3, 0, 0)), (DOWN, (7, 0, 0, 3, 0))):
        for code in codes:
            port, raw = make_port(bus)
            port.sent = 10
            assert port.count_lost(5, code, 3) is False
            assert (count(port), raw.log) == (counts, [])
    port, _ = make_port(bus)
    with pytest.raises(OSError, match=os.strerror(errno.EPIPE)):
        port.count_lost(5, errno.EPIPE, 3)


def test_frames_that_a_participant_did_not_take_are_counted(bus: ModuleType) -> None:
    """Of a local bus: a full queue refuses, and with another error the participant has left."""
    for code in FULL:
        port, raw = make_port(bus, listener=8)
        port.sent = port.refused = 10
        assert port.count_lost(5, code, 3) is False
        assert (count(port), raw.log) == ((10, 0, 13, 0, 0), [("note", 5, 3)])
    for code in (errno.EPIPE, errno.ECONNRESET, errno.ENETDOWN):
        port, raw = make_port(bus, listener=8)
        port.sent = port.refused = 10
        assert port.count_lost(5, code, 3) is True
        assert (count(port), raw.log) == ((10, 0, 10, 0, 0), [("note", 5, 0)])


# --- receiving -------------------------------------------------------------------------------------------------------


def test_frames_come_with_their_stamps(bus: ModuleType) -> None:
    port, raw = make_port(bus)
    sent = [(70, pack(0x101, b"abcdefgh")), (71, pack(0x7FF, b"")), (72, pack(0x101, b"ab"))]
    frames = [Frame(0x101, b"abcdefgh"), Frame(0x7FF, b""), Frame(0x101, b"ab")]
    raw.waiting = list(sent)
    assert port.receive_stamped() == list(zip((70, 71, 72), frames, strict=True))
    assert (port.stamps, count(port)) == ({0x101: 72, 0x7FF: 71}, (0, 3, 0, 0, 0))
    raw.waiting = list(sent)
    assert port.receive() == frames
    assert count(port) == (0, 6, 0, 0, 0)
    assert port.receive() == []


def test_frames_of_another_kind_are_ignored(bus: ModuleType) -> None:
    """Extended, remote, error, CAN FD. Of an identifier 11 bits count."""
    port, raw = make_port(bus)
    others = [pack(0x080 | flag, b"abc") for flag in (0x80000000, 0x40000000, 0x20000000)] + [bytes(72), b""]
    raw.waiting = [(1, other) for other in others] + [(2, pack(0x1881, b"ab"))]
    assert port.receive() == [Frame(0x081, b"ab")]
    assert (port.stamps, count(port)) == ({0x081: 2}, (0, 1, 0, 0, 5))
    raw.waiting = [(3, bytes(72))]
    assert port.receive() == []
    assert count(port) == (0, 1, 0, 0, 6)


def test_a_port_waits_and_closes_as_its_bus_does(bus: ModuleType) -> None:
    port, raw = make_port(bus)
    assert port.wait(0.25) == "waited 0.25"
    with port as inside:
        assert inside is port
        assert raw.log == []
    assert raw.log == [("close",)]


def test_for_a_time_all_frames_are_heard(bus: ModuleType) -> None:
    now, log, looks = [50.0], list[float](), iter(range(10))

    def look() -> float:
        assert next(looks, 10) < 10, "it does not end"
        return now[0]

    bus.time = SimpleNamespace(monotonic=look)  # type: ignore[attr-defined]
    comes = [(0.25, True), (0.5, False), (0.75, True), (0.5, False)]

    def wait(left: float) -> bool:
        after, heard = comes.pop(0)
        log.append(left)
        now[0] += after
        return heard

    port = SimpleNamespace(wait=wait, receive=lambda: [f"frame at {now[0]:g}", "and another"])
    heard = bus.listen(port, 2.0)
    assert heard == ["frame at 50.25", "and another", "frame at 51.5", "and another"]
    assert log == [2.0, 1.75, 1.25, 0.5]
    assert bus.listen(port, 0.0) == []


# --- a local bus -----------------------------------------------------------------------------------------------------


def test_a_local_bus_is_its_channel(bus: ModuleType) -> None:
    refusals = [0, 1, 3]
    channel = SimpleNamespace(
        wait="wait", close="close", listener=7, list_sockets="list", note_refusals="note", changes=4,
        send=lambda packed: refusals.pop(0), receive=lambda: "waiting",
    )  # fmt: skip
    bus.LocalChannel = {"NAME": channel}.get  # type: ignore[attr-defined]
    port = bus.open_bus("local:NAME")
    raw = port.raw
    assert (port.name, raw.wait, raw.close, raw.listener, raw.changes) == ("local:NAME", "wait", "close", 7, 4)
    assert (raw.list_sockets, raw.note_refusals, raw.receive()) == ("list", "note", "waiting")
    assert [raw.send(b"packed") for _ in range(3)] == [0, 1, 1], "one frame is refused, by however many"
    channel.changes = 5
    assert raw.changes == 5


def test_a_local_bus_that_cannot_be_opened_is_told(bus: ModuleType) -> None:
    for error in (can.CanInitializationError("made up"), OSError("made up"), ValueError("made up")):

        def fail(name: str, error: Exception = error) -> None:
            raise error

        bus.LocalChannel = fail  # type: ignore[attr-defined]
        with pytest.raises(InputError, match="bus local:NAME cannot be opened: made up"):
            bus.open_bus("local:NAME")


# --- SocketCAN -------------------------------------------------------------------------------------------------------


class Socket:
    """A made-up CAN socket: `comes` are packets, or the errors of a receive; then nothing is there."""

    def __init__(self, comes: tuple[Any, ...] = (), refuses: int = 0) -> None:
        self.comes, self.refuses, self.log, self.empty = list(comes), refuses, list[tuple[Any, ...]](), 0

    def setblocking(self, blocking: bool) -> None:
        self.log.append(("blocking", blocking))

    def setsockopt(self, level: int, option: int, value: int) -> None:
        if option == self.refuses:
            raise PermissionError
        self.log.append((level, option, value))

    def send(self, packed: bytes) -> int:
        self.log.append(("send", packed))
        return len(packed)

    def fileno(self) -> int:
        return 6

    def recvmsg(self, size: int, control: int) -> tuple[Any, ...]:
        assert (size, control) == (16, 32)
        if not self.comes:
            self.empty += 1
            assert self.empty == 1, "nothing is there"
            raise BlockingIOError(errno.EAGAIN, "made up")
        one = self.comes.pop(0)
        if isinstance(one, OSError):
            raise one
        return one if isinstance(one, tuple) else (one, [], 0, ())


def make_stamped(packed: bytes, seconds: int, nanoseconds: int) -> tuple[Any, ...]:
    """What recvmsg returns for a frame with a stamp of the kernel."""
    return packed, [(socket.SOL_SOCKET, 35, struct.pack("=qq", seconds, nanoseconds))], 0, ()


def make_can_port(bus: ModuleType, *comes: Any, refuses: int = 0) -> tuple[Any, Socket]:
    made = Socket(comes, refuses)
    made_bus = SimpleNamespace(socket=made, shutdown=lambda: made.log.append(("shutdown",)))
    return bus._SocketCanPort(made_bus), made


def test_a_can_socket_never_blocks_and_has_stamps_and_a_large_buffer(bus: ModuleType) -> None:
    """SO_TIMESTAMPNS is 35, SO_RCVBUFFORCE 33 (asm-generic/socket.h): only root may use the latter."""
    stamps, plain = (socket.SOL_SOCKET, 35, 1), (socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * 1024 * 1024)
    forced = (socket.SOL_SOCKET, 33, 4 * 1024 * 1024)
    for refuses, options in ((0, [stamps, plain, forced]), (33, [stamps, plain])):
        _, made = make_can_port(bus, refuses=refuses)
        assert made.log == [("blocking", False), *options]


def test_a_can_socket_sends_one_frame_after_another(bus: ModuleType) -> None:
    raw, made = make_can_port(bus)
    made.log.clear()
    assert raw.send(b"packed") == 0
    assert (raw.listener, raw.changes, raw.list_sockets()) == (None, 0, ([6], [6]))
    raw.note_refusals(6, 3)
    raw.close()
    assert made.log == [("send", b"packed"), ("shutdown",)]


def test_frames_of_a_can_socket_have_the_stamps_of_the_kernel(bus: ModuleType) -> None:
    bus.time = SimpleNamespace(time_ns=lambda: 900)  # type: ignore[attr-defined]
    raw, _ = make_can_port(bus, make_stamped(b"first", 3, 5), b"without a stamp", make_stamped(b"last", 0, 7))
    assert raw.receive() == [(3 * SECOND + 5, b"first"), (900, b"without a stamp"), (7, b"last")]


def test_an_interface_that_goes_down_leaves_its_queued_frames(bus: ModuleType) -> None:
    gone = OSError(errno.ENETDOWN, "made up")
    raw, made = make_can_port(bus, make_stamped(b"first", 0, 1), gone, make_stamped(b"last", 0, 2))
    assert raw.receive() == [(1, b"first"), (2, b"last")]
    assert made.empty == 1
    raw, _ = make_can_port(bus, OSError(errno.EBADF, "made up"))
    with pytest.raises(OSError, match="made up"):
        raw.receive()


def test_a_flood_is_received_in_parts(bus: ModuleType) -> None:
    raw, made = make_can_port(bus, *[make_stamped(b"frame", 0, n) for n in range(5000)])
    assert [stamp for stamp, _ in raw.receive()] == list(range(4096))
    assert len(made.comes) == 5000 - 4096


def test_a_can_socket_is_waited_for(bus: ModuleType) -> None:
    raw, made = make_can_port(bus)
    for readable, comes in (([made], True), ([], False)):

        def select(*arguments: Any, readable: list[Socket] = readable) -> Any:
            assert arguments == ([made], [], [], 0.25)
            return readable, ["of another kind"] if not readable else [], []

        bus.select = SimpleNamespace(select=select)  # type: ignore[attr-defined]
        assert raw.wait(0.25) is comes


# --- names -----------------------------------------------------------------------------------------------------------


@contextmanager
def interfaces(bus: ModuleType, **known: tuple[int, int]) -> Iterator[None]:
    """A machine with network interfaces of these types and flags, and one that is just going."""
    with tempfile.TemporaryDirectory() as root:
        for name, (kind, flags) in known.items():
            folder = Path(root) / name
            folder.mkdir()
            (folder / "type").write_text(f"{kind}\n")
            (folder / "flags").write_text(f"0x{flags:x}\n")
        (Path(root) / "going").mkdir()
        bus._INTERFACES = Path(root)  # type: ignore[attr-defined]
        yield


UP, HALF = 0x1043, 0x10C2  # flags of an interface that is up, and of one that is not
MACHINE = {
    "vcan0": (280, UP),
    "can1": (280, HALF),
    "can0": (280, UP),
    "eth0": (1, UP),
    "tun0": (281, UP),
    "x25": (279, UP),
}


def test_auto_is_vcan0_where_it_is_up(bus: ModuleType) -> None:
    for known, name in (
        ({"vcan0": (280, UP)}, "vcan0"), ({"vcan0": (280, HALF)}, "local:clutch"), ({"vcan0": (1, UP)}, "local:clutch"),
        ({"can0": (280, UP)}, "local:clutch"), ({}, "local:clutch"),
    ):  # fmt: skip
        with interfaces(bus, **known):
            assert bus.resolve("auto") == name
            assert [bus.resolve(other) for other in ("can0", "vcan0", "local:x")] == ["can0", "vcan0", "local:x"]


def test_an_interface_of_socketcan_is_opened_by_name(bus: ModuleType) -> None:
    """Filters of the kernel: standard frames, of these identifiers alone; without identifiers all frames."""
    made, opened = Socket(), list[Any]()
    made_bus = SimpleNamespace(socket=made)
    bus.can = SimpleNamespace(  # type: ignore[attr-defined]
        Bus=lambda **settings: opened.append(settings) or made_bus, CanError=can.CanError
    )
    with interfaces(bus, **MACHINE):
        for name, only, filters in (
            ("auto", None, None), ("can0", (), None), ("can0", [0x080], [0x080]), ("can0", [1, 0x7FF], [1, 0x7FF]),
        ):  # fmt: skip
            port = bus.open_bus(name, only)
            assert port.name == {"auto": "vcan0"}.get(name, name)
            assert port.raw.list_sockets() == ([6], [6])
            sentence = filters and [{"can_id": can_id, "can_mask": 0xC00007FF} for can_id in filters]
            assert opened.pop() == {"interface": "socketcan", "channel": port.name, "can_filters": sentence}


def test_a_bus_that_is_unknown_or_down_is_told(bus: ModuleType) -> None:
    with interfaces(bus, **MACHINE):
        for name in ("can7", "eth0", "tun0", "x25", "going"):
            with pytest.raises(InputError) as sentence:
                bus.open_bus(name)
            known = "auto, can0, can1, local:NAME, vcan0"
            assert str(sentence.value) == f"bus {name!r} does not exist; available are {known}"
        with pytest.raises(InputError) as sentence:
            bus.open_bus("can1")
        assert str(sentence.value) == "bus can1 is down; bring it up with: ip link set can1 up"


def test_an_interface_that_cannot_be_opened_is_told(bus: ModuleType) -> None:
    def fail(**_: Any) -> None:
        raise can.CanError("made up")

    bus.can = SimpleNamespace(Bus=fail, CanError=can.CanError)  # type: ignore[attr-defined]
    with interfaces(bus, **MACHINE), pytest.raises(InputError, match="bus can0 cannot be opened: made up"):
        bus.open_bus("can0")
