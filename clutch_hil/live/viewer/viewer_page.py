"""Viewer page: serve rerun's web viewer without requests to the internet; on loopback, or for other machines with a token.

The original page requests fonts, news and usage statistics from the internet; it works without them. Its links are removed, and
a content security policy refuses further requests of its program.

On loopback the page connects to rerun's data itself. Beyond loopback everything goes through this server, which serves nothing
to a browser without the token: it is in the address of the page, and in a cookie from then on. The connection is not
encrypted: anyone who reads the network traffic can read the token.
"""

import hmac
import re
import select
import socket
import threading
from contextlib import suppress
from http.client import HTTPConnection, HTTPResponse
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs

from protocols.errors import InputError

LOOPBACK = "127.0.0.1"
_TIMEOUT = 30.0  # s for the transfer of the 40 MB of the viewer's program
_PIECE = 65_536  # bytes of data passed on at once
_MOST_QUESTION = 1 << 20  # bytes of a request to rerun's data; usual requests have some hundred
MOST_CONNECTIONS = 64  # each has a thread; a browser opens six and one for its stream. Further ones are closed at once
_COOKIE = "clutch_hil_token"
# Headers of a response
_FORWARDED_HEADERS = ("Content-Type", "Content-Encoding", "Content-Length", "rerun-final-length")
# Headers of a request to rerun's data
_ASKED_HEADERS = ("Content-Type", "Accept", "X-Grpc-Web", "X-User-Agent", "Grpc-Timeout")
_REMOTE_LINKS = re.compile(rb'<link[^>]*"https://[^>]*>|<script[^>]*"https://[^>]*></script>')
# A software renderer blocks the browser's only thread for a second in each frame; a pause [ms] lets it receive messages.
_PAUSE_SCRIPT = (
    b"<head><script>{const frame = window.requestAnimationFrame.bind(window);"
    b"window.requestAnimationFrame = (draw) => setTimeout(() => frame(draw), 300)}</script>"
)
_POLICY = "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob: data:; connect-src 'self'"


class _Server(ThreadingHTTPServer):
    """A thread for each of at most `MOST_CONNECTIONS`. A peer that leaves or sends nonsense is not reported."""

    daemon_threads = True

    def __init__(self, place: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        self._free = threading.BoundedSemaphore(MOST_CONNECTIONS)
        self.streams: dict[socket.socket, socket.socket] = {}  # streams of rerun's data, by the browser's connection
        super().__init__(place, handler)

    def service_actions(self) -> None:
        """End the streams of browsers that have left: without new rows, no write would fail and show it."""
        for browser, stream in list(self.streams.items()):
            if _has_left(browser):
                with suppress(OSError):  # it ends by itself
                    stream.shutdown(socket.SHUT_RDWR)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Start a thread for a connection, or close it if there are too many. See `ThreadingMixIn`."""
        if not self._free.acquire(blocking=False):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except BaseException:  # no thread can be started
            self._free.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection. See `ThreadingMixIn`."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: object, client_address: object) -> None:
        """Report nothing; the connection is closed."""


def _has_left(peer: socket.socket) -> bool:
    """Return whether a peer has closed its connection."""
    try:
        (waits := select.poll()).register(peer, select.POLLIN)  # receiving would block: the connection has a timeout
        return bool(waits.poll(0)) and peer.recv(1, socket.MSG_PEEK) == b""
    except (OSError, ValueError):
        return True


class ViewerPage:
    """Serve the page of the viewer's server at port `inner` on `address` and `port`; its data are at port `data` of loopback.

    pauses: wait between two frames. token: required from a browser; None on loopback only, where the page connects to `data`.
    Use as a context manager. Raises InputError where another program uses `port`.
    """

    def __init__(
        self, port: int, inner: int, data: int, pauses: bool = False, address: str = LOOPBACK, token: str | None = None
    ) -> None:
        policy = _POLICY if token else f"{_POLICY} http://{LOOPBACK}:{data}"

        class Handler(BaseHTTPRequestHandler):
            timeout = _TIMEOUT  # s; of http.server: a silent peer must not hold a thread for ever

            def do_GET(self) -> None:
                if not self._check_token():
                    return
                path = self.path.partition("?")[0]
                is_page = path in ("/", "/index.html")
                encoding = "identity" if is_page else self.headers.get("Accept-Encoding", "identity")
                upstream = HTTPConnection(LOOPBACK, inner, timeout=_TIMEOUT)
                try:
                    upstream.request("GET", path, headers={"Accept-Encoding": encoding})
                    answer = upstream.getresponse()
                    body = answer.read()
                    if is_page:
                        body = _REMOTE_LINKS.sub(b"", body)
                        body = body.replace(b"<head>", _PAUSE_SCRIPT, 1) if pauses else body
                    self._send_head(answer, len(body))
                    self.wfile.write(body)
                except OSError:  # the browser has left, or the viewer has ended
                    self.close_connection = True
                finally:
                    upstream.close()

            def do_POST(self) -> None:
                """Pass a request on to rerun's data, and return the response as it arrives."""
                if not self._check_token():
                    return
                length = self.headers.get("Content-Length", "")
                if token is None or not (length.isdecimal() and int(length) <= _MOST_QUESTION):
                    self._refuse(400)
                    return
                headers = {name: value for name in _ASKED_HEADERS if (value := self.headers.get(name))}
                upstream = HTTPConnection(LOOPBACK, data)  # a stream of rows has no end
                try:
                    upstream.request("POST", self.path, self.rfile.read(int(length)), headers)
                    streams[self.connection] = upstream.sock
                    answer = upstream.getresponse()
                    self._send_head(answer, None)
                    while piece := answer.read1(_PIECE):
                        self.wfile.write(piece)
                except OSError:
                    pass
                finally:
                    self.close_connection = True
                    streams.pop(self.connection, None)
                    upstream.close()

            def _send_head(self, answer: HTTPResponse, length: int | None) -> None:
                """Send status and headers of a response, whose body has `length` bytes, or ends with the connection."""
                self.send_response(answer.status)
                for name in _FORWARDED_HEADERS:
                    own = None if length is None else str(length)
                    if value := own if name == "Content-Length" else answer.getheader(name):
                        self.send_header(name, value)
                self.send_header("Content-Security-Policy", policy)
                self.send_header("Referrer-Policy", "no-referrer")
                if token:
                    self.send_header("Set-Cookie", f"{_COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/")
                self.end_headers()

            def _check_token(self) -> bool:
                """Return whether the browser has the token, in the address or in the cookie; refuse it otherwise."""
                if token is None:
                    return True
                known = parse_qs(self.path.partition("?")[2]).get("token", [])
                try:
                    cookie = SimpleCookie(self.headers.get("Cookie", "")).get(_COOKIE)
                    known += [cookie.value] if cookie else []
                except CookieError:
                    pass
                if any(hmac.compare_digest(one.encode(), token.encode()) for one in known):
                    return True
                self._refuse(403)
                return False

            def _refuse(self, status: int) -> None:
                self.close_connection = True
                self.send_error(status, "use the address with the token that `clutch-hil view` has printed")

            def log_message(self, format: str, *args: object) -> None:
                """Write no log."""

        try:
            self._server = _Server((address, port), Handler)
        except OSError as error:  # the port was free when it was chosen
            raise InputError(
                f"the page cannot be served on port {port} of {address}: {error.strerror}; start it again, or give --web-port"
            ) from None
        streams = self._server.streams
        self._thread = threading.Thread(target=self._server.serve_forever, name="page", daemon=True)

    def __enter__(self) -> "ViewerPage":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
