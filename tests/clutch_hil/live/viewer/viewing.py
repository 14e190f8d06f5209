"""`clutch-hil view` as a process of a test, and looks at what a viewer holds."""

import os
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from io import BytesIO
from types import TracebackType
from typing import Any

import matplotlib.image
import numpy as np
import psutil

from protocols.realtime.child import list_command
from tests.processes import list_errors, play_here

PATIENCE = 60.0  # s for a thing to happen that takes a few on a quiet machine
_ANSWER = (
    180.0  # s for a viewer to answer: on two shared cores its software renderer has been seen to keep it for a minute
)
_END = 30.0  # s for a view to end once asked
NO_DISPLAY = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_until(condition: Callable[[], Any], what: str, patience: float = PATIENCE) -> Any:
    """Wait for a condition, for `patience` [s] at most, and return what it gave."""
    deadline = time.monotonic() + patience
    while not (result := condition()):
        assert time.monotonic() < deadline, f"waited {patience:g} s in vain for {what}"
        time.sleep(0.1)
    return result


class View:
    """A running `clutch-hil view ARGUMENTS...`. Use as a context manager: no process is left after it."""

    def __init__(self, *arguments: object) -> None:
        self._said = tempfile.TemporaryFile()  # noqa: SIM115
        self._process = subprocess.Popen(
            list_command("view", *map(str, arguments)),
            env=NO_DISPLAY,
            text=True,
            stdout=subprocess.PIPE,
            stderr=self._said,
        )
        self.output = ""

    def __enter__(self) -> "View":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.running:  # the test has failed
            self._process.terminate()
        self._process.communicate(timeout=_END)
        self._said.close()

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._process.poll() is None

    @property
    def stderr(self) -> str:
        """What it has written to stderr."""
        return os.pread(self._said.fileno(), 1_000_000, 0).decode()

    def find_line(self, start: str) -> str:
        """The first line on stderr that begins with `start`, once it is there."""

        def list_lines() -> list[str]:
            lines = [line for line in self.stderr.splitlines() if line.startswith(start)]
            assert lines or self.running, f"the view ended without a line {start!r}: {self.stderr}"
            return lines

        return str(wait_until(list_lines, f"a line {start!r}")[0])

    def find_viewer(self) -> psutil.Process:
        """Its viewer process."""

        def list_viewers() -> list[psutil.Process]:
            return [child for child in psutil.Process(self._process.pid).children() if "rerun" in child.name()]

        return wait_until(list_viewers, "a viewer process")[0]

    def end(self, number: int | None = signal.SIGTERM) -> int:
        """Ask it to end (None: wait until it does) and return its exit code; all it wrote to stdout is in `output`."""
        children = psutil.Process(self._process.pid).children(recursive=True) if self.running else []
        if number is not None:
            self._process.send_signal(number)
        self.output, _ = self._process.communicate(timeout=_END if number else PATIENCE)
        assert not [child for child in children if child.is_running()], "a process was left"
        return self._process.returncode


def find_refusal(*arguments: object) -> str:
    """The sentence of a view that must end with exit code 2, by its words alone."""
    done = play_here("view", *arguments)
    return _read_refusal(done.returncode, done.stderr)


def find_refusal_of_process(*arguments: object) -> str:
    """The sentence of a view that must end with exit code 2, by what its process finds on the machine."""
    with View(*arguments) as view:
        return _read_refusal(view.end(None), view.stderr)


def _read_refusal(code: int, errors: str) -> str:
    assert code == 2, errors
    (line,) = list_errors(errors)
    assert line.startswith("error: "), errors
    return line


def connect_to_viewer(port: int) -> Any:
    """A connection to the viewer at `port` that answers with its state."""
    from rerun.experimental import ViewerClient

    def connected() -> Any:
        try:
            return ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        except ConnectionError:
            return None

    return wait_until(connected, "the viewer's port")


def read_reply(asked: Callable[[], Any]) -> Any:
    """What a viewer answers; it draws by software here, and may be too busy for that within its client's own deadline."""

    def once() -> tuple[Any] | None:
        try:
            return (asked(),)
        except TimeoutError:
            return None

    return wait_until(once, "an answer of the viewer", _ANSWER)[0]


def make_shown_condition(client: Any, timeline: str) -> Callable[[], Any]:
    """A condition: the viewer shows a recording that has rows on `timeline`; gives the viewer's state."""

    def look() -> Any:
        state = read_reply(client.get_state)
        there = [line for recording in state.recordings for line in recording.timelines if line.name == timeline]
        return state if state.views and any(line.end for line in there) else None

    return look


def find_newest(state: Any, timeline: str) -> int:
    """End of a timeline of the only recording [ns]."""
    (recording,) = state.recordings
    (line,) = (line for line in recording.timelines if line.name == timeline)
    return int(line.end)


def count_colours(png: bytes | Sequence[int]) -> int:
    """Number of different colours in a picture: an empty page or viewer has few."""
    pixels = matplotlib.image.imread(BytesIO(bytes(png)), format="png")
    return len(np.unique((pixels.reshape(-1, pixels.shape[-1])[:, :3] * 255).astype(int), axis=0))
