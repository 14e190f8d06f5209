"""`clutch-hil`: the command. Its sub-commands are found by entry point (`clutch_hil.commands`).

Exit codes: 0 fine, 1 the verdict is bad, 2 the input or the command is wrong, 130 interrupted before there was a result.
"""

import json
import os
import signal
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points, version
from math import isfinite
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import typer
import typer.core

from protocols.errors import InputError, InterruptionError
from protocols.files.output_file import whole_file
from protocols.kernels.kernel_cache import describe_keeping, discard_temporary
from protocols.kernels.progress_notice import PROGRESS_NOTICE, is_starting

_REPEAT_INTERVAL = 0.2  # s between interruptions of code that loads or compiles, until one has reached it
INTERRUPTED = 130  # 128 and SIGINT, as of every shell
# Hz. Below, a period of the 10 Hz pressure loop has fewer than five samples; above, a plant step is one integration step
RATES = (50, 10_000)


def verdict(text: str, good: bool = True) -> None:
    """Print the verdict line; end with exit code 1 if it is bad."""
    typer.echo(f"verdict: {text}")
    if not good:
        raise typer.Exit(1)


def emit(document: Any) -> None:
    """Print a document as JSON (`--json`); NaN and infinite become null."""
    typer.echo(json.dumps(_finite(document), indent=2, allow_nan=False))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def report(document: Any, text: str, verdict_text: str, good: bool, as_json: bool) -> None:
    """End a command: print the document as JSON, or text and verdict line; exit code 1 if not `good`."""
    if as_json:
        emit(document)
        if not good:
            raise typer.Exit(1)
    else:
        typer.echo(text)
        verdict(verdict_text, good)


def check_rate(rate: int) -> int:
    """Return `rate` [Hz] if a loop can run at it. Raises InputError."""
    low, high = RATES
    if not low <= rate <= high or 1_000_000_000 % rate:
        raise InputError(f"rate {rate} Hz is not possible; allowed are {low} to {high} Hz with a whole period in ns")
    return rate


def write_summary(path: Path | None, document: Any) -> None:
    """Write the JSON summary of a service for the process that started it. Raises InputError."""
    if path:
        with whole_file(path) as part:
            part.write_text(json.dumps(document), encoding="utf-8")


class _EndRequestedError(KeyboardInterrupt):
    """Ctrl-C or SIGTERM has asked the command to end.

    It is a subclass, because Python kills itself by SIGINT at its end if a KeyboardInterrupt has left code that `exec` runs,
    even where it was caught. Dataclasses run such code.
    """


class Commands(typer.core.TyperGroup):
    """The sub-commands. Raises InputError for an empty word, which is never a name, a file or a number."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """See `TyperGroup`."""
        if bad := _empty(args):
            raise InputError(f"{bad} is empty; a value is needed, or leave it away")
        return super().resolve_command(ctx, args)


def _empty(words: Sequence[str]) -> str | None:
    """Name the option or word that is empty; None if none is."""
    for before, word in zip(("clutch-hil", *words), words, strict=False):
        if not word.strip():
            return before if before.startswith("-") else f"a word after {before!r}"
        if word.startswith("--") and word.endswith("="):
            return word.removesuffix("=")
    return None


def application() -> typer.Typer:
    """The command with the sub-commands of every installed part."""
    app = typer.Typer(
        cls=Commands,
        help="Hardware-in-the-loop bench for wet-clutch torque control over CAN.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )

    @app.callback(invoke_without_command=True)
    def root(show_version: bool = typer.Option(False, "--version", help="Print the version.")) -> None:
        if show_version:
            typer.echo(f"clutch-hil {version('clutch-hil')}")
            raise typer.Exit

    for point in sorted(entry_points(group="clutch_hil.commands"), key=lambda point: point.name):
        point.load().register(app)
    return app


def main() -> None:
    """Run `clutch-hil`."""
    main_of(application())


def main_of(run: Callable[[], object]) -> None:
    """Run a command; an InputError becomes one sentence and exit code 2, Ctrl-C or SIGTERM one and 130."""
    end_requested = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal end_requested
        end_requested = True
        signal.setitimer(signal.ITIMER_REAL, _REPEAT_INTERVAL, _REPEAT_INTERVAL)
        raise _EndRequestedError

    def insist(number: int, frame: FrameType | None) -> None:
        """Interrupt again: Python drops an exception in a destructor, and compilers have destructors."""
        if is_starting(frame):
            raise _EndRequestedError
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    signal.signal(signal.SIGALRM, insist)
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, interrupt)
    try:
        with PROGRESS_NOTICE:
            run()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except InterruptionError as interruption:
        print(f"interrupted: {interruption}", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except BaseException:  # a compiler or a library may turn _EndRequestedError into another one
        if not end_requested:
            raise
        _break_off()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _break_off() -> NoReturn:
    """End the process at once, after all `with` blocks: the interpreter cannot clean up what a library has half made."""
    signal.signal(signal.SIGALRM, signal.SIG_IGN)  # the interruption has arrived
    print(f"interrupted: nothing half-written is left, {describe_keeping()}", file=sys.stderr)
    discard_temporary()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(INTERRUPTED)
