"""Sockets of a bench: on loopback alone, every process of it, unless a file of `clutch-hil secure` says who may connect."""

import socket
from collections.abc import Iterator
from ipaddress import ip_address
from pathlib import Path

import psutil
import pytest

from clutch_hil.bench.host.exposure import Listener, describe_exposure, is_loopback, list_listeners
from clutch_hil.live.network.lab_network import make_lab
from tests.processes import service
from tests.protocols.telemetry.benches import wait_until

RATE = "100"  # Hz: gentle to a machine that runs other tests
LISTENING = ("LISTEN", "NONE")  # of psutil: a socket of TCP that listens, one of UDP


def listening(process: psutil.Process) -> set[tuple[int, str, int]]:
    """Process, address and port of every socket that a process or one that it has started listens on, by psutil."""
    result = set()
    for each in (process, *process.children(recursive=True)):
        for one in each.net_connections(kind="inet"):
            if one.status in LISTENING and not one.raddr:
                result.add((each.pid, one.laddr.ip, one.laddr.port))
    return result


@pytest.fixture
def bench_arguments(local_bus: str, tmp_path: Path) -> list[str]:
    return ["up", "--bus", local_bus, "--rate", RATE, "--seconds", "300", "--out", str(tmp_path / "runs")]


def commands(listeners: list[Listener]) -> Iterator[str]:
    return (listener.command.split()[0] for listener in listeners)


def test_every_socket_of_a_bench_with_its_web_view_is_on_loopback(bench_arguments: list[str]) -> None:
    with service(*bench_arguments, "--web") as up:
        process = psutil.Process(up.pid)

        def sockets() -> set[tuple[int, str, int]] | None:
            there = listening(process)
            return there if len(there) >= 5 and max(port for *_, port in there) >= 9090 else None

        there = wait_until(
            sockets, "two of telemetry, and three of the viewer: its data, its page, and the page of rerun"
        )
        assert {address for _, address, _ in there if not ip_address(address).is_loopback} == set()
        pids = [process.pid, *(child.pid for child in process.children(recursive=True))]
        ours = {(listener.pid, listener.address, listener.port) for listener in list_listeners(pids)}
        assert ours == there
        # doctor finds these processes by their commands
        assert {listener.pid for listener in list_listeners()} >= {pid for pid, *_ in there}
        assert set(commands(list_listeners(pids))) == {"protocols.telemetry", "clutch_hil", "rerun"}


def test_a_bench_with_certificates_listens_where_it_was_told_and_is_not_exposed(
    bench_arguments: list[str], tmp_path: Path
) -> None:
    make_lab(tmp_path / "lab", ("0.0.0.0",), "ada", 1, overwrite=False)
    with service(*bench_arguments, "--network", str(tmp_path / "lab" / "bench.json")) as up:
        process = psutil.Process(up.pid)
        there = wait_until(lambda: (result := listening(process)) and len(result) >= 2 and result, "two of telemetry")
        assert {address for _, address, _ in there} == {"0.0.0.0"}
        listeners = list_listeners([pid for pid, *_ in there])
        assert [listener.is_exposed for listener in listeners] == [False] * len(there)
        assert describe_exposure(listeners) == ("2 sockets, 2 of them beyond this machine, with certificates", True)


@pytest.mark.parametrize("family", [socket.AF_INET, socket.AF_INET6])
@pytest.mark.parametrize("kind", [socket.SOCK_STREAM, socket.SOCK_DGRAM])
def test_an_exposed_socket_is_told(family: socket.AddressFamily, kind: socket.SocketKind) -> None:
    import os

    with socket.socket(family, kind) as here, socket.socket(family, kind) as everywhere:
        here.bind(("127.0.0.1" if family == socket.AF_INET else "::1", 0))
        everywhere.bind(("" if family == socket.AF_INET else "::", 0))
        if kind == socket.SOCK_STREAM:
            here.listen()
            everywhere.listen()
        result = {listener.port: listener for listener in list_listeners([os.getpid()])}
        assert not result[here.getsockname()[1]].is_exposed
        exposed = result[everywhere.getsockname()[1]]
        assert exposed.is_exposed
        text, good = describe_exposure([exposed])
        assert good is False
        assert f"port {exposed.port}, process {os.getpid()}" in text


def test_what_is_loopback() -> None:
    assert all(map(is_loopback, ("127.0.0.1", "127.3.4.5", "::1", "::ffff:127.0.0.1")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "192.168.1.5", "::ffff:192.168.1.5")))
    assert describe_exposure([]) == ("no process of a bench listens on the network", None)
