"""`clutch-hil`: the command. Its sub-commands are found by entry point (`clutch_hil.commands`).

Exit codes: 0 fine, 1 the verdict is bad, 2 the input or the command is wrong, or stdout cannot be written, 130 interrupted
before there was a result, 141 the reader of stdout has ended.
"""

import contextlib
import errno
import io
import json
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint, version
from math import isfinite
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn, cast

import typer
import typer.core

from clutch_hil.usage_error import describe_usage_error, find_empty_word
from protocols.entry_points import comes_with_bench, find_package, list_points, load_point
from protocols.errors import InputError, InterruptionError
from protocols.files.output_file import whole_file
from protocols.kernels.kernel_cache import describe_keeping, discard_temporary
from protocols.kernels.progress_notice import PROGRESS_NOTICE, is_starting
from protocols.moved_modules import describe_moves
from protocols.realtime.stopping import list_heeded_signals
from protocols.user_code import describe_error, find_user_line

_REPEAT_INTERVAL = 0.2  # s between interruptions of code that loads or compiles, until one takes effect
_LAST_STREAM = 2  # number of the standard error
INTERRUPTED = 130  # 128 + SIGINT, as in every shell
UNREAD = 141  # 128 + SIGPIPE, as in every shell: the other end of a pipe, such as `head`, has ended
# Hz. Below, a period of the 10 Hz pressure loop has fewer than five samples; above, a plant step is one integration step
RATES = (50, 10_000)


def end_with_verdict(text: str, good: bool = True) -> None:
    """Print the verdict line; end with exit code 1 if it is bad."""
    typer.echo(f"verdict: {text}")
    if not good:
        raise typer.Exit(1)


def emit(document: Any) -> None:
    """Print a document as JSON (`--json`)."""
    typer.echo(format_json(document, indent=2))


def format_json(document: Any, indent: int | None = None) -> str:
    """Return a document as JSON text. JSON has neither NaN nor infinity: both become null."""
    return json.dumps(_replace_infinite(document), indent=indent, allow_nan=False)


def _replace_infinite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _replace_infinite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_replace_infinite(item) for item in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def report(document: Any, text: str, verdict_text: str, good: bool, as_json: bool) -> None:
    """End a command: print the document as JSON, or text and verdict line; exit code 1 if not `good`.

    The verdict line is added to a document without an entry `verdict`; a list is not changed.
    """
    if as_json:
        emit({**document, "verdict": document.get("verdict", verdict_text)} if isinstance(document, dict) else document)
        if not good:
            raise typer.Exit(1)
    else:
        typer.echo(text)
        end_with_verdict(verdict_text, good)


def check_rate(rate: int) -> int:
    """Return `rate` [Hz] if a loop can run at it. Raises InputError."""
    low, high = RATES
    if not low <= rate <= high or 1_000_000_000 % rate:
        possible = [one for one in range(low, high + 1) if 1_000_000_000 % one == 0]
        nearest = sorted(
            {
                max((one for one in possible if one < rate), default=low),
                min((one for one in possible if one > rate), default=high),
            }
        )
        raise InputError(
            f"rate {rate} Hz is not possible; allowed are {low} to {high} Hz with a period of whole ns, such as"
            f" {' and '.join(map(str, nearest))}"
        )
    return rate


def write_summary(path: Path | None, document: Any) -> None:
    """Write the JSON summary of a service for the process that started it. Raises InputError.

    No folder is created: if that process was killed and its folder removed, nobody reads the summary.
    """
    if path:
        if not path.parent.is_dir():
            raise InputError(f"summary {path} cannot be written: its folder does not exist")
        with whole_file(path) as part:
            part.write_text(format_json(document), encoding="utf-8")


class _Output(io.TextIOWrapper):
    """Standard output. A failed write is an InputError: an exit code of 0 or 1 would stand for a verdict that nobody saw."""

    _failed = False

    def write(self, text: str) -> int:
        """See `TextIOBase`."""
        return self._attempt(super().write, text) or 0

    def flush(self) -> None:
        """See `TextIOBase`."""
        self._attempt(super().flush)

    def _attempt(self, method: Callable[..., Any], *arguments: Any) -> Any:
        if self._failed:  # already reported; Python flushes once more at its end
            return None
        try:
            return method(*arguments)
        except BrokenPipeError:
            self._failed = True
            sys.exit(UNREAD)
        except OSError as error:
            self._failed = True
            raise InputError(f"standard output cannot be written: {error.strerror}") from None


class _ClosedStream(io.RawIOBase):
    """Standard output of a process that was given none. It refuses all writes, like that of any program."""

    def writable(self) -> bool:
        """See `IOBase`."""
        return True

    def write(self, data: object) -> int:
        """See `RawIOBase`."""
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))


class _Messages(io.TextIOWrapper):
    """Standard error. A failed write does not affect the command."""

    def write(self, text: str) -> int:
        """See `TextIOBase`."""
        with contextlib.suppress(OSError):
            return super().write(text)
        return 0

    def flush(self) -> None:
        """See `TextIOBase`."""
        with contextlib.suppress(OSError):
            super().flush()


def _fill_streams() -> None:
    """Open /dev/null in place of each standard stream that this process was not given.

    Otherwise the next opened file or bus would get its number, and messages of libraries would be written to that.
    """
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= _LAST_STREAM:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)


def _guard_streams() -> None:
    """Replace `sys.stdout` and `sys.stderr` by an `_Output` and `_Messages`, if they are the process's own or missing.

    A character that the terminal's encoding lacks is written as an escape sequence.
    """
    out, messages = sys.stdout, sys.stderr
    if out is None:
        sys.stdout = _Output(io.BufferedWriter(_ClosedStream()), "utf-8", line_buffering=True)
    if out is sys.__stdout__ and isinstance(out, io.TextIOWrapper):
        sys.stdout = _Output(out.buffer, out.encoding, "backslashreplace", line_buffering=out.line_buffering)
    if messages is sys.__stderr__ and isinstance(messages, io.TextIOWrapper):
        sys.stderr = _Messages(messages.buffer, messages.encoding, messages.errors, line_buffering=True)


def _check_current_folder() -> None:
    """Raise InputError where the current folder was removed: libraries request it while they are loaded."""
    try:
        os.getcwd()
    except OSError as error:
        raise InputError(f"the current folder cannot be used: {error.strerror}; change to one that exists") from None


class _EndRequestedError(KeyboardInterrupt):
    """Raised when Ctrl-C, SIGTERM or SIGHUP has requested the end of the command.

    It is a subclass, because Python kills itself by SIGINT at its end if a KeyboardInterrupt has left code that `exec` runs,
    even where it was caught. Dataclasses run such code.
    """


def _report_unraisable(error: "sys.UnraisableHookArgs") -> None:
    """Report an exception that Python drops, as in a destructor or callback; an interruption is repeated, and not reported."""
    if not isinstance(error.exc_value, _EndRequestedError):
        sys.__unraisablehook__(error)


_UsageError = cast("type[Exception]", typer.BadParameter.__base__)  # not exported by typer


class _OneSentence:
    """Mix-in for a command of typer: wrong options and arguments raise an InputError of one sentence.

    An empty word is refused as well: it is never a name, a file or a number.
    """

    def make_context(self, info_name: str | None, args: list[str], *positional: Any, **extra: Any) -> Any:
        """See typer: read the options of this command."""
        if bad := find_empty_word((info_name or "clutch-hil", *args)):
            raise InputError(f"{bad} is empty; give a value, or leave it out")
        with _usage_errors_as_sentences(lambda: info_name or "clutch-hil"):
            return super().make_context(info_name, args, *positional, **extra)  # type: ignore[misc]

    def invoke(self, ctx: Any) -> Any:
        """See typer: run this command; for a group, also read the options of its sub-command."""
        with _usage_errors_as_sentences(lambda: " ".join(filter(None, (ctx.command_path, ctx.invoked_subcommand)))):
            return super().invoke(ctx)  # type: ignore[misc]


class Command(_OneSentence, typer.core.TyperCommand):
    """A command without sub-commands."""


class Commands(_OneSentence, typer.core.TyperGroup):
    """A command with sub-commands."""


@contextmanager
def _usage_errors_as_sentences(find_command: Callable[[], str]) -> Iterator[None]:
    try:
        yield
    except _UsageError as error:
        raise InputError(describe_usage_error(error, find_command())) from None


def make_application() -> typer.Typer:
    """Return the command with the sub-commands of every installed part; unusable parts are left out and reported on stderr."""
    app = typer.Typer(
        cls=Commands,
        help="Hardware-in-the-loop bench for wet-clutch torque control over CAN.",
        add_completion=False,
        pretty_exceptions_enable=False,
    )

    @app.callback(invoke_without_command=True)
    def show_help(
        ctx: typer.Context, show_version: bool = typer.Option(False, "--version", help="Print the version.")
    ) -> None:
        if show_version:
            typer.echo(f"clutch-hil {version('clutch-hil')}")
            raise typer.Exit
        if ctx.invoked_subcommand is None:
            typer.echo(ctx.get_help())
            raise typer.Exit(2)

    offered: dict[str, EntryPoint] = {}
    for point in list_points("clutch_hil.commands"):
        try:
            part = _load_commands(point, offered)
        except InputError as error:
            with contextlib.suppress(OSError):
                typer.echo(f"warning: {error}; it is left out", err=True)
            continue
        app.registered_commands += part.registered_commands
        app.registered_groups += part.registered_groups
    return app


def _load_commands(point: EntryPoint, offered: dict[str, EntryPoint]) -> typer.Typer:
    """Return the commands that an entry point registers; add them to `offered`, by name. Raises InputError."""
    module, part = load_point(point, f"command {point.name}"), typer.Typer()
    if not callable(register := getattr(module, "register", None)):
        raise InputError(f"{_describe_place(point)} has no function register(app)")
    try:
        register(part)
        names = _list_names(part, comes_with_bench(point))
    except (Exception, SystemExit) as error:  # a user's package may raise anything
        raise InputError(f"{_describe_place(point)} cannot be registered: {describe_error(error)}") from None
    for name in names:
        if name in offered:
            raise InputError(
                f"{_describe_place(point)} registers {name!r}, which the package {find_package(offered[name])} has as"
                f" well, by {offered[name].value}; allowed are other names"
            )
    offered.update(dict.fromkeys(names, point))
    return part


def _list_names(part: typer.Typer, ours: bool) -> list[str]:
    """Return the names of the commands of `part`; if they are not `ours`, let typer build them, to detect errors in them."""
    if not ours:  # building ours would add a tenth of a second to every command
        return list(typer.main.get_group(part).commands)
    return [
        one.name or typer.main.get_command_name(cast("Any", one.callback).__name__) for one in part.registered_commands
    ]


def _describe_place(point: EntryPoint) -> str:
    return f"command {point.name} of {point.value} of the package {find_package(point)}"


def main() -> None:
    """Run `clutch-hil`."""
    run_main(make_application())


def run_command(function: Callable[..., None]) -> None:
    """Run a function with typer's parameters as a command without sub-commands: `python -m MODULE`."""
    run_main(make_command(function))


def make_command(function: Callable[..., None]) -> typer.Typer:
    """Make the command of a function with typer's parameters."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command(cls=Command)(function)
    return app


def run_main(run: Callable[[], object]) -> None:
    """Run a command; an InputError becomes one sentence and exit code 2, Ctrl-C, SIGTERM or SIGHUP one and 130."""
    end_requested = during_start = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal end_requested, during_start
        end_requested, during_start = True, is_starting(frame)
        signal.setitimer(signal.ITIMER_REAL, _REPEAT_INTERVAL, _REPEAT_INTERVAL)
        raise _EndRequestedError

    def insist(number: int, frame: FrameType | None) -> None:
        """Interrupt again: Python drops an exception in a destructor, and compilers have destructors."""
        nonlocal during_start
        if is_starting(frame):
            during_start = True
            raise _EndRequestedError
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    _fill_streams()
    _guard_streams()
    sys.unraisablehook = _report_unraisable
    signal.signal(signal.SIGALRM, insist)
    heeded = list_heeded_signals()
    for number in heeded:
        signal.signal(number, interrupt)
    try:
        _check_current_folder()
        with PROGRESS_NOTICE:
            try:
                run()
            finally:
                if sys.stdout:  # None where the process was given none
                    sys.stdout.flush()
    except InputError as error:
        if during_start:  # compiling or loading code may turn _EndRequestedError into an apparent input error
            _break_off()
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except InterruptionError as interruption:
        print(f"interrupted: {interruption}", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except BaseException as error:  # a compiler or a library may turn _EndRequestedError into another exception
        if end_requested:
            _break_off()
        if not (isinstance(error, Exception) and (find_user_line(error) or describe_moves(error))):
            raise
        print(f"error: {InputError(describe_error(error))}", file=sys.stderr)
        sys.exit(2)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number in heeded:
            if number != signal.SIGINT:
                signal.signal(number, signal.SIG_DFL)


def _break_off() -> NoReturn:
    """End the process at once, after all `with` blocks: the interpreter cannot clean up an unfinished action of a library."""
    signal.signal(signal.SIGALRM, signal.SIG_IGN)  # the interruption has taken effect
    print(f"interrupted: nothing half-written is left, {describe_keeping()}", file=sys.stderr)
    discard_temporary()
    for stream in filter(None, (sys.stdout, sys.stderr)):
        with contextlib.suppress(InputError, SystemExit):  # of a full disk: the interruption is reported instead
            stream.flush()
    os._exit(INTERRUPTED)
