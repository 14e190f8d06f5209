"""Run one reproduction, or run all of them and write a page of results with their checks and pictures."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from clutch_hil.bench.arguments import take_function, take_name
from clutch_hil.bench.progress import format_table
from clutch_hil.thesis import Entry, find_entry, load_entries
from clutch_hil.thesis.check_sheet import Sheet
from clutch_hil.thesis.html_page import format_html_page
from protocols.errors import InputError
from protocols.files.output_file import whole_file

Progress = Callable[[int, int], None]  # (done, total)
CHECK_HEADER = ("check", "measured", "thesis", "holds")


@dataclass(frozen=True)
class Result:
    """Result of a reproduction: `entry`, its filled `sheet`, path of its `picture` if it was written, `seconds` it took."""

    entry: Entry
    sheet: Sheet
    picture: Path | None
    seconds: float

    def __str__(self) -> str:
        """The checks as a table, and the verdict."""
        return f"{self.entry.name}: {self.entry.title}\n{format_checks(self)}\n{self.verdict}"

    @property
    def holds(self) -> bool:
        """Whether all checks of the claim hold."""
        return self.sheet.holds

    @property
    def is_as_known(self) -> bool:
        """Whether the claim holds, or fails in the checks that are known to fail and in no other."""
        return not self._news and bool(self.sheet.checks)

    @property
    def _news(self) -> list[str]:
        return self.entry.list_news([check.statement for check in self.sheet.checks if not check.holds])

    @property
    def verdict(self) -> str:
        """Holds or not, the claim, and if it is known not to hold the reason, and what differs from what is known."""
        reason = ""
        if self.entry.contradiction:
            news = f"; other than known: {'; '.join(self._news)}" if self._news else ""
            reason = f" (known: {self.entry.contradiction}{news})"
        return f"{'holds' if self.holds else 'does not hold'}: {self.entry.claim}{reason}"

    def make_document(self) -> dict[str, Any]:
        """The result as a JSON object."""
        return self.sheet.document | {
            "name": self.entry.name,
            "title": self.entry.title,
            "claim": self.entry.claim,
            "holds": self.holds,
            "contradicted": self.entry.contradiction,
            "checks": [check.make_document() for check in self.sheet.checks],
            "table": self.sheet.table,
            "notes": self.sheet.notes,
            "picture": str(self.picture) if self.picture else None,
            "seconds": self.seconds,
        }


def reproduce(name: str, progress: Progress = lambda done, total: None) -> Result:
    """Check a result of the thesis by running it; `name` as of `clutch-hil reproduce`: figure-6.12, fig 6.12, table-6.1, 6.12.

    In the result `holds` and `verdict` say whether the claim holds, `sheet.checks` has the measured values, and `sheet.figure`
    is the picture, a matplotlib Figure. No file is written. Long work calls `progress(done, total)`. Raises InputError.
    """
    return _fill(find_entry(take_name("name", name)), take_function("progress", progress))


def run(entry: Entry, out: Path, progress: Progress) -> Result:
    """Run one reproduction and write its picture into the folder `out`. Raises InputError."""
    result, picture = _fill(entry, progress), out / f"{entry.name}.png"
    result.sheet.save(picture, f"{entry.name}: {entry.title}")
    return replace(result, picture=picture)


def _fill(entry: Entry, progress: Progress) -> Result:
    start = time.perf_counter()
    sheet = Sheet(progress)
    entry.run(sheet)
    return Result(entry, sheet, None, time.perf_counter() - start)


def format_checks(result: Result) -> str:
    """Format a result as text: its table if it has one, its checks and its notes."""
    sheet = result.sheet
    tables = [format_table(sheet.table), ""] if sheet.table else []
    rows = [CHECK_HEADER, *(check.make_row() for check in sheet.checks)]
    return "\n".join([*tables, format_table(rows), *(f"note:    {note}" for note in sheet.notes)])


def run_every(out: Path, progress: Progress) -> tuple[list[Result], dict[str, str]]:
    """Run every reproduction and write its picture. Returns the results, and by name why entries were skipped (data)."""
    known = load_entries()
    results, skipped = [], {}
    for i, one in enumerate(known.values()):
        try:
            results.append(run(one, out, lambda done, total: None))
        except InputError as error:
            skipped[one.name] = str(error)
        progress(i + 1, len(known))
    return results, skipped


def summarise(results: Sequence[Result]) -> str:
    """Summarise results: number of claims that hold, of those known not to hold, and names of unexpected ones."""
    unexpected = [r.entry.name for r in results if not r.is_as_known]
    holding = sum(r.holds for r in results)
    against = sum(not r.holds and r.is_as_known for r in results)
    verdict = f"{holding} of {len(results)} claims hold, {against} known not to"
    return verdict + (f"; unexpected: {', '.join(unexpected)}" if unexpected else "")


def run_all(out: Path, progress: Progress) -> tuple[dict[str, Any], str, str, bool]:
    """Run every reproduction; write pictures and the page `index.html`. Returns document, text, verdict, all as known.

    An entry whose data are missing or bad is skipped with the reason. Raises InputError.
    """
    results, skipped = run_every(out, progress)
    verdict = summarise(results) + (f"; {len(skipped)} skipped" if skipped else "")
    page = out / "index.html"
    with whole_file(page) as part:
        part.write_text(format_html_page(results, skipped, verdict), encoding="utf-8")
    rows = [("name", "holds", "s", "claim")]
    rows += [(r.entry.name, "yes" if r.holds else "NO", f"{r.seconds:.1f}", r.entry.claim) for r in results]
    skips = [f"skipped: {name}: {reason}" for name, reason in skipped.items()]
    text = "\n".join([format_table(rows), *skips, f"wrote:   {page}"])
    document = {"verdict": verdict, "results": [r.make_document() for r in results], "skipped": skipped}
    return document, text, verdict, all(result.is_as_known for result in results)
