"""python-can interface `local`: `can.Bus("NAME", interface="local")`, so that every python-can tool works on `local:NAME`."""

import errno
import os
import select
from collections import deque
from typing import Any

import can
import can.typechecking
from can.util import CAN_FD_DLC

from protocols.buses.local_channel import CLASSIC, FD, LocalChannel, OwnFrame
from protocols.buses.local_folder import find_bus_root

_EXTENDED, _REMOTE, _ERROR = 0x80000000, 0x40000000, 0x20000000  # CAN_EFF_FLAG, CAN_RTR_FLAG, CAN_ERR_FLAG
_BRS, _ESI, _FDF = 0x01, 0x02, 0x04  # CANFD_BRS, CANFD_ESI, CANFD_FDF


class LocalBus(can.BusABC):
    """python-can interface `local`: `can.Bus("NAME", interface="local")`; what the bus guarantees: `local_channel`.

    `fd=True` sends and receives CAN FD too; without it FD frames of others are not received. Own messages
    (`receive_own_messages=True`) have `is_rx=False`. `raw` is the LocalChannel below: receive through one of the two.
    Raises can.CanInitializationError for an unusable name or folder.
    """

    def __init__(
        self,
        channel: can.typechecking.Channel,
        can_filters: can.typechecking.CanFilters | None = None,
        receive_own_messages: bool = False,
        fd: bool = False,
        **kwargs: Any,
    ) -> None:
        self.raw = LocalChannel("" if channel is None else str(channel), receive_own_messages)
        self.channel_info = f"local:{self.raw.name}"
        self._can_protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
        self._fd = fd
        self._taken: deque[can.Message] = deque()
        # fileno() must stay readable while messages taken from the raw channel wait here.
        self._taken_event = os.eventfd(0)
        self._taken_announced = False
        self._readable = select.epoll()
        self._readable.register(self._taken_event, select.EPOLLIN)
        self._readable.register(self.raw.fileno(), select.EPOLLIN)
        super().__init__(channel, can_filters, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send to all participants at once; `timeout` is not used.

        One participant with a full queue does not hinder the others: it is only counted in `raw.refused`. Raises
        can.CanOperationError with ENOBUFS if every participant refused, and with EINVAL for a message not allowed.
        """
        self._check_open()
        if msg.is_fd and not self._fd:
            raise can.CanOperationError(f"CAN FD message sent on {self.channel_info}, opened without fd", errno.EINVAL)
        refusals = self.raw.send(_pack_frame(msg))
        if refusals and refusals >= len(self.raw.participants):
            raise can.CanOperationError(
                f"all {refusals} participants of {self.channel_info} have full queues", errno.ENOBUFS
            )

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._check_open()
        if not self._taken and self.raw.wait(timeout):
            for stamp, frame in self.raw.receive():
                if self._fd or len(frame) == CLASSIC.size:
                    message = _unpack_message(stamp, frame, self.raw.name)
                    if self._matches_filters(message):
                        self._taken.append(message)
        next_message = self._taken.popleft() if self._taken else None
        if bool(self._taken) != self._taken_announced:
            self._taken_announced = bool(self._taken)
            if self._taken_announced:
                os.eventfd_write(self._taken_event, 1)
            else:
                os.eventfd_read(self._taken_event)
        return next_message, True

    def fileno(self) -> int:
        return self._readable.fileno()

    def flush_tx_buffer(self) -> None:
        """Do nothing: sent frames are already in the queues of the others."""

    def shutdown(self) -> None:
        if not self._is_shutdown:
            super().shutdown()
            self.raw.close()
            self._readable.close()
            os.close(self._taken_event)

    def _check_open(self) -> None:
        if self._is_shutdown:
            raise can.CanOperationError(f"{self.channel_info} is shut down", errno.EBADF)

    @staticmethod
    def _detect_available_configs() -> list[can.typechecking.AutoDetectedConfig]:
        names = {path.parent.name for path in find_bus_root().glob("*/[0-9]*-[0-9]*")}
        return [{"interface": "local", "channel": name} for name in sorted(names)]


def _pack_frame(message: can.Message) -> bytes:
    """Return the message as struct can_frame or canfd_frame; FD data are padded with zeros to the next valid length."""
    identifier = (
        message.arbitration_id
        | (_EXTENDED if message.is_extended_id else 0)
        | (_REMOTE if message.is_remote_frame else 0)
        | (_ERROR if message.is_error_frame else 0)
    )
    data_bytes = 64 if message.is_fd else 8
    length = message.dlc if message.is_remote_frame else len(message.data)
    if length > data_bytes:
        raise can.CanOperationError(f"message of {length} data bytes; allowed are up to {data_bytes}", errno.EINVAL)
    if not message.is_fd:
        return CLASSIC.pack(identifier, length, message.data)
    flags = _FDF | (_BRS if message.bitrate_switch else 0) | (_ESI if message.error_state_indicator else 0)
    return FD.pack(identifier, next(step for step in CAN_FD_DLC if step >= length), flags, message.data)


def _unpack_message(stamp: int, frame: bytes, channel: str) -> can.Message:
    is_fd = len(frame) == FD.size
    flags = 0
    if is_fd:
        identifier, length, flags, data = FD.unpack(frame)
    else:
        identifier, length, data = CLASSIC.unpack(frame)
    is_extended = bool(identifier & _EXTENDED)
    return can.Message(
        timestamp=stamp * 1e-9,
        arbitration_id=identifier & (0x1FFFFFFF if is_extended else 0x7FF),
        is_extended_id=is_extended,
        is_remote_frame=bool(identifier & _REMOTE),
        is_error_frame=bool(identifier & _ERROR),
        channel=channel,
        dlc=length,
        data=data[:length],
        is_fd=is_fd,
        is_rx=not isinstance(frame, OwnFrame),
        bitrate_switch=bool(flags & _BRS),
        error_state_indicator=bool(flags & _ESI),
    )
