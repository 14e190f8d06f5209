"""ChildReader: reads a file in a separate process, with limits of time and memory.

For C libraries that can crash, or never return, on a damaged file: HDF5 does both (version 2.0, files with a few changed bytes:
a double free, an endless loop). Starting the process takes about 0.3 s. It ends when the reader is no longer used.
"""

import os
import resource
import signal
import subprocess
import sys
import weakref
from contextlib import suppress
from importlib import import_module
from typing import IO, Any

from protocols.errors import InputError
from protocols.files.plain_values import read_value, write_value

MOST_SECONDS = 10  # s of CPU time to open and read one file
_MOST_BYTES = 2 << 30  # bytes of the process, including 0.2 GB for libraries; the values have separate limits


class ChildReader:
    """Sends questions to a function in the child process.

    name: of the file, for messages. server: `module:function`; it is called there with `arguments`, opens the file and returns
    the function that answers each question. Questions and answers are plain values (plain_values.py), so that a library
    compromised by a damaged file cannot run code in this process. most_seconds: total CPU time.
    """

    def __init__(self, name: str, server: str, *arguments: str, most_seconds: int = MOST_SECONDS) -> None:
        self._name, self._most_seconds = name, most_seconds
        paths = os.pathsep.join(os.path.abspath(entry) for entry in sys.path)
        self.process = subprocess.Popen(
            [sys.executable, "-m", __name__, name, str(most_seconds), server, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"},
        )
        weakref.finalize(self, _end, self.process)

    def ask(self, question: Any = None) -> Any:
        """Return the answer to a question. Raises InputError if the file is refused, or the process has ended."""
        stdin, stdout = self.process.stdin, self.process.stdout
        assert stdin is not None
        assert stdout is not None
        with suppress(OSError):  # it has ended: reported below
            write_value(question, stdin)
        try:
            refusal, answer = read_value(stdout)
        except (EOFError, ValueError, TypeError):
            code = self.process.wait()
            raise InputError(
                f"{self._name} is damaged, or too large: the library that reads it ended ({self._describe_end(code)})"
            ) from None
        if refusal is not None:
            raise InputError(str(refusal))
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


def _serve(name: str, server: str, arguments: list[str], questions: IO[bytes], answers: IO[bytes]) -> None:
    """Open a file and answer questions until the pipe is closed."""
    answer_of = None
    while True:
        try:
            question = read_value(questions)
        except EOFError:
            return
        answer, refusal = None, None
        try:
            if answer_of is None:
                module, function = server.split(":")
                answer_of = getattr(import_module(module), function)(*arguments)
            answer = answer_of(question)
        except InputError as error:
            refusal = str(error)
        except MemoryError:
            refusal = f"{name} needs more than {_MOST_BYTES / (1 << 30):g} GiB of memory"
        write_value([refusal, answer], answers)
        if answer_of is None:
            return


def main() -> None:
    """Run the child process."""
    name, most_seconds, server, *arguments = sys.argv[1:]
    resource.setrlimit(resource.RLIMIT_CPU, (int(most_seconds), int(most_seconds) + 1))
    resource.setrlimit(resource.RLIMIT_DATA, (_MOST_BYTES, _MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries must not go into the answers
    _serve(name, server, arguments, sys.stdin.buffer, answers)


if __name__ == "__main__":
    main()
