"""Progress of long tasks on the terminal, and tables as text."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from protocols.kernels.progress_notice import PROGRESS_NOTICE


@contextmanager
def progress_bar(title: str, quiet: bool) -> Iterator[Callable[[float, int], None]]:
    """Show a bar on stderr that `progress(done, total)` advances.

    Where stderr is no terminal, print a line every 5 s, an unchanged line again after 30 s. Show nothing when `quiet`.
    """
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    on_terminal = not quiet and console.is_terminal
    share = 0.0

    def describe() -> str:
        return "" if on_terminal or quiet else f"{title}: {100.0 * share:.0f} % done"

    with (
        PROGRESS_NOTICE.describe_by(describe),
        Progress(*columns, console=console, transient=True, disable=not on_terminal) as bar,
    ):
        task = bar.add_task(title, total=None)

        def show(done: float, total: int) -> None:
            nonlocal share
            share = done / total if total else 0.0
            bar.update(task, completed=done, total=total)

        yield show


class ActivityLine:
    """One line on the terminal that shows the current activity. Use as a context manager.

    Where stderr is no terminal, a line is printed every 5 s, an unchanged line again after 30 s. Nothing is shown when `quiet`.
    """

    def __init__(self, first: str, quiet: bool) -> None:
        self._text = first
        self._console = Console(stderr=True, quiet=quiet)
        self._on_terminal = self._console.is_terminal
        self._status = self._console.status(Text(first))  # no markup: a name may have brackets
        self._notice = PROGRESS_NOTICE.describe_by(lambda: "" if self._on_terminal or quiet else self._text)

    def __enter__(self) -> "ActivityLine":
        self._notice.__enter__()
        if self._on_terminal:
            self._status.start()
        return self

    def __exit__(self, *error: Any) -> None:
        self._status.stop()
        self._notice.__exit__(*error)

    def update(self, text: str) -> None:
        """Show another text."""
        self._text = text
        self._status.update(Text(text))

    def note(self, text: str) -> None:
        """Print a text that remains on the terminal."""
        self._console.print(text, soft_wrap=True, highlight=False, markup=False)


def format_table(rows: Sequence[Sequence[str]]) -> str:
    """Format rows, the header first, as a table with aligned columns."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])
