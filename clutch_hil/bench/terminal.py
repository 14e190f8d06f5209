"""Terminal: a loop that records or supervises prints only what a terminal takes at once.

A terminal that is held by Ctrl-S, or a pipe to a pager that waits for its reader, blocks whoever writes to it.
"""

import select

from rich.console import Console


def takes_text(console: Console) -> bool:
    """Whether a line on a console is written without waiting for a reader."""
    try:
        return bool(select.select([], [console.file], [], 0.0)[1])
    except (OSError, ValueError):  # it has no descriptor, or a closed one
        return True
