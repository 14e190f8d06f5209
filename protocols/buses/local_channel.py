"""`local:NAME`: a CAN bus between the processes of one machine without a CAN kernel.

There is no hub. Every participant listens on an AF_UNIX SEQPACKET socket `PID-k` in the folder of the bus. A newcomer
connects to every participant it finds, and each pair shares that one connection. The folder NAME lies in
`$CLUTCH_HIL_BUS_DIR`, else `$XDG_RUNTIME_DIR/clutch-hil`, else `/tmp/clutch-hil-UID`. All participants need the same one.

As on vcan: every other participant gets a frame, the sender only on request; the frames of one sender arrive in order,
exactly once; a frame sent after a participant finished opening reaches it, whoever sends; a sender may close at once
without losing what it sent; a sender never waits; time stamps are CLOCK_REALTIME.

Unlike vcan:
- Senders share no single order. Frames waiting together are merged by time stamp; two readers can still see the frames
  of two senders in a different order. There is no arbitration and no wire time.
- Each pair of participants has its own queue, of 2731 frames where the kernel permits 1 MiB buffers (otherwise less).
  A full one refuses the newest frame, and the sender counts that in `refused`; the other participants get the frame.
- A participant that never reads lets its queues fill, and the others count refusals for it.
- Kernel filters do not exist; python-can's filters act when frames are taken from the queue (`local_bus`).
"""

import errno
import heapq
import itertools
import os
import re
import select
import socket
import struct
import threading
import time
import weakref
from collections.abc import Callable
from operator import itemgetter
from pathlib import Path

import can

from protocols.buses.local_folder import hold_lock, make_bus_folder

StampedFrame = tuple[int, bytes]  # send time in ns since 1970, struct can_frame or struct canfd_frame

CLASSIC = struct.Struct("=IB3x8s")  # struct can_frame: identifier and flags, length, data
FD = struct.Struct("=IBB2x64s")  # struct canfd_frame: the same with FD flags
_STAMPED_CLASSIC = struct.Struct("=16sQ")  # transmitted unit: a frame and its send time in ns
_STAMPED_FD = struct.Struct("=72sQ")
_STAMP = struct.Struct("=Q")
_DATA_BYTES = {CLASSIC.size: 8, FD.size: 64}

_PATH_BYTES = 107  # sun_path holds 108, including the terminating zero
_SEND_BUFFER = 1 << 20  # bytes; the kernel doubles it and charges 768 for a small frame: 2731 frames
_SO_SNDBUFFORCE = 32  # exceeds net.core.wmem_max, for root; not defined in Python
_BACKLOG = 4096  # newcomers that may wait for a participant that does not admit them
_FRAMES_A_CALL = 4096  # most frames per call of `receive`, so that a flood cannot block the caller
# departed participants with unread frames; a participant that never reads must not run out of descriptors
_DEPARTED_KEPT = 64
_NEWCOMER = re.compile(rb"\0(\d+-\d+) [0-9a-f]{16}")  # address of a connecting participant, see `_connect_to_all`
_SELECTABLE = 1024  # select() takes descriptors below this
_FULL = {errno.EAGAIN, errno.ENOBUFS, errno.ENOMEM}

_participant_number = itertools.count()
_open_channels: "weakref.WeakSet[LocalChannel]" = weakref.WeakSet()


class FrameLengthError(ValueError):
    """A raw frame is neither a struct can_frame nor a struct canfd_frame."""


class OwnFrame(bytes):
    """A sent frame, returned to its sender."""


class LocalChannel:
    """A participant of bus NAME for raw frames. One thread may send while another one receives.

    Raises can.CanInitializationError when the name or the folder is unusable. After a fork the child's copy is closed.
    `refused` counts, by participant, the frames that found its queue full; a full echo counts under the own name.
    """

    def __init__(self, name: str, receive_own: bool = False) -> None:
        folder = make_bus_folder(name)
        self.name = name
        self.participant = ""
        self.refused: dict[str, int] = {}
        self.changes = 0  # how often participants have joined or left
        self._connections: dict[int, tuple[str, socket.socket]] = {}  # by file descriptor, until read to the end
        # Replaced, never changed: send() goes through it while another thread may let a newcomer in.
        self._targets: tuple[tuple[str, Callable[[bytes, int], int], int], ...] = ()
        self._membership = threading.Lock()
        self._listener = _open_socket()
        self._ready = select.epoll()  # everything to receive, and newcomers
        self._newcomers = select.epoll()  # newcomers only
        self._echo = _open_echo_pair() if receive_own else None
        self._echo_descriptor = self._echo[1].fileno() if self._echo else -1
        self._path: Path | None = None
        self._closed = False
        try:
            with hold_lock(folder):
                self._bind(folder)
                self._connect_to_all(folder)
                self._listener.listen(_BACKLOG)
            for epoll in (self._ready, self._newcomers):
                epoll.register(self._listener, select.EPOLLIN)
            if self._echo:
                self._ready.register(self._echo[1], select.EPOLLIN)
        except OSError as error:
            self.close()
            raise can.CanInitializationError(f"bus local:{name} cannot be opened in {folder}: {error}") from error
        except can.CanInitializationError:
            self.close()
            raise
        _open_channels.add(self)

    def send(self, frame: bytes) -> int:
        """Send 16 or 72 bytes to every other participant, never waiting; return how many refused (queue full).

        Raises FrameLengthError for another size or a length byte above 8 or 64.
        """
        if len(frame) not in _DATA_BYTES or frame[4] > _DATA_BYTES[len(frame)]:
            raise FrameLengthError(
                f"frame of {len(frame)} bytes with length byte {frame[4] if len(frame) > 4 else '-'}; allowed are "
                "16 bytes (can_frame) with up to 8 and 72 bytes (canfd_frame) with up to 64"
            )
        if self._newcomers.poll(0, 1):
            self._admit()
        packet = frame + _STAMP.pack(time.time_ns())
        refusals = 0
        for name, transmit, descriptor in self._targets:
            try:
                transmit(packet, socket.MSG_NOSIGNAL)
            except OSError as error:
                if error.errno in _FULL:
                    refusals += 1
                    self.refused[name] = self.refused.get(name, 0) + 1
                else:
                    self._depart(descriptor)
        if self._echo:
            try:
                self._echo[0].send(packet)
            except BlockingIOError:
                self.refused[self.participant] = self.refused.get(self.participant, 0) + 1
        return refusals

    def receive(self) -> list[StampedFrame]:
        """Return all waiting frames as (send time ns, 16 or 72 bytes), merged by time stamp, without waiting.

        The order of one sender is kept even if the clock was set back. Takes at most 4096 frames, plus one per sender.
        """
        queues: dict[int, list[StampedFrame]] = {}
        taken = 0
        while taken < _FRAMES_A_CALL:
            # One frame a connection and round: asking epoll again is cheaper than an exception from an empty queue.
            ready = self._ready.poll(0, 64)
            if not ready:
                break
            for descriptor, _ in ready:
                if descriptor == self._listener.fileno():
                    self._admit()
                    continue
                try:
                    packet = os.read(descriptor, _STAMPED_FD.size)
                except OSError:
                    continue  # ECONNRESET is reported once, before the frames queued behind it
                if len(packet) == _STAMPED_CLASSIC.size:
                    frame, stamp = _STAMPED_CLASSIC.unpack(packet)
                elif len(packet) == _STAMPED_FD.size:
                    frame, stamp = _STAMPED_FD.unpack(packet)
                else:
                    self._depart(descriptor)
                    continue
                if descriptor == self._echo_descriptor:
                    frame = OwnFrame(frame)
                taken += 1
                if descriptor in queues:
                    queues[descriptor].append((stamp, frame))
                else:
                    queues[descriptor] = [(stamp, frame)]
        if len(queues) > 1:
            return list(heapq.merge(*queues.values(), key=itemgetter(0)))
        return queues.popitem()[1] if queues else []

    def wait(self, timeout_s: float | None) -> bool:
        """Wait up to `timeout_s` seconds (None: for ever) for a frame; participants that join or leave do not count."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            events = self._ready.poll(0, 64)
            for descriptor, event in events:
                if descriptor == self._listener.fileno():
                    self._admit()
                elif event == select.EPOLLIN or self._depart(descriptor):
                    return True
            if events:
                continue  # a newcomer may have sent already
            left = None if deadline is None else deadline - time.monotonic()
            if left is not None and left <= 0.0:
                return False
            if self._ready.fileno() < _SELECTABLE:
                select.select([self._ready], [], [], left)  # epoll itself would round up to whole milliseconds
            else:
                self._ready.poll(left)

    def fileno(self) -> int:
        """Return a descriptor that is readable when receive() or wait() has work: a frame, a newcomer, a departure."""
        return self._ready.fileno()

    @property
    def listener(self) -> int:
        """Descriptor that is readable when a newcomer waits to be admitted by `list_sockets`."""
        return self._listener.fileno()

    def list_sockets(self) -> tuple[list[int], list[int]]:
        """Return the descriptors to receive from (listener first) and to send to, for a caller that uses them directly.

        Newcomers are admitted. Participants that have left are removed once their frames are read.
        """
        for descriptor, event in self._ready.poll(0, 64):
            if descriptor == self._listener.fileno():
                self._admit()
            elif event != select.EPOLLIN:
                self._depart(descriptor)
        return [self._listener.fileno(), *self._connections], [target[2] for target in self._targets]

    def note_refusals(self, descriptor: int, refused: int) -> None:
        """Count `refused` frames that the caller sent to a descriptor itself; 0: the participant behind it has left."""
        if not refused:
            self._depart(descriptor)
        elif descriptor in self._connections:
            name = self._connections[descriptor][0]
            self.refused[name] = self.refused.get(name, 0) + refused

    @property
    def participants(self) -> list[str]:
        """Names `PID-k` of the other participants."""
        self.wait(0.0)
        return [name for name, _, _ in self._targets]

    def close(self) -> None:
        """Leave the bus. Frames already sent stay receivable by the others."""
        if self._closed:
            return
        if self._path:
            self._path.unlink(missing_ok=True)  # before the listener closes: later the name may be another's
        self._close_descriptors()

    def __enter__(self) -> "LocalChannel":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _bind(self, folder: Path) -> None:
        """Take the first free name `PID-k`; another container sharing the folder may have used it."""
        while self._path is None:
            self.participant = f"{os.getpid()}-{next(_participant_number)}"
            path = folder / self.participant
            if len(os.fsencode(path)) > _PATH_BYTES:
                raise can.CanInitializationError(
                    f"socket path {path} has {len(os.fsencode(path))} bytes; allowed are {_PATH_BYTES}: "
                    "set CLUTCH_HIL_BUS_DIR to a shorter folder"
                )
            try:
                self._listener.bind(os.fspath(path))
                self._path = path
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise

    def _connect_to_all(self, folder: Path) -> None:
        for path in sorted(folder.glob("[0-9]*-[0-9]*")):
            if path == self._path:
                continue
            connection = _open_socket()
            # The abstract address carries our name with the connection, so the other side need not read anything.
            connection.bind(f"\0{self.participant} {os.urandom(8).hex()}")
            try:
                connection.connect(os.fspath(path))
            except (ConnectionRefusedError, FileNotFoundError):  # killed, or just closing
                connection.close()
                path.unlink(missing_ok=True)
            except BlockingIOError as error:
                connection.close()
                raise can.CanInitializationError(
                    f"participant {path.name} of local:{self.name} does not respond: {_BACKLOG} new participants wait for it"
                ) from error
            else:
                self._join(path.name, connection)

    def _admit(self) -> None:
        """Admit all newcomers that have connected."""
        with self._membership:
            while True:
                try:
                    connection, address = self._listener.accept()
                except BlockingIOError:
                    return
                if not (match := _NEWCOMER.fullmatch(address if isinstance(address, bytes) else b"")):
                    connection.close()  # not a participant: a program that probes sockets
                    continue
                connection.setblocking(False)
                self._join(match[1].decode(), connection)

    def _join(self, name: str, connection: socket.socket) -> None:
        _enlarge_send_buffer(connection)
        self._connections[connection.fileno()] = (name, connection)
        self._ready.register(connection, select.EPOLLIN)
        self._targets = (*self._targets, (name, connection.send, connection.fileno()))
        self.changes += 1

    def _depart(self, descriptor: int) -> bool:
        """Stop sending to a participant that left; close the connection unless it holds unread frames (then True)."""
        with self._membership:
            if descriptor not in self._connections:
                return False
            self._targets = tuple(target for target in self._targets if target[2] != descriptor)
            self.changes += 1
            unread = _has_unread(self._connections[descriptor][1])
            if not unread:
                self._disconnect(descriptor)
            elif len(self._connections) - len(self._targets) > _DEPARTED_KEPT:
                sending = {target[2] for target in self._targets}
                self._disconnect(next(old for old in self._connections if old not in sending))
            return unread

    def _disconnect(self, descriptor: int) -> None:
        _, connection = self._connections.pop(descriptor)
        self.changes += 1
        self._ready.unregister(descriptor)
        connection.close()

    def _close_descriptors(self) -> None:
        """Close all descriptors but keep the socket file: a forked child must not unlink its parent's."""
        self._closed = True
        connections = [connection for _, connection in self._connections.values()]
        for resource in (self._listener, self._ready, self._newcomers, *(self._echo or ()), *connections):
            resource.close()
        self._targets = ()


def _open_socket() -> socket.socket:
    new = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    new.setblocking(False)
    return new


def _open_echo_pair() -> tuple[socket.socket, socket.socket]:
    sender, receiver = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    sender.setblocking(False)
    _enlarge_send_buffer(sender)
    return sender, receiver


def _enlarge_send_buffer(connection: socket.socket) -> None:
    try:
        connection.setsockopt(socket.SOL_SOCKET, _SO_SNDBUFFORCE, _SEND_BUFFER)
    except PermissionError:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)


def _has_unread(connection: socket.socket) -> bool:
    for _ in range(2):  # ECONNRESET is reported once, before the frames queued behind it
        try:
            return bool(connection.recv(1, socket.MSG_PEEK))
        except ConnectionResetError:
            continue
        except OSError:
            break
    return False


def _close_copies_after_fork() -> None:
    """Close the copies in a forked child; otherwise a killed parent would seem alive while its child lives."""
    for channel in list(_open_channels):
        channel._close_descriptors()
    _open_channels.clear()


os.register_at_fork(after_in_child=_close_copies_after_fork)
