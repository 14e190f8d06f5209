"""One HTML page with all reproductions: the verdict, a list, then picture, checks and notes of each."""

from collections.abc import Mapping, Sequence
from datetime import date
from html import escape
from importlib.metadata import version
from typing import Any

PAGE_HEAD = """<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>clutch-hil reproductions</title>
<style>
body{font:15px/1.45 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}
img{max-width:100%;height:auto;border:1px solid #ddd}.wide{overflow-x:auto}
table{border-collapse:collapse;margin:.6rem 0}td,th{border-bottom:1px solid #ddd;padding:.2rem .8rem .2rem 0;text-align:left}
.yes{color:#17722e}.no{color:#b00020}.note{color:#555;margin:.2rem 0}section{margin-bottom:3rem}
ul{columns:20rem 2;column-gap:2.5rem;padding-left:1.2rem}
</style><h1>Reproductions of Janssens 2010</h1>"""


def format_html_page(results: Sequence[Any], skipped: Mapping[str, str], verdict: str) -> str:
    """Format the page for `results` (`clutch_hil.thesis.reproduction.Result`), those that do not hold first in the list."""
    parts = [
        PAGE_HEAD,
        f"<p>clutch-hil {version('clutch-hil')}, {date.today().isoformat()}: <b>{escape(verdict)}</b></p><ul>",
    ]
    parts += [_format_link(r) for r in sorted(results, key=lambda r: r.holds)]
    parts.append("</ul>")
    parts += [f"<p class=note>skipped: {escape(name)}: {escape(reason)}</p>" for name, reason in skipped.items()]
    parts += [_format_section(r) for r in results]
    return "\n".join(parts)


def _format_link(result: Any) -> str:
    mark = "" if result.holds else ' <b class="no">does not hold</b>'
    return f'<li><a href="#{result.entry.name}">{escape(result.entry.name)}</a> {escape(result.entry.title)}{mark}</li>'


def _format_section(result: Any) -> str:
    entry, sheet = result.entry, result.sheet
    width, height = (round(inches * sheet.figure.dpi) for inches in sheet.figure.get_size_inches())
    size = f'width="{width}" height="{height}"'
    image = f'<img src="{result.picture.name}" alt="{escape(entry.title)}" {size} loading="lazy">'
    parts = [f'<section id="{entry.name}"><h2>{escape(entry.name)}: {escape(entry.title)}</h2>']
    parts += [f'<p class="{"yes" if result.holds else "no"}">{escape(result.verdict)}</p>', image]
    if sheet.table:
        parts.append(_format_table(sheet.table))
    parts.append(
        _format_table([("check", "measured", "thesis", "holds"), *(check.make_row() for check in sheet.checks)])
    )
    parts += [f"<p class=note>{escape(note)}</p>" for note in sheet.notes]
    return "\n".join([*parts, "</section>"])


def _format_table(rows: Sequence[Sequence[object]]) -> str:
    def format_line(cells: Sequence[object], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

    lines = format_line(rows[0], "th") + "".join(format_line(row, "td") for row in rows[1:])
    return f'<div class="wide"><table>{lines}</table></div>'
