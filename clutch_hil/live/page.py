"""Page: rerun's web viewer, served on loopback without what would make the browser ask anybody else.

The page as it is asks for fonts, news and usage statistics on the internet; it works without them. What it names is taken
out, what its program would ask for is refused by a policy.
"""

import re
import threading
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

_TIMEOUT = 30.0  # s for the viewer's 40 MB of program to be handed over
_PASSED = ("Content-Type", "Content-Encoding", "Content-Length", "rerun-final-length")  # headers of an answer
_ELSEWHERE = re.compile(rb'<link[^>]*"https://[^>]*>|<script[^>]*"https://[^>]*></script>')
# A software renderer keeps the browser's only thread waiting a second in each frame; a pause [ms] lets messages come in.
_PAUSE = (
    b"<head><script>{const frame = window.requestAnimationFrame.bind(window);"
    b"window.requestAnimationFrame = (draw) => setTimeout(() => frame(draw), 300)}</script>"
)
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob: data:; connect-src 'self' http://127.0.0.1:{data}"
)


class Page:
    """Serves what the viewer's server at port `inner` has, at port `port`; the page may also reach the data at port `data`.

    With `pauses` the page rests between two frames. Use as a context manager.
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
                        body = _ELSEWHERE.sub(b"", body)
                        body = body.replace(b"<head>", _PAUSE, 1) if pauses else body
                    self.send_response(answer.status)
                    for name in _PASSED:
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
                """Say nothing."""

        self._server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, name="page", daemon=True)

    def __enter__(self) -> "Page":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
