"""Viewer: rerun's viewer as a child process, a window or a server for browsers. It listens on loopback.

Beyond loopback only the page of a server can be reached, with a token (viewer_page.py).

The viewer has a separate home folder, so that it uses no layout of an earlier version and sends no usage statistics.
"""

import json
import os
import re
import secrets
import signal
import socket
import subprocess
import time
import webbrowser
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from importlib.resources import files
from ipaddress import IPv4Address
from pathlib import Path
from urllib.parse import urlencode

from clutch_hil.live.viewer.graphics import MISSING, NO_DRIVER, has_vulkan
from clutch_hil.live.viewer.viewer_page import LOOPBACK, ViewerPage
from protocols.errors import InputError
from protocols.realtime.child import spawn
from protocols.realtime.shared_folder import SharedFolder

DATA_PORT = 9876  # rerun's default, for a stream
PAGE_PORT = 9090  # rerun's default, for a browser
_LAST_PORT = 65535  # of TCP: 16 bits
_START_TIMEOUT = 30.0  # s for the process to listen, after a cold start from disk
_POLL_PERIOD = 0.05  # s between checks
_WINDOW_MEMORY = "1GB"  # of rows in the window's process: 25 minutes at 1 kHz and 60 signals; it needs 450 MB more
_PAGE_MEMORY = "256MB"  # of rows for browsers that join late: some minutes, which also have to be loaded first
_SERVER_MEMORY = "64MiB"  # of rows that wait for the window's process, which stores them itself
_WINDOW_SIZE = "1600x900"  # points
_TOKEN_BYTES = 32  # random bytes: 256 bits cannot be guessed
_PAGE_PERIOD = 0.1  # s between two sends to a browser with a graphics card
_SLOW_PAGE_PERIOD = 2.0  # s; a browser without one draws once a second

Say = Callable[[str], None]


class Viewer:
    """A viewer process. Use as a context manager: leaving it ends the process, even a stopped one.

    period [s]: between two sends. light: whether it is too slow for more than a light screen.
    """

    light = False
    _headless = False
    period = 0.05  # s between two sends: a window shows rows 40 ms later

    def __init__(self, port: int | None, memory: str | None, headless: bool = False) -> None:
        """Choose the port; None takes the default or a free one. `memory` is rerun's notation. Raises InputError."""
        if not (headless or _has_display()):
            raise InputError(
                "the viewer has no display: use --web, --save FILE.rrd or the command `clutch-hil monitor`"
            )
        self._port = _free_port(port, DATA_PORT)
        self._arguments = ["--port", str(self._port), "--window-size", _WINDOW_SIZE, "--hide-welcome-screen"]
        self._arguments += [
            "--memory-limit",
            _check_memory(memory or _WINDOW_MEMORY),
            "--server-memory-limit",
            _SERVER_MEMORY,
        ]
        self._headless = headless
        self._arguments += ["--headless", "--renderer", "vulkan"] if headless else []

    @property
    def url(self) -> str:
        """Return the address for a stream."""
        return f"rerun+http://127.0.0.1:{self._port}/proxy"

    @property
    def pid(self) -> int:
        """Return the process number."""
        return self._process.pid

    def __enter__(self) -> "Viewer":
        if self._headless and not has_vulkan():
            raise InputError(MISSING)
        with ExitStack() as stack:
            shared = SharedFolder()
            stack.callback(shared.remove)
            self._home = shared.path
            self._start(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def announce(self, say: Say) -> None:
        """Print the address of the viewer by `say`, where a person must open it."""

    def find_exit_reason(self) -> str | None:
        """Return why the process has ended; None while it runs; empty when a person closed its window."""
        code = self._process.poll()
        if code is None or code == 0:
            return None if code is None else ""
        if code < 0:
            return f"the viewer was killed by {signal.Signals(-code).name}"
        output = (self._home / "log").read_text(errors="replace")
        if NO_DRIVER in output:
            return MISSING
        lines = output.strip().splitlines() or ["no message"]
        return f"the viewer ended with exit code {code}: {lines[-1]}"

    def _start(self, stack: ExitStack) -> None:
        """Start the process, which `stack` ends. Raises InputError when it does not listen."""
        self._process = self._spawn()
        stack.callback(self._end)
        deadline = time.monotonic() + _START_TIMEOUT
        while not all(map(_is_listening, self._ports)):
            if (reason := self.find_exit_reason()) is not None or time.monotonic() > deadline:
                raise InputError(
                    reason or f"the viewer did not listen on port {self._port} within {_START_TIMEOUT:g} s"
                )
            time.sleep(_POLL_PERIOD)

    def _end(self) -> None:
        self._process.kill()  # it holds nothing worth saving, and SIGTERM does not end a stopped process
        self._process.wait()

    @property
    def _ports(self) -> tuple[int, ...]:
        """Return the ports that the process listens on."""
        return (self._port,)

    def _spawn(self) -> "subprocess.Popen[bytes]":
        config, data = self._home / "config", self._home / "data"
        (config / "rerun").mkdir(parents=True)
        statistics = {
            "analytics_enabled": False,
            "analytics_id": "",
            "metadata": {},
            "config_file_path": str(config / "rerun" / "analytics.json"),
            "data_dir_path": str(data / "rerun" / "analytics"),
        }
        (config / "rerun" / "analytics.json").write_text(json.dumps(statistics), encoding="utf-8")
        temporary = self._home / "tmp"
        temporary.mkdir()
        environment = {"XDG_CONFIG_HOME": str(config), "XDG_DATA_HOME": str(data), "TMPDIR": str(temporary)}
        environment |= {"RUST_LOG": "warn", "NO_COLOR": "1"}
        command = [str(files("rerun_cli") / "rerun"), "--bind", "127.0.0.1", *self._arguments]
        with (self._home / "log").open("w") as log:
            # not ended by Ctrl-C: rows on their way still arrive
            return spawn(command, log, os.environ | environment, signal.SIGKILL)


class WebViewer(Viewer):
    """A server that stores the newest rows for browsers, and the page that shows them; both work without a network."""

    def __init__(
        self, port: int | None, page_port: int | None, memory: str | None, browser: bool, address: str = LOOPBACK
    ) -> None:
        """Choose the ports; None takes the default or a free one. `memory` is rerun's notation. Raises InputError.

        browser: open one. address: of this machine, where the page is served; other than 127.0.0.1 with a new token.
        """
        self._browser = browser
        self._address = _check_address(address)
        self._token = None if address == LOOPBACK else secrets.token_urlsafe(_TOKEN_BYTES)
        self.light = not list(Path("/dev/dri").glob("renderD*"))  # no graphics card
        self.period = _SLOW_PAGE_PERIOD if self.light else _PAGE_PERIOD
        self._port = _free_port(port, DATA_PORT)
        self._page_port = _free_port(page_port, PAGE_PORT, but=(self._port,), address=address)
        self._inner = _free_port(None, 0, but=(self._port, self._page_port))
        self._arguments = ["--serve-web", "--port", str(self._port), "--web-viewer-port", str(self._inner)]
        self._arguments += ["--server-memory-limit", _check_memory(memory or _PAGE_MEMORY)]

    @property
    def page(self) -> str:
        """Return the address for a browser."""
        # `persist`: ignore the layout that the browser has stored; `theme`: that of the pictures
        query = {"url": self.url, "persist": "false", "theme": "dark", "hide_welcome_screen": ""}
        place = f"{self._address}:{self._page_port}"
        if self._token:
            query |= {"url": f"rerun+http://{place}/proxy", "token": self._token}
        return f"http://{place}/?{urlencode(query)}"

    @property
    def _ports(self) -> tuple[int, ...]:
        return self._port, self._inner

    def _start(self, stack: ExitStack) -> None:
        super()._start(stack)
        stack.enter_context(
            ViewerPage(self._page_port, self._inner, self._port, self.light, self._address, self._token)
        )

    def announce(self, say: Say) -> None:
        """Print the address of the page, and open it where there is a display."""
        say(f"open {self.page}")
        if self._token:
            say(
                "everyone with this address can watch; the connection is not encrypted: outside a trusted network use ssh -L"
            )
        if self.light:
            say(f"no graphics card: the page has the most important plots, every {self.period:g} s")
        if self._browser and _has_display() and not webbrowser.open(self.page):
            say("no browser was found on this machine to open it")


def _has_display() -> bool:
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _check_memory(memory: str) -> str:
    """Return `memory` if it has rerun's notation. Raises InputError."""
    if not re.fullmatch(r"[1-9]\d*(MB|GB|MiB|GiB|%)", memory):
        raise InputError(f"memory {memory!r} is not possible; allowed are for example 500MB, 2GB and 25%")
    return memory


def _check_address(address: str) -> str:
    """Return `address` if it is an IPv4 address of this machine that a browser can use. Raises InputError."""
    try:
        if IPv4Address(address).is_unspecified:
            raise ValueError
        with socket.socket() as probe:
            probe.bind((address, 0))
    except (ValueError, OSError):
        raise InputError(
            f"the page cannot be served at {address[:60]!r}; allowed is an IPv4 address of this machine, such as 192.168.1.5"
        ) from None
    return address


def _free_port(wanted: int | None, default: int, but: Sequence[int] = (), address: str = LOOPBACK) -> int:
    """Return the port `wanted`; for None the `default`, or a free one if that is in use; none of `but`. Raises InputError."""
    if wanted is not None and not 0 < wanted <= _LAST_PORT:
        raise InputError(
            f"port {wanted} is not possible; allowed is 1 to {_LAST_PORT}, or leave it out to use a free one"
        )
    why = "in use"
    for port in [wanted] if wanted is not None else [default, 0]:
        try:
            with socket.socket() as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((address, port))
                if (free := probe.getsockname()[1]) not in but:
                    return free
        except PermissionError:
            why = "only for root"
        except OSError:
            why = "in use"
    raise InputError(f"port {wanted} on {address} is {why}; leave it out to use a free one")


def _is_listening(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(_POLL_PERIOD)
        return probe.connect_ex(("127.0.0.1", port)) == 0
