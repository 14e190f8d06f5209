"""Exchange: frames of a port in and out of memory that is there from the start, by system calls from compiled code.

Method          one ppoll(2) waits for all sockets of the bus; recvmmsg(2) puts what waits on each into `inbox`, send(2) takes
                what is to be sent from a batch: no object a frame, no allocation, no GIL
Assumptions     Linux on a machine of 64 bits, whose layouts of pollfd, iovec, mmsghdr and cmsghdr these are
Same as         protocols.buses.bus.Port: who is heard, what is refused, order of frames, time stamps, counters
"""

import errno
import os
import time
from contextlib import suppress
from typing import Any

import numpy as np
from numba import njit, types

from protocols.buses.bus import Port
from protocols.can.frame_batch import batch
from protocols.errors import InputError

CAPACITY = 4096  # frames between two looks of the loop; what comes beyond waits in the sockets
_A_CALL = 32  # frames that one system call takes
_LOOKS = 8  # at who is there, in one call: those who come and go for ever must not hold the loop
_SOCKETS = 256  # participants of a local bus
_CONTROL_BYTES = 32  # of a cmsghdr with a struct timespec
_CLASSIC, _STAMPED = 16, 24  # bytes of struct can_frame, and with its stamp, as a local bus carries it
_FLAGS, _STANDARD_ID, _DATA = 0xE0000000, 0x7FF, 8  # extended, remote, error: never frames of this bench
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
# What kernels work on: one record, as each array that is handed over costs a tenth of a microsecond
_LINE = np.dtype(
    [("local", "?"), ("mark", "i8"), ("heard", "i8"), ("polls", _POLLFD, (_SOCKETS + 1,)), ("reached", "i8"),
     ("targets", "i4", (_SOCKETS,)), ("incoming", _MMSGHDR, (_A_CALL,)), ("in_parts", _IOVEC, (_A_CALL,)),
     ("controls", _CONTROL, (_A_CALL,)), ("length", "i8"), ("time", "i8", (2,)),
     ("marks", "i8"), ("marked_ns", "i8"), ("changed", "?"), ("signalled", "?"), ("error", "i8"), ("taken", "i8"),
     ("given", "i8"), ("refused", "i8", (_SOCKETS,)), ("unsent", "i8")],
    align=True,
)  # fmt: skip


def system(name: str, result: Any, *arguments: Any) -> Any:
    """A function of the C library, called from compiled code."""
    return types.ExternalFunction(name, result(*arguments))


_INT, _LONG = types.int32, types.int64  # addresses and sizes are _LONG
_ppoll = system("ppoll", _INT, _LONG, _LONG, _LONG, _LONG)
_recvmmsg = system("recvmmsg", _INT, _INT, _LONG, _INT, _INT, _LONG)
_send = system("send", _LONG, _INT, _LONG, _LONG, _INT)
_clock_gettime = system("clock_gettime", _INT, _INT, _LONG)
_errno_location = system("__errno_location", types.CPointer(_INT))


class Exchange:
    """What comes on `port` goes to `inbox`, shape (CAPACITY,) of batch.FRAME, the first `count` of it.

    Compiled code sees a signal by the descriptor `wakes` (`stopping.py`), -1 for none: in a sleep or out of it.
    Raises InputError where more than 256 participants are on a local bus.
    """

    def __init__(self, port: Port, mark: int, wakes: int = -1) -> None:
        self.port, self._wakes = port, wakes
        self.inbox = batch(CAPACITY + 1)  # one to move frames by
        self.count = 0
        self.lines = np.zeros(1, _LINE)
        self._view = line = self.lines[0]
        # what is looked at in every cycle: a field of a record costs a microsecond, an element of a memory view a tenth
        seen = (self.lines[name].data for name in ("marks", "marked_ns", "changed", "signalled", "unsent"))
        self._marks, self._marked_ns, self._changed, self._signalled, self._unsent = seen
        line["mark"], line["local"] = mark, port.raw.listener is not None
        line["polls"]["events"] = _POLLIN
        line["length"] = line["in_parts"]["length"] = _STAMPED if line["local"] else _CLASSIC
        line["incoming"]["iov"], line["incoming"]["iov_length"] = _addresses(line["in_parts"]), 1
        if not line["local"]:
            line["incoming"]["control"] = _addresses(line["controls"])
        self._look()
        # compiled now, not in the loop; no frame is taken that a service waits for by the port
        gather(silence(), 0, self.inbox, 0, 0)
        spread(silence(), 0, batch(1), 0)

    @property
    def marks(self) -> int:
        """Frames with the identifier `mark` that have come."""
        return self._marks[0]

    @property
    def marked_ns(self) -> int:
        """Stamp of the last one [ns of CLOCK_REALTIME]."""
        return self._marked_ns[0]

    def clear(self) -> None:
        """The frames in `inbox` have been used."""
        self.count = 0

    def receive(self, timeout: float = 0.0) -> bool:
        """Add to `inbox` the frames that wait, or that come within `timeout` [s] until one has; whether any came."""
        left = round(timeout * 1e9)
        end = time.monotonic_ns() + left
        first = self.count
        self.ready()
        while True:
            self.took(gather(self.lines, left, self.inbox, first, self.count), first)
            if left <= 0 or self.count > first:
                return self.count > first
            left = max(end - time.monotonic_ns(), 0)

    def send(self, frames: np.ndarray, count: int) -> None:
        """Send the first `count` frames of a batch, never waiting; what the bus cannot take is counted, not repeated."""
        self.ready()
        self.sent(frames, count, spread(self.lines, 0, frames, count))

    def ready(self) -> None:
        """See who is there, if others have read the bus through the port, or written to it: before a kernel."""
        if self._signalled[0]:
            with suppress(BlockingIOError):
                os.read(self._wakes, _A_CALL)
            self._signalled[0] = False
            self._look()
        if self._changes != self.port.raw.changes:
            self._look()

    def took(self, count: int, first: int) -> None:
        """A kernel has filled `inbox` up to `count`, since `first` of them were there; let those in whom it found."""
        self.port.received += count - self.count
        for _ in range(_LOOKS):
            if not self._changed[0]:
                break
            self._look()  # who came in may have sent already
            more = gather(self.lines, 0, self.inbox, first, count)
            self.port.received += more - count
            count = more
        self.count = count

    def passed(self) -> None:
        """Turns have passed of which nothing is left to do (`settled`): their frames are counted, and gone."""
        line = self._view
        self.port.received += int(line["taken"])
        self.port.sent += int(line["given"])
        line["taken"] = line["given"] = 0
        self._count_unsent()
        self.clear()

    def used(self, count: int) -> None:
        """A kernel has filled `inbox` up to `count` and has used it: what comes of those it found is kept for the next.

        After `sent`, whose position is a place among those who were there for the kernel: here they come and go.
        """
        self.port.received += count - self.count
        self.clear()
        self.took(0, 0)

    def sent(self, frames: np.ndarray, count: int, position: int) -> None:
        """`spread` has come to `position` with the first `count` frames of a batch: finish what it could not."""
        while position != count * _SOCKETS:
            if position < 0:  # newcomers are to get them, too
                self._look()
                position = 0
            elif self.port.lost(int(self._view["targets"][position % _SOCKETS]), int(self._view["error"]), 1):
                self._look()  # the next one is in the place of who has left, whose descriptor may soon be somebody else's
            else:
                position += 1
            position = spread(self.lines, position, frames, count)
        self.port.sent += count
        self._count_unsent()

    def _count_unsent(self) -> None:
        """Frames for which queues had no room are theirs who have not read: who is slow costs no cycle."""
        if self._unsent[0]:
            line = self._view
            for place in np.flatnonzero(line["refused"]):
                self.port.lost(int(line["targets"][place]), _EAGAIN, int(line["refused"][place]))
            line["refused"] = line["unsent"] = 0

    def _look(self) -> None:
        """Let newcomers in, and those go who have left; see who is there."""
        self._count_unsent()  # before anybody is in another's place
        heard, reached = self.port.raw.sockets()
        if len(heard) > _SOCKETS:
            raise InputError(f"{len(heard)} participants are on {self.port.name}; allowed are {_SOCKETS}")
        line = self._view
        line["heard"], line["reached"] = len(heard), len(reached)
        line["polls"]["fd"][: len(heard) + 1] = [*heard, self._wakes]
        line["targets"][: len(reached)] = reached
        self._changes = self.port.raw.changes


def silence() -> np.ndarray:
    """`lines` of an Exchange on a bus with nobody there, to compile kernels with; shape (1,)."""
    lines = np.zeros(1, _LINE)
    lines["polls"]["fd"] = -1
    return lines


def _addresses(rows: np.ndarray) -> np.ndarray:
    return rows.ctypes.data + rows.itemsize * np.arange(len(rows))


@njit(cache=True, nogil=True)
def gather(lines, timeout_ns, inbox, first, count):
    """Take what waits, or comes first within `timeout_ns` [ns], into `inbox` from number `count` on; return how many there are.

    From number `first` on they are in the order of their stamps.
    """
    line = lines[0]
    polls, messages = line.polls, line.incoming
    line.changed = False
    line.time[0], line.time[1] = timeout_ns // _SECOND, timeout_ns % _SECOND
    if _ppoll(polls.ctypes.data, line.heard + 1, line.time.ctypes.data, 0) <= 0:
        return count
    if polls[line.heard].revents:
        line.signalled, polls[line.heard].fd = True, -1  # seen: who waits for frames goes on with that
    end = count
    for place in range(line.heard):
        events = polls[place].revents
        if line.local and place == 0 and events:  # who listens: there is a newcomer
            line.changed = True
            continue
        begin = end
        more = events != 0  # an error is told once, by reading, and is no longer there then
        while more and end + _A_CALL <= CAPACITY:
            for index in range(_A_CALL):
                line.in_parts[index].base = inbox.ctypes.data + (end + index) * inbox.itemsize
                messages[index].control_length = 0 if line.local else _CONTROL_BYTES
            got = _recvmmsg(polls[place].fd, messages.ctypes.data, _A_CALL, _DONTWAIT, 0)
            if got < 0 and _errno_location()[0] != _EAGAIN:
                line.changed = True
            more = got == _A_CALL
            kept = end
            for index in range(got):
                if messages[index].length == 0:
                    line.changed, more = True, False  # who sent has left
                    continue
                frame = inbox[end + index]
                if (
                    messages[index].length != line.in_parts[index].length
                    or messages[index].flags & _TRUNC
                    or np.int64(frame.can_id) & _FLAGS
                    or frame.length > _DATA
                ):
                    continue  # CAN FD, and what else is none of ours
                if not line.local:
                    frame.stamp = _stamp(line.controls[index], messages[index].control_length, line.time)
                if kept < end + index:
                    inbox[kept] = inbox[end + index]
                _tidy(inbox[kept], line)
                kept += 1
            end = kept
        if events & ~_POLLIN:
            line.changed = True
        _merge(inbox, first, begin, end)
    return end


@njit(cache=True, nogil=True)
def gather_marked(lines, timeout_ns, inbox, first, count):
    """The same until a marked frame has come: who waits for it does not wake up for others."""
    line = lines[0]
    marks, end, left = line.marks, now(CLOCK_MONOTONIC, line.time) + timeout_ns, timeout_ns
    while True:
        count = gather(lines, left, inbox, first, count)
        if line.marks > marks or line.changed or count + _A_CALL > CAPACITY:
            return count
        left = end - now(CLOCK_MONOTONIC, line.time)
        if left <= 0:
            return count


@njit
def now(clock, times):
    """Time of a clock of the kernel [ns]; `times` (2,) is overwritten."""
    _clock_gettime(clock, times.ctypes.data)
    return times[0] * _SECOND + times[1]


@njit
def _tidy(frame, line):
    """Without flags, and zero beyond its data; counted if it is one that is marked."""
    frame.can_id = np.int64(frame.can_id) & _STANDARD_ID
    for byte in range(np.int64(frame.length), _DATA):
        frame.data[byte] = 0
    if frame.can_id == line.mark:
        line.marks += 1
        line.marked_ns = frame.stamp


@njit
def _stamp(control, length, times):
    """Time stamp of the kernel, or now where it gave none [ns of CLOCK_REALTIME]."""
    if length == _CONTROL_BYTES:
        return control.seconds * _SECOND + control.nanoseconds
    return now(CLOCK_REALTIME, times)


@njit
def _merge(inbox, first, begin, end):
    """Put the frames from `begin` on, of one sender, in between those from `first` on by their stamps; each order stays."""
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
def settled(line, first, count, sent, position):
    """Whether nothing is left to do of a turn but to forget its frames: from `first` to `count` they came, `sent` have left.

    `sent` is negative where the turn was refused, `position` that of `spread`. Its frames are noted for `Exchange.passed`.
    """
    if sent < 0 or position != sent * _SOCKETS or line.changed:
        return False
    line.taken += count - first
    line.given += sent
    return True


@njit(cache=True, nogil=True)
def spread(lines, position, frames, count):
    """Send `count` frames from `position` on, frame by frame to every target; return where it ended.

    A position is the number of a frame times _SOCKETS and that of a target; at the end it is that of frame `count`, and -1
    where somebody has to be let in first. Each frame is stamped when it leaves: who waits for it may run at once.
    """
    line = lines[0]
    times = line.time
    if line.local and position == 0:
        times[0] = times[1] = 0
        if _ppoll(line.polls.ctypes.data, 1, times.ctypes.data, 0) > 0:
            return -1
    first = position % _SOCKETS
    for index in range(position // _SOCKETS, count):
        if line.local and first == 0:
            frames[index].stamp = now(CLOCK_REALTIME, times)
        frame = frames.ctypes.data + index * frames.itemsize
        for place in range(first, line.reached):
            if _send(line.targets[place], frame, line.length, _DONTWAIT | _NOSIGNAL) < 0:
                error = _errno_location()[0]
                if error != _EAGAIN and error != _ENOBUFS and error != _ENOMEM:
                    line.error = error
                    return index * _SOCKETS + place
                line.refused[place] += 1
                line.unsent += 1
        first = 0
    return count * _SOCKETS
