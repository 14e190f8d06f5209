"""Exchange: receives and sends the frames of a port in preallocated memory, by system calls from compiled code.

Method          one ppoll(2) waits for all sockets of the bus; recvmmsg(2) receives into `inbox`, send(2) sends from a batch.
                There is no object per frame, no allocation and no interpreter lock
Assumptions     Linux on a machine of 64 bits, whose layouts of pollfd, iovec, mmsghdr and cmsghdr these are
Behaviour       that of `protocols.buses.bus.Port`: frames received and refused, order of frames, time stamps, counters
"""

import errno
import os
import time
from contextlib import suppress
from typing import Any

import numpy as np
from numba import njit, types

from protocols.buses.bus import Port
from protocols.can.frame_batch import make_batch
from protocols.errors import InputError

CAPACITY = 4096  # frames between two cycles; further ones wait in the sockets
_FRAMES_A_CALL = 32  # frames that one system call receives
_MOST_UPDATES = 8  # participant updates per call: joining and leaving must not block the loop
_MOST_SOCKETS = 256  # participants of a local bus
_CONTROL_BYTES = 32  # of a cmsghdr with a struct timespec
_CLASSIC, _STAMPED = 16, 24  # bytes of struct can_frame, and with its stamp, as a local bus carries it
_FLAGS, _STANDARD_ID, _DATA = 0xE0000000, 0x7FF, 8  # extended, remote, error: no frame of this bench has one
_DONTWAIT, _NOSIGNAL, _TRUNC = 0x40, 0x4000, 0x20  # MSG_... of linux/socket.h
_POLLIN = 1  # asm-generic/poll.h
_EAGAIN, _ENOMEM, _ENOBUFS = errno.EAGAIN, errno.ENOMEM, errno.ENOBUFS  # a queue is full
CLOCK_REALTIME, CLOCK_MONOTONIC = 0, 1  # linux/time.h
_SECOND = 1_000_000_000  # ns

_MMSGHDR = np.dtype(
    [("name", "i8"), ("name_length", "i8"), ("iov", "i8"), ("iov_length", "i8"), ("control", "i8"), ("control_length", "i8"),
     ("flags", "i4"), ("_", "i4"), ("length", "u4"), ("__", "u4")]
)  # fmt: skip
_IOVEC = np.dtype([("base", "i8"), ("length", "i8")])
_CONTROL = np.dtype([("length", "i8"), ("level", "i4"), ("type", "i4"), ("seconds", "i8"), ("nanoseconds", "i8")])
_POLLFD = np.dtype([("fd", "i4"), ("events", "i2"), ("revents", "i2")])
# State that compiled functions share: one record, as each array argument costs a tenth of a microsecond
_LINE = np.dtype(
    [("local", "?"), ("mark", "i8"), ("heard", "i8"), ("polls", _POLLFD, (_MOST_SOCKETS + 1,)), ("reached", "i8"),
     ("targets", "i4", (_MOST_SOCKETS,)), ("incoming", _MMSGHDR, (_FRAMES_A_CALL,)), ("in_parts", _IOVEC, (_FRAMES_A_CALL,)),
     ("controls", _CONTROL, (_FRAMES_A_CALL,)), ("length", "i8"), ("time", "i8", (2,)),
     ("marks", "i8"), ("marked_ns", "i8"), ("changed", "?"), ("signalled", "?"), ("error", "i8"), ("taken", "i8"),
     ("given", "i8"), ("refused", "i8", (_MOST_SOCKETS,)), ("unsent", "i8"), ("ignored", "i8")],
    align=True,
)  # fmt: skip


def load_system_function(name: str, result: Any, *arguments: Any) -> Any:
    """Return a function of the C library that compiled code can call."""
    return types.ExternalFunction(name, result(*arguments))


_INT, _LONG = types.int32, types.int64  # addresses and sizes are _LONG
_ppoll = load_system_function("ppoll", _INT, _LONG, _LONG, _LONG, _LONG)
_recvmmsg = load_system_function("recvmmsg", _INT, _INT, _LONG, _INT, _INT, _LONG)
_send = load_system_function("send", _LONG, _INT, _LONG, _LONG, _INT)
_clock_gettime = load_system_function("clock_gettime", _INT, _INT, _LONG)
_errno_location = load_system_function("__errno_location", types.CPointer(_INT))


class Exchange:
    """Receives frames of `port` into `inbox`, shape (CAPACITY,) of frame_batch.FRAME, of which the first `count` are used.

    mark: identifier whose frames are counted. wakes: descriptor that signals a stop request (`stopping.py`), -1 for none.
    Raises InputError if more than 256 participants are on a local bus.
    """

    def __init__(self, port: Port, mark: int, wakes: int = -1) -> None:
        self.port, self._wakes = port, wakes
        self.inbox = make_batch(CAPACITY + 1)  # the last place serves to move frames
        self.count = 0
        self.lines = np.zeros(1, _LINE)
        self._view = line = self.lines[0]
        # read in every cycle: a field of a record costs a microsecond, an element of a memory view a tenth
        names = ("marks", "marked_ns", "changed", "signalled", "unsent", "ignored")
        self._marks, self._marked_ns, self._changed, self._signalled, self._unsent, self._ignored = (
            self.lines[name].data for name in names
        )
        line["mark"], line["local"] = mark, port.raw.listener is not None
        line["polls"]["events"] = _POLLIN
        line["length"] = line["in_parts"]["length"] = _STAMPED if line["local"] else _CLASSIC
        line["incoming"]["iov"], line["incoming"]["iov_length"] = read_addresses(line["in_parts"]), 1
        if not line["local"]:
            line["incoming"]["control"] = read_addresses(line["controls"])
        self._update_participants()
        # compiles now, not in the loop; receives no frame
        gather(make_empty_lines(), 0, self.inbox, 0, 0)
        send_to_all(make_empty_lines(), 0, make_batch(1), 0)

    @property
    def marks(self) -> int:
        """Number of frames received with the identifier `mark`."""
        return self._marks[0]

    @property
    def marked_ns(self) -> int:
        """Time stamp of the last frame with the identifier `mark` [ns of CLOCK_REALTIME]."""
        return self._marked_ns[0]

    def clear(self) -> None:
        """Empty the inbox."""
        self.count = 0

    def receive(self, timeout: float = 0.0) -> bool:
        """Receive the waiting frames into `inbox`, or wait up to `timeout` [s] for a frame; return whether any came."""
        left = round(timeout * 1e9)
        end = time.monotonic_ns() + left
        first = self.count
        self.refresh()
        while True:
            self.accept(gather(self.lines, left, self.inbox, first, self.count), first)
            if left <= 0 or self.count > first:
                return self.count > first
            left = max(end - time.monotonic_ns(), 0)

    def send(self, frames: np.ndarray, count: int) -> None:
        """Send the first `count` frames of a batch without waiting.

        Frames that the bus cannot take are counted, not repeated.
        """
        self.refresh()
        self.finish_send(frames, count, send_to_all(self.lines, 0, frames, count))

    def refresh(self) -> None:
        """Update the participants if the port was used otherwise in between; call it before a compiled function."""
        if self._signalled[0]:
            with suppress(BlockingIOError):
                os.read(self._wakes, _FRAMES_A_CALL)
            self._signalled[0] = False
            self._update_participants()
        if self._changes != self.port.raw.changes:
            self._update_participants()

    def accept(self, count: int, first: int) -> None:
        """Count the frames that compiled code has received into `inbox`, from `first` to `count`.

        Then admit newcomers and receive their frames.
        """
        self.port.received += count - self.count
        for _ in range(_MOST_UPDATES):
            if not self._changed[0]:
                break
            self._update_participants()  # a newcomer may have sent already
            more = gather(self.lines, 0, self.inbox, first, count)
            self.port.received += more - count
            count = more
        self.count = count

    def count_settled(self) -> None:
        """Count the frames of cycles that are complete (`is_settled`), and empty the inbox."""
        line = self._view
        self.port.received += int(line["taken"])
        self.port.sent += int(line["given"])
        line["taken"] = line["given"] = 0
        self._count_unsent()
        self.clear()

    def discard_used(self, count: int) -> None:
        """Count and discard frames that compiled code has received up to `count` and used; then admit newcomers.

        Call it after `finish_send`, whose position refers to the participants before.
        """
        self.port.received += count - self.count
        self.clear()
        self.accept(0, 0)

    def finish_send(self, frames: np.ndarray, count: int, position: int) -> None:
        """Finish sending the first `count` frames of a batch, where `send_to_all` has stopped at `position`."""
        while position != count * _MOST_SOCKETS:
            if position < 0:  # newcomers get them as well
                self._update_participants()
                position = 0
            elif self.port.count_lost(
                int(self._view["targets"][position % _MOST_SOCKETS]), int(self._view["error"]), 1
            ):
                self._update_participants()  # the next target takes the place of the one that has left
            else:
                position += 1
            position = send_to_all(self.lines, position, frames, count)
        self.port.sent += count
        self._count_unsent()

    def _count_unsent(self) -> None:
        """Count frames refused because a participant's queue was full (a slow reader delays no cycle), and ignored frames."""
        if self._ignored[0]:
            self.port.ignored += int(self._ignored[0])
            self._ignored[0] = 0
        if self._unsent[0]:
            line = self._view
            for place in np.flatnonzero(line["refused"]):
                self.port.count_lost(int(line["targets"][place]), _EAGAIN, int(line["refused"][place]))
            line["refused"] = line["unsent"] = 0

    def _update_participants(self) -> None:
        """Admit newcomers, remove participants that have left, and note the sockets of all."""
        self._count_unsent()  # before participants change their places
        heard, reached = self.port.raw.list_sockets()
        if len(heard) > _MOST_SOCKETS:
            raise InputError(f"{len(heard)} participants are on {self.port.name}; allowed are {_MOST_SOCKETS}")
        line = self._view
        line["heard"], line["reached"] = len(heard), len(reached)
        line["polls"]["fd"][: len(heard) + 1] = [*heard, self._wakes]
        line["targets"][: len(reached)] = reached
        self._changes = self.port.raw.changes


def make_empty_lines() -> np.ndarray:
    """Return `lines` (1,) of an Exchange on an empty bus, to compile functions with."""
    lines = np.zeros(1, _LINE)
    lines["polls"]["fd"] = -1
    return lines


def read_addresses(rows: np.ndarray) -> np.ndarray:
    return rows.ctypes.data + rows.itemsize * np.arange(len(rows))


@njit(cache=True, nogil=True)
def gather(lines, timeout_ns, inbox, first, count):
    """Receive waiting frames, or the first within `timeout_ns`, into `inbox` from `count` on; return the new count.

    Frames from index `first` on are sorted by time stamp.
    """
    line = lines[0]
    polls, messages = line.polls, line.incoming
    line.changed = False
    line.time[0], line.time[1] = timeout_ns // _SECOND, timeout_ns % _SECOND
    if _ppoll(polls.ctypes.data, line.heard + 1, line.time.ctypes.data, 0) <= 0:
        return count
    if polls[line.heard].revents:
        line.signalled, polls[line.heard].fd = True, -1  # noted once; the wait for frames continues
    end = count
    for place in range(line.heard):
        events = polls[place].revents
        if line.local and place == 0 and events:  # the listener: a newcomer waits
            line.changed = True
            continue
        begin = end
        more = events != 0  # an error is reported once, by reading
        while more and end + _FRAMES_A_CALL <= CAPACITY:
            for index in range(_FRAMES_A_CALL):
                line.in_parts[index].base = inbox.ctypes.data + (end + index) * inbox.itemsize
                messages[index].control_length = 0 if line.local else _CONTROL_BYTES
            got = _recvmmsg(polls[place].fd, messages.ctypes.data, _FRAMES_A_CALL, _DONTWAIT, 0)
            if got < 0 and _errno_location()[0] != _EAGAIN:
                line.changed = True
            more = got == _FRAMES_A_CALL
            kept = end
            for index in range(got):
                if messages[index].length == 0:
                    line.changed, more = True, False  # the sender has left
                    continue
                frame = inbox[end + index]
                if (
                    messages[index].length != line.in_parts[index].length
                    or messages[index].flags & _TRUNC
                    or np.int64(frame.can_id) & _FLAGS
                    or frame.length > _DATA
                ):
                    line.ignored += 1  # CAN FD, or another frame that this bench does not use
                    continue
                if not line.local:
                    frame.stamp = _stamp(line.controls[index], messages[index].control_length, line.time)
                if kept < end + index:
                    inbox[kept] = inbox[end + index]
                _clean_frame(inbox[kept], line)
                kept += 1
            end = kept
        if events & ~_POLLIN:
            line.changed = True
        _merge(inbox, first, begin, end)
    return end


@njit(cache=True, nogil=True)
def gather_marked(lines, timeout_ns, inbox, first, count):
    """Receive like `gather`, but wait until a marked frame has come: other frames do not end the wait."""
    line = lines[0]
    marks, end, left = line.marks, read_clock(CLOCK_MONOTONIC, line.time) + timeout_ns, timeout_ns
    while True:
        count = gather(lines, left, inbox, first, count)
        if line.marks > marks or line.changed or count + _FRAMES_A_CALL > CAPACITY:
            return count
        left = end - read_clock(CLOCK_MONOTONIC, line.time)
        if left <= 0:
            return count


@njit
def read_clock(clock, times):
    """Return the time of a kernel clock [ns]; `times` (2,) is overwritten."""
    _clock_gettime(clock, times.ctypes.data)
    return times[0] * _SECOND + times[1]


@njit
def _clean_frame(frame, line):
    """Clear the flags of a frame and the bytes beyond its data, and count it if it is marked."""
    frame.can_id = np.int64(frame.can_id) & _STANDARD_ID
    for byte in range(np.int64(frame.length), _DATA):
        frame.data[byte] = 0
    if frame.can_id == line.mark:
        line.marks += 1
        line.marked_ns = frame.stamp


@njit
def _stamp(control, length, times):
    """Return the kernel's time stamp, or the present time if there is none [ns of CLOCK_REALTIME]."""
    if length == _CONTROL_BYTES:
        return control.seconds * _SECOND + control.nanoseconds
    return read_clock(CLOCK_REALTIME, times)


@njit
def _merge(inbox, first, begin, end):
    """Merge frames of one sender, `begin` to `end`, by time stamp into those from `first` on; keep the sender's order."""
    at = first
    for index in range(begin, end):
        while at < index and inbox[at].stamp <= inbox[index].stamp:
            at += 1
        if at < index:
            inbox[CAPACITY] = inbox[index]
            for back in range(index, at, -1):
                inbox[back] = inbox[back - 1]
            inbox[at] = inbox[CAPACITY]
        at += 1


@njit
def is_settled(line, first, count, sent, position):
    """Return whether a cycle is complete: it was not refused, all its frames are sent, and no participant has changed.

    The cycle received frames `first` to `count` and sent `sent` frames (negative: refused), up to `position` of `send_to_all`.
    A complete cycle's frames are noted for `Exchange.count_settled`.
    """
    if sent < 0 or position != sent * _MOST_SOCKETS or line.changed:
        return False
    line.taken += count - first
    line.given += sent
    return True


@njit(cache=True, nogil=True)
def send_to_all(lines, position, frames, count):
    """Send `count` frames from `position` on, frame by frame to every target; return the position where it ended.

    A position is the number of a frame times _MOST_SOCKETS plus the number of a target. At the end it is that of frame `count`;
    it is -1 if a newcomer must be admitted first. Each frame is stamped when it is sent: its receiver may run at once.
    """
    line = lines[0]
    times = line.time
    if line.local and position == 0:
        times[0] = times[1] = 0
        if _ppoll(line.polls.ctypes.data, 1, times.ctypes.data, 0) > 0:
            return -1
    first = position % _MOST_SOCKETS
    for index in range(position // _MOST_SOCKETS, count):
        if line.local and first == 0:
            frames[index].stamp = read_clock(CLOCK_REALTIME, times)
        frame = frames.ctypes.data + index * frames.itemsize
        for place in range(first, line.reached):
            if _send(line.targets[place], frame, line.length, _DONTWAIT | _NOSIGNAL) < 0:
                error = _errno_location()[0]
                if error != _EAGAIN and error != _ENOBUFS and error != _ENOMEM:
                    line.error = error
                    return index * _MOST_SOCKETS + place
                line.refused[place] += 1
                line.unsent += 1
        first = 0
    return count * _MOST_SOCKETS
