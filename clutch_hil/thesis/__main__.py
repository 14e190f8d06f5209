"""`python -m clutch_hil.thesis`: run every reproduction and write docs/reproductions.md and its pictures again."""

import shutil
import tempfile
from pathlib import Path

from clutch_hil.bench.progress import progress_bar
from clutch_hil.command import run_command
from clutch_hil.thesis.markdown_page import PAGE, PICTURED_ENTRIES, PICTURES, format_markdown_page
from clutch_hil.thesis.reproduction import run_every
from protocols.errors import InputError


def main() -> None:
    """Write the page. Raises InputError where an entry was skipped, because the page must have all of them."""
    with tempfile.TemporaryDirectory() as folder, progress_bar("reproduce", False) as progress:
        results, skipped = run_every(Path(folder), progress)
        if skipped:
            raise InputError(f"{PAGE} needs all reproductions; {skipped} were skipped")
        PICTURES.mkdir(exist_ok=True)
        for name in PICTURED_ENTRIES:
            shutil.copy(Path(folder) / f"{name}.png", PICTURES)
    PAGE.write_text(format_markdown_page(results), encoding="utf-8")
    print(f"wrote {PAGE} and {len(PICTURED_ENTRIES)} pictures")


if __name__ == "__main__":
    run_command(main)
