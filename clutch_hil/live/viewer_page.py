"""Viewer page: serves rerun's web viewer on loopback, without requests to the internet.

The original page requests fonts, news and usage statistics from the internet; it works without them. Its links are removed, and
further requests of its program are refused by a content security policy.
"""

import re
import threading
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

_TIMEOUT = 30.0  # s for the 40 MB of the viewer's program to be transferred
_FORWARDED_HEADERS = (
    "Content-Type",
    "Content-Encoding",
    "Content-Length",
    "rerun-final-length",
)  # headers of an answer
_REMOTE_LINKS = re.compile(rb'<link[^>]*"https://[^>]*>|<script[^>]*"https://[^>]*></script>')
# A software renderer blocks the browser's only thread for a second in each frame; a pause [ms] lets it receive messages.
_PAUSE_SCRIPT = (
    b"<head><script>{const frame = window.requestAnimationFrame.bind(window);"
    b"window.requestAnimationFrame = (draw) => setTimeout(() => frame(draw), 300)}</script>"
)
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob: data:; connect-src 'self' http://127.0.0.1:{data}"
)


class ViewerPage:
    """Serves the page of the viewer's server at port `inner` on port `port`; the page may connect to the data at port `data`.

    pauses: wait between two frames. Use as a context manager.
    """

    def __init__(self, port: int, inner: int, data: int, pauses: bool = False) -> None:
        policy = _POLICY.format(data=data)

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                upstream = HTTPConnection("127.0.0.1", inner, timeout=_TIMEOUT)
                try:
                    path = self.path.partition("?")[0]
                    is_page = path in ("/", "/index.html")
                    encoding = "identity" if is_page else self.headers.get("Accept-Encoding", "identity")
                    upstream.request("GET", path, headers={"Accept-Encoding": encoding})
                    answer = upstream.getresponse()
                    body = answer.read()
                    if is_page:
                        body = _REMOTE_LINKS.sub(b"", body)
                        body = body.replace(b"<head>", _PAUSE_SCRIPT, 1) if pauses else body
                    self.send_response(answer.status)
                    for name in _FORWARDED_HEADERS:
                        if value := str(len(body)) if name == "Content-Length" else answer.getheader(name):
                            self.send_header(name, value)
                    self.send_header("Content-Security-Policy", policy)
                    self.end_headers()
                    self.wfile.write(body)
                except OSError:  # the browser has left, or the viewer has ended
                    self.close_connection = True
                finally:
                    upstream.close()

            def log_message(self, format: str, *args: object) -> None:
                """Write no log."""

        self._server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, name="page", daemon=True)

    def __enter__(self) -> "ViewerPage":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
