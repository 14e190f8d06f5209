"""The server of the viewer's page: peers that misbehave are not told, and a port that is taken is one sentence."""

import socket
import struct
import threading
import time
from contextlib import ExitStack

import pytest

from clutch_hil.live.viewer.viewer_page import LOOPBACK, MOST_CONNECTIONS, ViewerPage
from protocols.errors import InputError
from tests.processes import PATIENCE
from tests.protocols.telemetry.benches import wait_until

AT_ONCE = 10.0  # s for an answer that takes milliseconds
CROWD = MOST_CONNECTIONS + 20  # peers at once

_RESET = struct.pack("ii", 1, 0)  # struct linger: closing a socket resets its connection


def find_free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


@pytest.mark.parametrize("question", [b"GET /", b"GET /\x7f\xff HTTP/1.1\r\n\r\n", b"\0" * 100 + b"\r\n\r\n"])
def test_a_peer_that_leaves_or_asks_nonsense_is_no_news(question: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    port = find_free_port()
    with ViewerPage(port, find_free_port(), find_free_port()):
        for leaves in (True, False):
            with socket.create_connection((LOOPBACK, port), PATIENCE) as peer:
                peer.sendall(question)
                if leaves:
                    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
                else:
                    peer.shutdown(socket.SHUT_WR)
                    while peer.recv(1 << 16):
                        pass
        time.sleep(0.2)
    assert capfd.readouterr() == ("", "")


def test_a_port_that_was_taken_meanwhile_is_one_sentence() -> None:
    """As by a second `view --web` that is started at the same time."""
    port = find_free_port()
    with (
        ViewerPage(port, find_free_port(), find_free_port()),
        pytest.raises(
            InputError, match=f"the page cannot be served on port {port} of 127.0.0.1: Address already in use"
        ),
    ):
        ViewerPage(port, find_free_port(), find_free_port())


def test_many_connections_take_no_more_threads_than_allowed_and_a_place_becomes_free_again() -> None:
    port, before = find_free_port(), threading.active_count()
    with ViewerPage(port, find_free_port(), find_free_port(), token="secret"), ExitStack() as stack:
        peers = [stack.enter_context(socket.create_connection((LOOPBACK, port), PATIENCE)) for _ in range(CROWD)]
        assert peers[-1].recv(1) == b""  # closed without an answer
        assert threading.active_count() - before <= MOST_CONNECTIONS + 1
        for peer in peers:
            peer.close()
        wait_until(lambda: threading.active_count() - before <= 1, "the threads to end")
        with socket.create_connection((LOOPBACK, port), PATIENCE) as peer:
            peer.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
            assert peer.recv(100).startswith(b"HTTP/1.0 403")


def test_a_browser_that_leaves_a_stream_without_rows_leaves_no_thread() -> None:
    """As of a recorded run, after which no row comes: each time the page is loaded anew."""
    port, data, others = find_free_port(), find_free_port(), set(threading.enumerate())  # some of them may end
    with socket.create_server((LOOPBACK, data)) as rerun, ViewerPage(port, find_free_port(), data, token="secret"):
        rerun.settimeout(PATIENCE)
        for head in (b"", b"HTTP/1.1 200 OK\r\n\r\nrows"):
            with socket.create_connection((LOOPBACK, port), PATIENCE) as browser:
                browser.sendall(b"POST /?token=secret HTTP/1.1\r\nContent-Length: 2\r\n\r\n{}")
                stream, _ = rerun.accept()
                stream.sendall(head)
                if head:
                    assert browser.recv(15) == b"HTTP/1.0 200 OK"
                    time.sleep(1.0)  # the server looks twice a second who has left
                    with socket.create_connection((LOOPBACK, port), AT_ONCE) as other:
                        other.sendall(b"GET / HTTP/1.1\r\n\r\n")
                        assert other.recv(100).startswith(b"HTTP/1.0 403")
                # the page's thread and the stream's: that of `other` may need a moment
                wait_until(lambda: len(set(threading.enumerate()) - others) == 2, "two threads")
            wait_until(lambda: len(set(threading.enumerate()) - others) <= 1, "the thread to end")
            stream.close()
