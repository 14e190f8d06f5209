"""Bus: opened by name, `vcan0`, `can0` (SocketCAN), `local:NAME` (between processes, without a CAN kernel), or `auto`.

python-can opens and configures a SocketCAN bus. The loop then reads and writes the raw `struct can_frame` on its socket, at a
fifth of the cost of a message object (docs/timing.md). Tools (`candump`, `python -m can.viewer`) see an ordinary bus.
"""

import contextlib
import errno
import os
import select
import socket
import struct
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import can

from protocols.buses.local_channel import LocalChannel
from protocols.can.frames import Frame
from protocols.errors import InputError, join_names

AUTO_LOCAL = "local:clutch"  # bus of `auto` if vcan0 is not up
_CAN_FRAME = struct.Struct("=IB3x8s")  # struct can_frame: identifier and flags, length, data
_STANDARD_ID = 0x7FF
_FLAGS = 0xE0000000  # extended, remote, error: the bench uses no such frames
# identifier, extended, remote; a filter with the error flag (0x20000000) would let error frames through, and nothing else
_FILTER_MASK = 0xC0000000 | _STANDARD_ID
_INTERFACES = Path("/sys/class/net")
_ARPHRD_CAN = 280  # linux/if_arp.h
_IFF_UP = 1  # linux/if.h
_DRAIN_LIMIT = 4096  # frames received at once, so that a flood cannot stop the loop
_SO_TIMESTAMPNS = 35  # asm-generic/socket.h: the kernel stamps each frame; not defined in Python
_SO_RCVBUFFORCE = 33
_RECEIVE_BUFFER = 4 << 20  # bytes: some thousand frames, a second of a full bus
_FULL = (errno.ENOBUFS, errno.EAGAIN, errno.ENOMEM)
_TIMESPEC = struct.Struct("=qq")  # s, ns
_CONTROL = socket.CMSG_SPACE(_TIMESPEC.size)


class _RawPort(Protocol):
    """Carries packed frames. listener: descriptor on which new participants connect; None if they need no connection."""

    @property
    def listener(self) -> int | None: ...

    @property
    def changes(self) -> int:
        """How many times participants have joined or left so far."""

    def list_sockets(self) -> tuple[list[int], list[int]]:
        """Return the descriptors to receive from (listener first) and to send to, without participants that have left."""

    def note_refusals(self, descriptor: int, refused: int) -> None:
        """Count frames that the participant behind a descriptor has `refused`; 0: it has left."""

    def send(self, packed: bytes) -> int:
        """Send one frame; return 1 when it was refused because a queue is full, else 0."""

    def receive(self) -> list[tuple[int, bytes]]:
        """Return every waiting frame, as time stamp [ns of CLOCK_REALTIME] and packed frame, without blocking."""

    def wait(self, timeout: float) -> bool:
        """Return whether a frame comes within `timeout` [s]."""

    def close(self) -> None:
        """Leave the bus."""


class Port:
    """A participant's access to a bus, for frames with standard identifiers and up to 8 bytes.

    `sent`, `received`, `refused` (full queues), `down` (sends while the interface was down) and `ignored` (received, but
    remote, error, CAN FD or extended) count frames. `stamps`: time of the last frame of each identifier, from the kernel (on a
    local bus: its send time) [ns of CLOCK_REALTIME].
    """

    def __init__(self, name: str, raw: _RawPort) -> None:
        self.name = name
        self.sent = self.received = self.refused = self.down = self.ignored = 0
        self.stamps: dict[int, int] = {}
        self.raw = raw

    def send(self, frame: Frame) -> None:
        """Send without waiting. A frame that the bus cannot take is counted, not repeated."""
        try:
            self.refused += self.raw.send(_CAN_FRAME.pack(frame.can_id, len(frame.data), frame.data))
            self.sent += 1
        except OSError as error:
            self._count_unsent(error, 1)

    def count_lost(self, descriptor: int, error: int, frames: int) -> bool:
        """Count the last `frames` frames sent to a descriptor as not taken, because of `error` (errno).

        Returns whether the participant behind it has left. Raises OSError for any other error.
        """
        if self.raw.listener is None:
            self.sent -= frames
            self._count_unsent(OSError(error, os.strerror(error)), frames)
        elif error in _FULL:
            self.refused += frames
            self.raw.note_refusals(descriptor, frames)
        else:
            self.raw.note_refusals(descriptor, 0)
            return True
        return False

    def _count_unsent(self, error: OSError, frames: int) -> None:
        if error.errno in _FULL:
            self.refused += frames
        elif error.errno in (errno.ENETDOWN, errno.ENXIO, errno.ENODEV):
            self.down += frames
        else:
            raise error

    def receive(self) -> list[Frame]:
        """Return every waiting frame, oldest first, without blocking."""
        return [frame for _, frame in self.receive_stamped()]

    def receive_stamped(self) -> list[tuple[int, Frame]]:
        """Return every waiting frame with its time stamp [ns of CLOCK_REALTIME], oldest first, without blocking."""
        frames, heard = [], 0
        for stamp, packed in self.raw.receive():
            heard += 1
            if len(packed) == _CAN_FRAME.size:
                can_id, length, data = _CAN_FRAME.unpack(packed)
                if not can_id & _FLAGS:
                    can_id &= _STANDARD_ID
                    self.stamps[can_id] = stamp
                    frames.append((stamp, Frame(can_id, data[:length])))
        self.received += len(frames)
        self.ignored += heard - len(frames)
        return frames

    def wait(self, timeout: float) -> bool:
        """Return whether a frame comes within `timeout` [s]."""
        return self.raw.wait(timeout)

    def read_counts(self) -> dict[str, int]:
        """Return the counters by name."""
        return {name: getattr(self, name) for name in ("sent", "received", "refused", "down", "ignored")}

    def close(self) -> None:
        """Leave the bus."""
        self.raw.close()

    def __enter__(self) -> "Port":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _LocalPort:
    def __init__(self, channel: LocalChannel) -> None:
        self._channel = channel
        self.wait, self.close, self.listener = channel.wait, channel.close, channel.listener
        self.list_sockets, self.note_refusals = channel.list_sockets, channel.note_refusals

    @property
    def changes(self) -> int:
        return self._channel.changes

    def send(self, packed: bytes) -> int:
        return 1 if self._channel.send(packed) else 0

    def receive(self) -> list[tuple[int, bytes]]:
        return self._channel.receive()


class _SocketCanPort:
    listener = None
    changes = 0

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self._socket = bus.socket  # type: ignore[attr-defined]
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        for option in (socket.SO_RCVBUF, _SO_RCVBUFFORCE):  # the latter beyond net.core.rmem_max, for root
            with contextlib.suppress(PermissionError):
                self._socket.setsockopt(socket.SOL_SOCKET, option, _RECEIVE_BUFFER)

    def send(self, packed: bytes) -> int:
        self._socket.send(packed)
        return 0

    def receive(self) -> list[tuple[int, bytes]]:
        frames: list[tuple[int, bytes]] = []
        while len(frames) < _DRAIN_LIMIT:
            try:
                packed, ancillary, _, _ = self._socket.recvmsg(_CAN_FRAME.size, _CONTROL)
                seconds, nanoseconds = _TIMESPEC.unpack(ancillary[0][2]) if ancillary else (0, time.time_ns())
                frames.append((seconds * 1_000_000_000 + nanoseconds, packed))
            except BlockingIOError:
                break
            except OSError as error:
                if error.errno != errno.ENETDOWN:  # reported once, before the queued frames; the socket stays usable
                    raise
        return frames

    def wait(self, timeout: float) -> bool:
        return bool(select.select([self._socket], [], [], timeout)[0])

    def list_sockets(self) -> tuple[list[int], list[int]]:
        own = [self._socket.fileno()]
        return own, own

    def note_refusals(self, descriptor: int, refused: int) -> None:
        """Do nothing: no participant is behind a CAN socket (`Port.count_lost`)."""

    def close(self) -> None:
        self._bus.shutdown()


def resolve(name: str) -> str:
    """Return the bus that `auto` means: vcan0 if it is up, else a local bus. Other names are returned unchanged."""
    if name != "auto":
        return name
    return "vcan0" if "vcan0" in _can_interfaces(only_up=True) else AUTO_LOCAL


def open_bus(name: str, only: Sequence[int] | None = None) -> Port:
    """Open a bus by name. Raises InputError if there is no such bus or it is down.

    only: identifiers to receive, None for all. On SocketCAN the kernel filters them, so that other frames wake no process.
    """
    name = resolve(name)
    try:
        if name.startswith("local:"):
            return Port(name, _LocalPort(LocalChannel(name.removeprefix("local:"))))
        if name not in _can_interfaces():
            known = join_names([*_can_interfaces(), "local:NAME", "auto"])
            raise InputError(f"bus {name!r} does not exist; available are {known}")
        if name not in _can_interfaces(only_up=True):
            raise InputError(f"bus {name} is down; bring it up with: ip link set {name} up")
        filters = [{"can_id": i, "can_mask": _FILTER_MASK} for i in only or ()] or None
        return Port(name, _SocketCanPort(can.Bus(interface="socketcan", channel=name, can_filters=filters)))
    except (can.CanError, OSError, ValueError) as error:
        raise InputError(f"bus {name} cannot be opened: {error}") from None


def listen(port: Port, seconds: float) -> list[Frame]:
    """Receive every frame that arrives within `seconds` [s]."""
    frames, end = [], time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0:
        if port.wait(left):
            frames += port.receive()
    return frames


def _can_interfaces(only_up: bool = False) -> list[str]:
    """Return the SocketCAN interfaces of this machine."""
    names = []
    for folder in _INTERFACES.glob("*"):
        try:
            is_can = int((folder / "type").read_text()) == _ARPHRD_CAN
            up = int((folder / "flags").read_text(), 16) & _IFF_UP
        except (OSError, ValueError):
            continue
        if is_can and (up or not only_up):
            names.append(folder.name)
    return sorted(names)
