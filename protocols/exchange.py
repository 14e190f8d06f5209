"""Exchange: frames of a port in and out of memory that is there from the start, by system calls from compiled code.

Method          one ppoll(2) waits for all sockets of the bus; recvmmsg(2) puts what waits on each into `inbox`, sendmmsg(2)
                takes what is to be sent from a batch: no object a frame, no allocation, no GIL
Assumptions     Linux on a machine of 64 bits, whose layouts of pollfd, iovec, mmsghdr and cmsghdr these are
Same as         protocols.bus.Port: who is heard, what is refused, order of frames, time stamps, counters
"""

import time
from typing import Any

import numpy as np
from numba import njit, types

from protocols.batch import batch
from protocols.bus import Port
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
_EAGAIN = 11  # asm-generic/errno-base.h
_CLOCK_REALTIME, _CLOCK_MONOTONIC = 0, 1  # linux/time.h
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
    [("local", "?"), ("mark", "i8"), ("heard", "i8"), ("polls", _POLLFD, (_SOCKETS,)), ("reached", "i8"),
     ("targets", "i4", (_SOCKETS,)), ("incoming", _MMSGHDR, (_A_CALL,)), ("in_parts", _IOVEC, (_A_CALL,)),
     ("controls", _CONTROL, (_A_CALL,)), ("outgoing", _MMSGHDR, (_A_CALL,)), ("out_parts", _IOVEC, (_A_CALL,)),
     ("time", "i8", (2,)), ("marks", "i8"), ("marked_ns", "i8"), ("changed", "?"), ("error", "i8"), ("unsent", "i8")],
    align=True,
)  # fmt: skip


def _system(name: str, result: Any, *arguments: Any) -> Any:
    """A function of the C library, called from compiled code."""
    return types.ExternalFunction(name, result(*arguments))


_INT, _LONG = types.int32, types.int64  # addresses and sizes are _LONG
_ppoll = _system("ppoll", _INT, _LONG, _LONG, _LONG, _LONG)
_recvmmsg = _system("recvmmsg", _INT, _INT, _LONG, _INT, _INT, _LONG)
_sendmmsg = _system("sendmmsg", _INT, _INT, _LONG, _INT, _INT)
_clock_gettime = _system("clock_gettime", _INT, _INT, _LONG)
_errno_location = _system("__errno_location", types.CPointer(_INT))


class Exchange:
    """What comes on `port` goes to `inbox`, shape (CAPACITY,) of batch.FRAME, the first `count` of it.

    Raises InputError where more than 256 participants are on a local bus.
    """

    def __init__(self, port: Port, mark: int) -> None:
        self.port = port
        self.inbox = batch(CAPACITY + 1)  # one to move frames by
        self.count = 0
        self._line = np.zeros(1, _LINE)
        self._view = line = self._line[0]
        # what is looked at in every cycle: a field of a record costs a microsecond, an element of a memory view a tenth
        seen = "marks", "marked_ns", "changed", "reached"
        self._marks, self._marked_ns, self._changed, self._reached = (self._line[name].data for name in seen)
        line["mark"], line["local"] = mark, port.raw.listener is not None
        line["polls"]["events"] = _POLLIN
        for headers, parts in (("incoming", "in_parts"), ("outgoing", "out_parts")):
            line[headers]["iov"], line[headers]["iov_length"] = _addresses(line[parts]), 1
            line[parts]["length"] = _STAMPED if line["local"] else _CLASSIC
        if not line["local"]:
            line["incoming"]["control"] = _addresses(line["controls"])
        self._look()
        self.receive()  # compiled now, not in the loop
        self.receive(marked=True)
        self.send(batch(1), 0)

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

    def receive(self, timeout: float = 0.0, marked: bool = False) -> bool:
        """Add to `inbox` the frames that wait, or that come within `timeout` [s] until one has, or, `marked`, until one of
        those has that are marked; whether any came."""
        left = round(timeout * 1e9)
        end = time.monotonic_ns() + left
        gather = _gather_marked if marked else _gather
        first = count = self.count
        if self._changes != self.port.raw.changes:  # while others read the bus through the port, or wrote to it
            self._look()
        marks = self.marks if marked else 0
        while True:
            count = gather(self._line, left, self.inbox, first, count)
            for _ in range(_LOOKS):
                if not self._changed[0]:
                    break
                self._look()  # who came in may have sent already
                count = _gather(self._line, 0, self.inbox, first, count)
            if left <= 0 or (self.marks > marks if marked else count > first):
                break
            left = max(end - time.monotonic_ns(), 0)
        self.port.received += count - first
        self.count = count
        return count > first

    def send(self, frames: np.ndarray, count: int) -> None:
        """Send the first `count` frames of a batch, never waiting; what the bus cannot take is counted, not repeated."""
        if self._changes != self.port.raw.changes:
            self._look()
        line, target, left = self._view, _spread(self._line, 0, frames, count), False
        while target != self._reached[0]:
            if target < 0:  # newcomers are to get them, too
                self._look()
                target = _spread(self._line, 0, frames, count)
            else:
                left |= self.port.lost(int(line["targets"][target]), int(line["error"]), int(line["unsent"]))
                target = _spread(self._line, target + 1, frames, count)
        self.port.sent += count
        if left:  # a closed descriptor's number may soon be somebody else's
            self._look()

    def _look(self) -> None:
        """Let newcomers in, and those go who have left; see who is there."""
        heard, reached = self.port.raw.sockets()
        if len(heard) > _SOCKETS:
            raise InputError(f"{len(heard)} participants are on {self.port.name}; allowed are {_SOCKETS}")
        line = self._view
        line["heard"], line["reached"] = len(heard), len(reached)
        line["polls"]["fd"][: len(heard)] = heard
        line["targets"][: len(reached)] = reached
        self._changes = self.port.raw.changes


def _addresses(rows: np.ndarray) -> np.ndarray:
    return rows.ctypes.data + rows.itemsize * np.arange(len(rows))


@njit(cache=True, nogil=True)
def _gather(lines, timeout_ns, inbox, first, count):
    """Take what waits, or comes first within `timeout_ns` [ns], into `inbox` from number `count` on; return how many there are.

    From number `first` on they are in the order of their stamps.
    """
    line = lines[0]
    polls, messages = line.polls, line.incoming
    line.changed = False
    line.time[0], line.time[1] = timeout_ns // _SECOND, timeout_ns % _SECOND
    if _ppoll(polls.ctypes.data, line.heard, line.time.ctypes.data, 0) <= 0:
        return count
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
def _gather_marked(lines, timeout_ns, inbox, first, count):
    """The same until a marked frame has come: who waits for it does not wake up for others."""
    line = lines[0]
    marks, end, left = line.marks, _now(_CLOCK_MONOTONIC, line.time) + timeout_ns, timeout_ns
    while True:
        count = _gather(lines, left, inbox, first, count)
        if line.marks > marks or line.changed or count + _A_CALL > CAPACITY:
            return count
        left = end - _now(_CLOCK_MONOTONIC, line.time)
        if left <= 0:
            return count


@njit
def _now(clock, times):
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
    return _now(_CLOCK_REALTIME, times)


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


@njit(cache=True, nogil=True)
def _spread(lines, target, frames, count):
    """Send `count` frames to targets from number `target` on; return the number of the first that has not got them all.

    -1 where somebody has to be let in first.
    """
    line = lines[0]
    times = line.time
    if line.local and target == 0:
        times[0] = times[1] = 0
        if _ppoll(line.polls.ctypes.data, 1, times.ctypes.data, 0) > 0:
            return -1
        stamp = _now(_CLOCK_REALTIME, times)
        for index in range(count):
            frames[index].stamp = stamp
    for index in range(count):
        line.out_parts[index].base = frames.ctypes.data + index * frames.itemsize
    headers = line.outgoing
    for place in range(target, line.reached):
        done = 0
        while done < count:
            sent = _sendmmsg(
                line.targets[place], headers.ctypes.data + done * headers.itemsize, count - done, _DONTWAIT | _NOSIGNAL
            )
            if sent < 0:
                line.error, line.unsent = _errno_location()[0], count - done
                return place
            done += sent
    return line.reached
