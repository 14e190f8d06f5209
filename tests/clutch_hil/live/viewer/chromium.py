"""Chromium without a screen, driven over its debugging protocol: enough to open a page and take a picture of it.

The protocol is JSON over a WebSocket (RFC 6455); the few lines of it we need save a dependency.
"""

import base64
import ctypes
import json
import os
import shutil
import signal
import socket
import struct
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

PROGRAM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
_START = 30.0  # s for the browser to come up
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_ANSWER = 60.0  # s for an answer: a software renderer on two busy cores takes its time for a picture
_FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--hide-scrollbars", "--remote-debugging-port=0",
)  # fmt: skip


def _die_with_parent() -> None:
    """In the child: SIGKILL when the test dies; its own children follow it."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


class Chromium:
    """A browser with one page of `width` x `height` pixels. Use as a context manager."""

    def __init__(self, width: int = 1600, height: int = 900) -> None:
        self._asked: dict[str, str] = {}  # by the request's number
        self._size = width, height
        self._calls = 0

    def __enter__(self) -> "Chromium":
        assert PROGRAM
        self._folder = Path(tempfile.mkdtemp(prefix="chromium-"))
        width, height = self._size
        self._process = subprocess.Popen(
            [PROGRAM, *_FLAGS, f"--window-size={width},{height}", f"--user-data-dir={self._folder}", "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=_die_with_parent,
        )
        try:
            self._socket = _WebSocket(self._find_page_address())
            self.call("Page.enable")
            self.call("Network.enable")
            self.call(
                "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
            )
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)

    @property
    def requests(self) -> set[str]:
        """Addresses that the page has asked for and that its policy has let through."""
        self.call("Page.enable")  # any call takes the notes that wait
        return set(self._asked.values())

    def open(self, url: str) -> None:
        """Go to a page and wait until it is loaded."""
        self.call("Page.navigate", url=url)
        while self._receive().get("method") != "Page.loadEventFired":
            pass

    def take_picture(self) -> bytes:
        """A PNG of the page."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the debugging protocol and return its result."""
        self._calls += 1
        self._socket.send(json.dumps({"id": self._calls, "method": method, "params": parameters}))
        while (answer := self._receive()).get("id") != self._calls:
            pass
        assert "error" not in answer, answer
        return dict(answer["result"])

    def _receive(self) -> dict[str, Any]:
        """The next answer or event; take note of what the page asks for."""
        message: dict[str, Any] = json.loads(self._socket.receive())
        method, parameters = message.get("method"), message.get("params", {})
        if method == "Network.requestWillBeSent":
            self._asked[parameters["requestId"]] = parameters["request"]["url"]
        elif method == "Network.loadingFailed" and parameters.get("blockedReason") == "csp":
            self._asked.pop(parameters["requestId"], None)
        return message

    def _find_page_address(self) -> str:
        deadline = time.monotonic() + _START
        port_file = self._folder / "DevToolsActivePort"
        while time.monotonic() < deadline:
            if port_file.exists() and len(lines := port_file.read_text().splitlines()) == 2:
                with urllib.request.urlopen(f"http://127.0.0.1:{lines[0]}/json/list", timeout=_START) as answer:
                    pages = [entry for entry in json.load(answer) if entry["type"] == "page"]
                if pages:
                    return str(pages[0]["webSocketDebuggerUrl"])
            time.sleep(0.1)
        raise TimeoutError("chromium did not come up")


class _WebSocket:
    """The client's side of a WebSocket on this machine: text messages of any length."""

    def __init__(self, address: str) -> None:
        host, path = address.removeprefix("ws://").split("/", 1)
        name, port = host.split(":")
        self._socket = socket.create_connection((name, int(port)), timeout=_ANSWER)
        key = base64.b64encode(os.urandom(16)).decode()
        self._socket.sendall(
            f"GET /{path} HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        self._stream = self._socket.makefile("rb")
        assert b" 101 " in self._stream.readline()
        while self._stream.readline().strip():
            pass

    def send(self, text: str) -> None:
        data, mask = text.encode(), os.urandom(4)
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(data))
        length = bytes([0x80 | len(data)]) if len(data) < 126 else struct.pack("!BH", 0x80 | 126, len(data))
        self._socket.sendall(b"\x81" + length + mask + masked)

    def receive(self) -> str:
        data = b""
        while True:
            first, length = self._stream.read(2)
            if length > 125:
                size = 2 if length == 126 else 8
                length = int.from_bytes(self._stream.read(size), "big")
            part = self._stream.read(length)
            if first & 0x0F in (0, 1):  # continuation, text
                data += part
                if first & 0x80:
                    return data.decode()
