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

CAPACITY = 4096  # frames between two looks of the loop; what comes beyond waits in the sockets
_A_CALL = 32  # frames that one system call takes
_SOCKETS = 64  # there is room for at the start: participants of a local bus
_CLASSIC, _STAMPED = 16, 24  # bytes of struct can_frame, and with its stamp, as a local bus carries it
_FLAGS, _STANDARD_ID, _DATA = 0xE0000000, 0x7FF, 8  # extended, remote, error: never frames of this bench
_DONTWAIT, _NOSIGNAL, _TRUNC = 0x40, 0x4000, 0x20  # MSG_... of linux/socket.h
_POLLIN = 1  # asm-generic/poll.h
_EAGAIN = 11  # asm-generic/errno-base.h
_CLOCK_REALTIME = 0
_SECOND = 1_000_000_000  # ns
_TAKEN, _MARKS, _STAMP, _CHANGED, _ERROR, _LEFT = range(6)  # what a kernel tells

_MMSGHDR = np.dtype(
    [("name", "i8"), ("name_length", "i8"), ("iov", "i8"), ("iov_length", "i8"), ("control", "i8"), ("control_length", "i8"),
     ("flags", "i4"), ("_", "i4"), ("length", "u4"), ("__", "u4")]
)  # fmt: skip
_IOVEC = np.dtype([("base", "i8"), ("length", "i8")])
_CONTROL = np.dtype([("length", "i8"), ("level", "i4"), ("type", "i4"), ("seconds", "i8"), ("nanoseconds", "i8")])
_POLLFD = np.dtype([("fd", "i4"), ("events", "i2"), ("revents", "i2")])


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

    `marks` counts frames with the identifier `mark`; `marked_ns` is the stamp of the last one [ns of CLOCK_REALTIME].
    """

    def __init__(self, port: Port, mark: int) -> None:
        self.port = port
        self.inbox = batch(CAPACITY + 1)  # one to move frames by
        self.count = self.marks = self.marked_ns = 0
        self._mark, self._local = mark, port.raw.listener is not None
        self._in, self._in_parts = self._messages()
        self._out, self._out_parts = self._messages()
        self._controls = np.zeros(_A_CALL, _CONTROL)
        if not self._local:
            self._in["control"] = _addresses(self._controls)
        self._polls, self._targets = np.zeros(_SOCKETS, _POLLFD), np.zeros(_SOCKETS, np.int32)
        self._polls["events"] = _POLLIN
        self._time, self._told = np.zeros(2, np.int64), np.zeros(6, np.int64)
        self._heard = self._reached = 0
        self._look()
        self.receive()  # compiled now, not in the loop
        self.send(batch(1), 0)

    def clear(self) -> None:
        """The frames in `inbox` have been used."""
        self.count = 0

    def receive(self, timeout: float = 0.0) -> bool:
        """Add to `inbox` the frames that wait, or that come first within `timeout` [s]; whether any did."""
        left = round(timeout * 1e9)
        end = time.monotonic_ns() + left
        while True:
            _gather(
                self._polls, self._heard, left, self._local, self._in, self._in_parts, self._controls, self.inbox,
                self.count, self._mark, self._time, self._told,
            )  # fmt: skip
            taken, marks, stamp, changed, _, _ = self._told.tolist()
            self.count += taken
            self.port.received += taken
            if marks:
                self.marks += marks
                self.marked_ns = stamp
            if changed:
                self._look()
            if taken or left <= 0:
                return bool(taken)
            left = max(end - time.monotonic_ns(), 0)

    def send(self, frames: np.ndarray, count: int) -> None:
        """Send the first `count` frames of a batch, never waiting; what the bus cannot take is counted, not repeated."""
        target = 0
        while True:
            target = _spread(
                self._polls, self._targets, target, self._reached, self._local, frames, count, self._out, self._out_parts,
                self._time, self._told,
            )  # fmt: skip
            if target == self._reached:
                break
            if target < 0:  # newcomers are to get them, too
                self._look()
                target = 0
                continue
            self.port.lost(int(self._targets[target]), int(self._told[_ERROR]), int(self._told[_LEFT]))
            target += 1
        self.port.sent += count

    def _look(self) -> None:
        """Let newcomers in, and those go who have left; see who is there."""
        heard, reached = self.port.raw.sockets()
        if len(heard) > len(self._polls):
            self._polls, self._targets = np.zeros(2 * len(heard), _POLLFD), np.zeros(2 * len(heard), np.int32)
            self._polls["events"] = _POLLIN
        self._heard, self._reached = len(heard), len(reached)
        self._polls["fd"][: len(heard)] = heard
        self._targets[: len(reached)] = reached

    def _messages(self) -> tuple[np.ndarray, np.ndarray]:
        """Headers of messages of a part each, and their parts."""
        headers, parts = np.zeros(_A_CALL, _MMSGHDR), np.zeros(_A_CALL, _IOVEC)
        headers["iov"], headers["iov_length"] = _addresses(parts), 1
        parts["length"] = _STAMPED if self._local else _CLASSIC
        return headers, parts


def _addresses(rows: np.ndarray) -> np.ndarray:
    return rows.ctypes.data + rows.itemsize * np.arange(len(rows))


@njit(cache=True, nogil=True)
def _gather(polls, heard, timeout_ns, local, messages, parts, controls, inbox, count, mark, times, told):
    """Take what waits on the first `heard` of `polls`, or comes first within `timeout_ns`; tell how much, and of whom."""
    told[:] = 0
    times[0], times[1] = timeout_ns // _SECOND, timeout_ns % _SECOND
    if _ppoll(polls.ctypes.data, heard, times.ctypes.data, 0) <= 0:
        return
    end = count
    for place in range(heard):
        events = polls[place].revents
        if local and place == 0 and events:  # who listens: there is a newcomer
            told[_CHANGED] = 1
            continue
        begin = end
        more = events & _POLLIN != 0
        while more and end + _A_CALL <= CAPACITY:
            for index in range(_A_CALL):
                parts[index].base = inbox.ctypes.data + (end + index) * inbox.itemsize
                messages[index].control_length = 0 if local else controls.itemsize
            got = _recvmmsg(polls[place].fd, messages.ctypes.data, _A_CALL, _DONTWAIT, 0)
            if got < 0 and _errno_location()[0] != _EAGAIN:
                told[_CHANGED] = 1
            more = got == _A_CALL
            kept = end
            for index in range(got):
                if messages[index].length == 0:
                    told[_CHANGED], more = 1, False  # who sent has left
                    continue
                frame = inbox[end + index]
                if (
                    messages[index].length != parts[index].length
                    or messages[index].flags & _TRUNC
                    or np.int64(frame.can_id) & _FLAGS
                    or frame.length > _DATA
                ):
                    continue  # CAN FD, and what else is none of ours
                if not local:
                    frame.stamp = _stamp(controls[index], messages[index].control_length, times)
                if kept < end + index:
                    inbox[kept] = inbox[end + index]
                frame = inbox[kept]
                frame.can_id = np.int64(frame.can_id) & _STANDARD_ID
                for byte in range(np.int64(frame.length), _DATA):
                    frame.data[byte] = 0
                if frame.can_id == mark:
                    told[_MARKS] += 1
                    told[_STAMP] = max(told[_STAMP], frame.stamp)
                kept += 1
            end = kept
        if events & ~_POLLIN:
            told[_CHANGED] = 1
        _merge(inbox, count, begin, end)
    told[_TAKEN] = end - count


@njit
def _stamp(control, length, times):
    """Time stamp of the kernel, or now where it gave none [ns of CLOCK_REALTIME]."""
    if length == control.length and length >= 32:
        return control.seconds * _SECOND + control.nanoseconds
    _clock_gettime(_CLOCK_REALTIME, times.ctypes.data)
    return times[0] * _SECOND + times[1]


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
def _spread(polls, targets, target, reached, local, frames, count, messages, parts, times, told):
    """Send `count` frames to targets from number `target` on; return the number of the first that has not got them all.

    -1 where somebody has to be let in first.
    """
    if local and target == 0:
        times[:] = 0
        if _ppoll(polls.ctypes.data, 1, times.ctypes.data, 0) > 0:
            return -1
        _clock_gettime(_CLOCK_REALTIME, times.ctypes.data)
        for index in range(count):
            frames[index].stamp = times[0] * _SECOND + times[1]
    for index in range(count):
        parts[index].base = frames.ctypes.data + index * frames.itemsize
    for place in range(target, reached):
        done = 0
        while done < count:
            sent = _sendmmsg(
                targets[place], messages.ctypes.data + done * messages.itemsize, count - done, _DONTWAIT | _NOSIGNAL
            )
            if sent < 0:
                told[_ERROR], told[_LEFT] = _errno_location()[0], count - done
                return place
            done += sent
    return reached
