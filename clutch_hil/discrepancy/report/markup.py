"""Markup: the few pieces of HTML that the discrepancy report is made of. What goes in is text and is escaped here."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, TypeGuard

from clutch_hil.discrepancy.report.wording import NO_NUMBER, interval, number, trimmed
from clutch_hil.discrepancy.result import Estimate

_MANY = 8  # numbers that are told one by one
_PNG_SIZE = slice(16, 24)  # of a PNG: width and height, four bytes each


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def html(content: object) -> str:
    """`content` escaped, unless it is `Html`."""
    return content if isinstance(content, Html) else escape(str(content))


def tag(name: str, content: object, **attributes: str) -> Html:
    """An element; `class_` stands for the attribute class."""
    own = "".join(f' {key.rstrip("_")}="{escape(value)}"' for key, value in attributes.items() if value)
    return Html(f"<{name}{own}>{html(content)}</{name}>")


def joined(parts: Sequence[object], between: str = "\n") -> Html:
    """Parts one after the other."""
    return Html(between.join(html(part) for part in parts if part != ""))


def value(exact: float, text: str) -> Html:
    """A number as it is read, with the number as it is in report.json."""
    return Html(f'<data value="{float(exact)!r}">{escape(text)}</data>')


def table(
    header: Sequence[str], rows: Sequence[Sequence[object]], numeric: str = "", marks: Sequence[str] = ()
) -> Html:
    """A table; `numeric` has an "n" for each column that is aligned right, `marks` a class for each row."""
    if not rows:
        return Html("")
    kinds = numeric.ljust(len(header))

    def line(cells: Sequence[object], cell: str, mark: str) -> Html:
        inside = [tag(cell, c, class_={"n": "n", "h": "hash"}.get(k, "")) for c, k in zip(cells, kinds, strict=True)]
        return tag("tr", joined(inside, ""), class_=mark)

    classes = marks or [""] * len(rows)
    body = joined([line(row, "td", mark) for row, mark in zip(rows, classes, strict=True)])
    inside = joined([tag("thead", line(header, "th", "")), tag("tbody", body)])
    return tag("div", tag("table", inside), class_="wide")


def figure(png: bytes | None, alternative: str, caption: object) -> Html:
    """A picture inside the page, with a caption; nothing where there is none."""
    if png is None:
        return Html("")
    width, height = (int.from_bytes(png[_PNG_SIZE][k : k + 4], "big") for k in (0, 4))
    source = f"data:image/png;base64,{b64encode(png).decode()}"
    image = Html(f'<img src="{source}" width="{width}" height="{height}" alt="{escape(alternative)}">')
    return tag("figure", joined([image, tag("figcaption", caption)]))


def more(summary: str, content: Html) -> Html:
    """What a reader may open, on paper always open; nothing where there is nothing."""
    return tag("details", joined([tag("summary", summary), content])) if content else Html("")


def interval_cells(estimate: Estimate) -> tuple[Html, Html]:
    """Value and 95 % interval of an estimate."""
    fitted, low, high = interval(estimate)
    ends = joined([value(estimate.ci95[0], low), value(estimate.ci95[1], high)], " … ")
    return value(estimate.value, fitted), ends


def described(thing: Any) -> Html:
    """Any value of a JSON document, for people; a long list of numbers is only summed up."""
    if hasattr(thing, "tolist"):  # of numpy
        return described(thing.tolist())
    if isinstance(thing, Mapping):
        pairs = ((str(key).replace("_", " "), described(v)) for key, v in thing.items())
        return tag("dl", joined([joined([tag("dt", key), tag("dd", text)], "") for key, text in pairs]))
    if isinstance(thing, bool):
        return Html("yes" if thing else "no")
    if isinstance(thing, int):
        return value(thing, str(thing))
    if isinstance(thing, float):
        return value(thing, trimmed(thing, 4))
    if thing is None or thing in ("", [], ()):
        return Html(NO_NUMBER)
    if isinstance(thing, Sequence) and not isinstance(thing, str):
        return _listed(thing)
    return Html(escape(str(thing)))


def is_numbers(thing: Any) -> TypeGuard[list[float]]:
    """Whether it is a list of numbers."""
    return isinstance(thing, list | tuple) and bool(thing) and all(type(v) in (int, float) for v in thing)


def _listed(things: Sequence[Any]) -> Html:
    if is_numbers(things) and len(things) > _MANY:
        return Html(f"{len(things)} numbers from {html(number(min(things)))} to {html(number(max(things)))}")
    if all(isinstance(thing, Mapping) and thing.keys() == things[0].keys() for thing in things):
        names = [str(key).replace("_", " ") for key in things[0]]
        return table(names, [[described(v) for v in thing.values()] for thing in things])
    if all(isinstance(thing, str | int | float) for thing in things):
        return joined([described(thing) for thing in things], ", ")
    return tag("ul", joined([tag("li", described(thing)) for thing in things]))
