"""Exposure: find the sockets on which processes of a bench listen, and whether other machines can reach them.

Source: proc(5): /proc/PID/net/tcp and similar files have a line for each socket, with address, state and inode; /proc/PID/fd
lists the inodes that a process holds. Only root can inspect processes of other users.
"""

import os
import sys
from collections.abc import Iterable, Iterator
from ipaddress import IPv6Address, ip_address
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from protocols.telemetry.lab import SUFFIX

_PROC = Path("/proc")
# By protocol, the state of a socket that accepts data (include/net/tcp_states.h: LISTEN 10, CLOSE 7)
_TABLES = {"tcp": "0A", "tcp6": "0A", "udp": "07", "udp6": "07"}
_WORDS = ("clutch_hil", "clutch-hil", "protocols.telemetry", "rerun_cli/rerun")  # in command lines of a bench
_SHOWN = 3  # exposed sockets that are listed


class Listener(NamedTuple):
    """A listening socket: its process with the first words of its command, protocol, address and port.

    encrypted: whether a file of `clutch-hil secure` controls who may connect.
    """

    pid: int
    command: str
    protocol: str
    address: str
    port: int
    encrypted: bool

    @property
    def is_exposed(self) -> bool:
        """Return whether other machines can reach the socket without a certificate."""
        return not (self.encrypted or is_loopback(self.address))

    def __str__(self) -> str:
        """Return a description for people."""
        return f"{self.protocol} {self.address} port {self.port}, process {self.pid} ({self.command})"


def is_loopback(address: str) -> bool:
    """Return whether an IPv4 or IPv6 address can be reached from this machine only."""
    parsed = ip_address(address)
    mapped = parsed.ipv4_mapped if isinstance(parsed, IPv6Address) else None
    return (mapped or parsed).is_loopback


def list_listeners(pids: Iterable[int] | None = None) -> list[Listener]:
    """Return the sockets on which the processes `pids` listen; if None, those of all readable benches on this machine."""
    listeners = []
    for pid in sorted(_list_bench_processes() if pids is None else pids):
        words = _read_command(pid)
        try:
            listeners += [
                Listener(pid, _shorten(words), protocol, address, port, _is_encrypted(words))
                for protocol, address, port in _list_sockets(pid)
            ]
        except OSError:  # the process has ended, or belongs to another user
            continue
    return listeners


def describe_exposure(listeners: Iterable[Listener]) -> tuple[str, bool | None]:
    """Return the state of the network as text, and whether it is good; None where nothing listens."""
    there = list(listeners)
    exposed = [listener for listener in there if listener.is_exposed]
    if exposed:
        rest = f" and {len(exposed) - _SHOWN} more" if len(exposed) > _SHOWN else ""
        return f"reached by others without a certificate: {'; '.join(map(str, exposed[:_SHOWN]))}{rest}", False
    if not there:
        return "no process of a bench listens on the network", None
    beyond = sum(not is_loopback(listener.address) for listener in there)
    return f"{len(there)} sockets, {beyond} of them beyond this machine, with certificates", True


def _list_bench_processes() -> Iterator[int]:
    for folder in _PROC.iterdir():
        if folder.name.isdigit() and int(folder.name) != os.getpid():
            line = " ".join(_read_command(int(folder.name))[:6])  # interpreter, its options, module or script
            if any(word in line for word in _WORDS):
                yield int(folder.name)


def _read_command(pid: int) -> list[str]:
    try:
        return (_PROC / str(pid) / "cmdline").read_text(errors="replace").split("\0")[:-1]
    except OSError:
        return []


def _shorten(words: list[str]) -> str:
    """Return the part of a command that identifies it: without interpreter and its options, or the folder of the program."""
    while words and (Path(words[0]).name.startswith("python") or words[0] in ("-P", "-m")):
        words = words[1:]
    return " ".join([Path(words[0]).name, *words[1:2]]) if words else "unknown"


def _is_encrypted(words: list[str]) -> bool:
    """Return whether a process is the telemetry process of a service that was given a network file."""
    return "protocols.telemetry" in words and any(
        option in ("--router", "--network") and value.endswith(SUFFIX) for option, value in pairwise(words)
    )


def _list_sockets(pid: int) -> Iterator[tuple[str, str, int]]:
    """Yield protocol, address and port of each socket on which a process listens. Raises OSError."""
    folder = _PROC / str(pid)
    inodes = set()
    for entry in (folder / "fd").iterdir():
        try:
            target = os.readlink(entry)
        except OSError:  # closed in the meantime
            continue
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    for protocol, listening in _TABLES.items():
        try:
            lines = (folder / "net" / protocol).read_text().splitlines()[1:]
        except OSError:  # a kernel without this protocol, such as IPv6
            continue
        for line in lines:
            _, local, _, state, *_, inode = line.split()[:10]
            if state == listening and inode in inodes:
                address, port = local.split(":")
                yield protocol, _format_address(address), int(port, 16)


def _format_address(text: str) -> str:
    """Return an address as text, from the kernel's 32-bit words in the byte order of the machine."""
    words = [int(text[i : i + 8], 16).to_bytes(4, sys.byteorder) for i in range(0, len(text), 8)]
    return str(ip_address(b"".join(words)))
