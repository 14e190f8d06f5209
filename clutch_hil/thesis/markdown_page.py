"""The page docs/reproductions.md: results of all reproductions, kept in the repository. A test compares it with new results."""

import platform
from collections.abc import Sequence
from datetime import date
from importlib.metadata import version
from pathlib import Path

from clutch_hil.thesis.reproduction import CHECK_HEADER, Result, summarise

PAGE = Path(__file__).parents[2] / "docs" / "reproductions.md"
PICTURES = PAGE.with_suffix("")  # folder of the pictures that the page shows
PICTURED_ENTRIES = ("figure-6.14", "figure-6.15", "table-6.6")

_INTRODUCTION = """
A claim is a statement of the thesis about a figure or table. `clutch-hil reproduce NAME` computes it and checks the claim.
Claims marked with 'this project' are not from the thesis. For each check, the command prints the measured value and
the value of the thesis. Its notes list the values that were chosen here because the thesis does not give them.
The entries of chapter 6 measure the plant with the running controller, which receives its pressure or torque demands frame by
frame.
The fits of figure-5.10, compensation and microtribometer depend on how the processor rounds. Without AVX2 and FMA their numbers
differ by up to 13 %, and the error of XGMS in the unloading is 0.073 N.
"""


def format_markdown_page(results: Sequence[Result]) -> str:
    """Format the page for the `results` of all entries."""
    head = (
        f"Results of `clutch-hil reproduce --all` on {date.today().isoformat()} (clutch-hil {version('clutch-hil')}, Python"
        f" {platform.python_version()}): {summarise(results)}.\nWritten by `python -m clutch_hil.thesis`."
    )
    claims = [("name", "holds", "claim"), *(format_claim_row(result) for result in results)]
    against = [("name", *CHECK_HEADER[:3], "why"), *(row for result in results for row in format_failed_checks(result))]
    parts = [
        "# Reproductions",
        head + _INTRODUCTION,
        _format_table(claims),
        "## Claims that do not hold, and why",
        _format_table(against),
    ]
    parts += ["## Measured values of the entries with a table"]
    for result in results:
        if result.sheet.table:
            parts += [f"### {result.entry.name}: {result.entry.title}"]
            if result.entry.name in PICTURED_ENTRIES:
                parts += [f"![{result.entry.title}]({PICTURES.name}/{result.entry.name}.png)"]
            parts += [_format_table(result.sheet.table)]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def format_claim_row(result: Result) -> tuple[str, str, str]:
    """Format the row of an entry: its name, whether it holds, its claim."""
    return (result.entry.name, "yes" if result.holds else "**no**", result.entry.claim)


def format_failed_checks(result: Result) -> list[tuple[str, ...]]:
    """Format the checks of a result that do not hold as rows, with the known reason."""
    failing = [check.make_row() for check in result.sheet.checks if not check.holds]
    return [(result.entry.name, *row[:3], result.entry.contradiction) for row in failing]


def format_line(cells: Sequence[str]) -> str:
    """Format a row of a table of the page."""
    return "| " + " | ".join(str(cell).replace("|", r"\|") for cell in cells) + " |"


def _format_table(rows: Sequence[Sequence[str]]) -> str:
    return "\n".join([format_line(rows[0]), "|" + "---|" * len(rows[0]), *(format_line(row) for row in rows[1:])])
