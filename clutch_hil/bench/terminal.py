"""Terminal: print from a loop that records or supervises only what the terminal accepts without blocking.

A terminal held by Ctrl-S, or a pipe to a pager that waits for its reader, blocks the process that writes to it.
"""

import select

from rich.console import Console


def takes_text(console: Console) -> bool:
    """Return whether a console accepts a line without waiting for a reader."""
    try:
        return bool(select.select([], [console.file], [], 0.0)[1])
    except (OSError, ValueError):  # no file descriptor, or a closed one
        return True
