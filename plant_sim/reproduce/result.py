"""The result of a reproduction: what was checked, and where the picture is; one, or all on a page."""

import html
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from plant_sim.bench.progress import table_text
from plant_sim.reproduce import Entry, entries
from plant_sim.reproduce.measured_data import MissingDataError
from plant_sim.reproduce.sheet import Sheet

Progress = Callable[[int, int], None]  # (done, total)


@dataclass(frozen=True)
class Result:
    """A filled `sheet` of an `entry`, its `picture` on disk, and the `seconds` it took."""

    entry: Entry
    sheet: Sheet
    picture: Path
    seconds: float

    @property
    def holds(self) -> bool:
        """Whether all checks of the claim hold."""
        return self.sheet.holds

    def document(self) -> dict[str, Any]:
        """The result for machines."""
        return self.sheet.document | {
            "name": self.entry.name,
            "claim": self.entry.claim,
            "holds": self.holds,
            "checks": [asdict(check) for check in self.sheet.checks],
            "notes": self.sheet.notes,
            "picture": str(self.picture),
            "seconds": self.seconds,
        }


def run(entry: Entry, out: Path, progress: Progress) -> Result:
    """Run one reproduction and write its picture into the folder `out`."""
    start = time.perf_counter()
    sheet = Sheet(progress)
    entry.run(sheet)
    picture = out / f"{entry.name}.png"
    sheet.save(picture, f"{entry.name}: {entry.title}")
    return Result(entry, sheet, picture, time.perf_counter() - start)


def checks_text(result: Result) -> str:
    """The table of a result if it has one, its checks and its notes, as text."""
    sheet = result.sheet
    rows = [("check", "measured", "thesis", "holds")]
    rows += [(c.statement, c.measured, c.thesis, "yes" if c.holds else "NO") for c in sheet.checks]
    tables = [table_text(sheet.table), ""] if sheet.table else []
    return "\n".join([*tables, table_text(rows), *(f"note:    {note}" for note in sheet.notes)])


def run_all(out: Path, progress: Progress) -> tuple[dict[str, Any], str, str, bool]:
    """Run every reproduction; write pictures and the page `index.html`. Returns document, text, verdict, all hold."""
    known = entries()
    results = []
    skipped = {}
    for i, entry in enumerate(known.values()):
        try:
            results.append(run(entry, out, lambda done, total: None))
        except MissingDataError as error:
            skipped[entry.name] = str(error)
        progress(i + 1, len(known))
    page = out / "index.html"
    page.write_text(_page(results), encoding="utf-8")
    rows = [("name", "holds", "s", "claim")]
    rows += [(r.entry.name, "yes" if r.holds else "NO", f"{r.seconds:.1f}", r.entry.claim) for r in results]
    failed = [r.entry.name for r in results if not r.holds]
    verdict = f"{len(results) - len(failed)} of {len(results)} claims hold"
    if failed:
        verdict += f"; not: {', '.join(failed)}"
    skips = [f"skipped: {name}: {reason}" for name, reason in skipped.items()]
    text = "\n".join([table_text(rows), *skips, f"wrote:   {page}"])
    return {"results": [r.document() for r in results], "skipped": skipped}, text, verdict, not failed


def _page(results: list[Result]) -> str:
    parts = [_HEAD]
    for r in results:
        state = "holds" if r.holds else "does not hold"
        parts.append(f'<section id="{r.entry.name}"><h2>{html.escape(r.entry.name)}: {html.escape(r.entry.title)}</h2>')
        parts.append(f'<p><b class="{state.replace(" ", "-")}">{state}</b> {html.escape(r.entry.claim)}</p>')
        parts.append(f'<img src="{r.picture.name}" alt="{html.escape(r.entry.title)}" loading="lazy">')
        if r.sheet.table:
            parts.append(_table(r.sheet.table))
        checks = [(c.statement, c.measured, c.thesis, "yes" if c.holds else "NO") for c in r.sheet.checks]
        parts.append(_table([("check", "measured", "thesis", "holds"), *checks]))
        parts += [f"<p class=note>{html.escape(note)}</p>" for note in r.sheet.notes]
        parts.append("</section>")
    return "\n".join(parts)


def _table(rows: Any) -> str:
    def line(cells: Any, tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

    return f"<table>{line(rows[0], 'th')}{''.join(line(row, 'td') for row in rows[1:])}</table>"


_HEAD = """<!doctype html><meta charset="utf-8"><title>clutch-hil reproductions</title>
<style>
body{font:15px/1.45 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}
img{max-width:100%;border:1px solid #ddd}
table{border-collapse:collapse;margin:.6rem 0}td,th{border-bottom:1px solid #ddd;padding:.2rem .8rem .2rem 0;text-align:left}
.holds{color:#17722e}.does-not-hold{color:#b00020}.note{color:#555;margin:.2rem 0}section{margin-bottom:3rem}
</style><h1>Reproductions of Janssens 2010</h1>"""
