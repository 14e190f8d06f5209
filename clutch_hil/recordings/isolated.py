"""IsolatedRecording: a file that is read in a process of its own, with limits of time and memory.

For libraries in C that can end the process, or never return, on a damaged file: HDF5 does both (version 2.0, files with a few
changed bytes: a double free, an endless loop). The process costs about a second. It ends when the recording is no longer used.
"""

import os
import pickle
import resource
import signal
import subprocess
import sys
import weakref
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import IO, Any

from clutch_hil.recordings.channel import Channel, Recording, Signal
from protocols.errors import InputError

_MOST_SECONDS = 10  # of computing for one file, opened and read
_MOST_BYTES = 2 << 30  # of the process, with the libraries' own 0.2 GB; the values themselves have bounds of their own


class IsolatedRecording:
    """See Recording. opener: what opens the file in the other process, a function of its path, as `module:function`.

    most_seconds: of computing, for opening and reading together.
    """

    def __init__(self, path: Path, opener: str, most_seconds: int = _MOST_SECONDS) -> None:
        self._path, self._most_seconds = path, most_seconds
        paths = os.pathsep.join(os.path.abspath(entry) for entry in sys.path)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "clutch_hil.recordings.isolated", str(path), opener, str(most_seconds)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"},
        )
        weakref.finalize(self, _end, self._process)
        channels, numbers, self.notes, self.start = self._receive()
        self.channels: Sequence[Channel] = channels
        self.numbers: Mapping[str, float] = numbers

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        """See Recording.read."""
        stdin = self._process.stdin
        assert stdin is not None
        try:
            pickle.dump(list(channels), stdin)
            stdin.flush()
        except OSError:
            pass  # it has ended: told below
        signals, notes = self._receive()
        self.notes += [note for note in notes if note not in self.notes]
        return signals

    def _receive(self) -> Any:
        assert self._process.stdout is not None
        try:
            answer = pickle.load(self._process.stdout)
        except (EOFError, pickle.UnpicklingError):
            code = self._process.wait()
            raise InputError(
                f"recording {self._path} is damaged, or too large: the library that reads it ended ({self._describe_end(code)})"
            ) from None
        if isinstance(answer, InputError):
            raise answer
        return answer

    def _describe_end(self, code: int) -> str:
        if code == -signal.SIGXCPU:
            return f"after {self._most_seconds} s of computing"
        return f"signal {-code}" if code < 0 else f"exit code {code}"


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    for pipe in (process.stdin, process.stdout):
        if pipe:
            pipe.close()
    process.wait()


def _serve(path: Path, opener: str, questions: IO[bytes], answers: IO[bytes]) -> None:
    """Open a recording and read what is asked for, until nobody asks any more."""
    recording: Recording | None = None
    while True:
        answer: Any
        try:
            if recording is None:
                module, function = opener.split(":")
                recording = getattr(import_module(module), function)(path)
                answer = (list(recording.channels), dict(recording.numbers), recording.notes, recording.start)
            else:
                answer = (recording.read(pickle.load(questions)), recording.notes)
        except EOFError:
            return
        except InputError as error:
            answer = error
        except MemoryError:
            answer = InputError(f"recording {path} needs more than {_MOST_BYTES / (1 << 30):g} GiB of memory")
        pickle.dump(answer, answers, protocol=5)
        answers.flush()
        if recording is None:
            return


def main() -> None:
    """The other process."""
    path, opener, most_seconds = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    resource.setrlimit(resource.RLIMIT_CPU, (most_seconds, most_seconds + 1))
    resource.setrlimit(resource.RLIMIT_DATA, (_MOST_BYTES, _MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    _serve(path, opener, sys.stdin.buffer, answers)


if __name__ == "__main__":
    main()
