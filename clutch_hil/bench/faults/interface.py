"""Fault of the CAN interface: it is set down, as by an administrator or a driver that resets it."""

import fcntl
import socket
import struct
from collections.abc import Callable, Mapping

from clutch_hil.bench.faults.bench_fault import Surroundings
from clutch_hil.bench.faults.host_fault import HostFault, has_capability
from protocols.errors import InputError

_NET_ADMIN = 12  # CAP_NET_ADMIN of linux/capability.h
_GET_FLAGS, _SET_FLAGS = 0x8913, 0x8914  # SIOCGIFFLAGS, SIOCSIFFLAGS of linux/sockios.h
_UP = 1  # IFF_UP of linux/if.h
_REQUEST = struct.Struct("16sH22x")  # struct ifreq of linux/if.h: name and flags
_LOCAL = "local:"


class InterfaceDown(HostFault):
    """The CAN interface of the bench is down; it needs SocketCAN."""

    name = "interface_down"
    parameters = ()

    @classmethod
    def check(cls, bus: str, telemetry: bool) -> None:
        """See `HostFault`."""
        if bus.startswith(_LOCAL):
            raise InputError(
                f"interface_down needs a CAN interface, but the bus is {bus}; use bus_fault frame_loss there"
            )
        if not has_capability(_NET_ADMIN):
            raise InputError(
                f"interface_down takes {bus} down, and this user has no permission; CAP_NET_ADMIN is needed"
            )

    @classmethod
    def begin(cls, around: Surroundings, values: Mapping[str, float]) -> Callable[[], None]:
        """See `HostFault`."""
        _set_up(around.bus, False)
        return lambda: _set_up(around.bus, True)


def _set_up(interface: str, up: bool) -> None:
    """Set an interface up or down. Raises InputError."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        try:
            answer = fcntl.ioctl(port, _GET_FLAGS, _REQUEST.pack(interface.encode(), 0))
            flags = _REQUEST.unpack(answer)[1]
            fcntl.ioctl(port, _SET_FLAGS, _REQUEST.pack(interface.encode(), flags | _UP if up else flags & ~_UP))
        except OSError as error:
            raise InputError(
                f"interface {interface} cannot be set {'up' if up else 'down'}: {error.strerror}"
            ) from None


FAULTS = (InterfaceDown,)
