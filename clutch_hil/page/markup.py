"""Markup: the HTML elements of a page. Text is escaped here."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, TypeGuard

from clutch_hil.page.wording import NO_NUMBER, interval, number, trim_zeros

_MOST_NUMBERS = 8  # that are listed one by one
_PNG_SIZE = slice(16, 24)  # of a PNG: width and height, four bytes each


class Html(str):
    """Text that is HTML already, and is not escaped again."""

    __slots__ = ()


def html(content: object) -> str:
    """`content` escaped, unless it is `Html`."""
    return content if isinstance(content, Html) else escape(str(content))


def tag(name: str, content: object, **attributes: str) -> Html:
    """An element; `class_` stands for the attribute class."""
    own = "".join(f' {key.rstrip("_")}="{escape(value)}"' for key, value in attributes.items() if value)
    return Html(f"<{name}{own}>{html(content)}</{name}>")


def join(parts: Sequence[object], between: str = "\n") -> Html:
    """Parts one after the other; empty ones are left out."""
    return Html(between.join(html(part) for part in parts if part != ""))


def value(exact: float, text: str) -> Html:
    """A number as text, with its exact value as in report.json in the attribute `value`."""
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
        return tag("tr", join(inside, ""), class_=mark)

    classes = marks or [""] * len(rows)
    body = join([line(row, "td", mark) for row, mark in zip(rows, classes, strict=True)])
    inside = join([tag("thead", line(header, "th", "")), tag("tbody", body)])
    return tag("div", tag("table", inside), class_="wide")


def figure(png: bytes | None, alternative: str, caption: object) -> Html:
    """A PNG inside the page, with a caption; nothing for None."""
    if png is None:
        return Html("")
    width, height = (int.from_bytes(png[_PNG_SIZE][k : k + 4], "big") for k in (0, 4))
    source = f"data:image/png;base64,{b64encode(png).decode()}"
    image = Html(f'<img src="{source}" width="{width}" height="{height}" alt="{escape(alternative)}">')
    return tag("figure", join([image, tag("figcaption", caption)]))


def fold(summary: str, content: Html) -> Html:
    """Content that a reader may unfold; on paper it is always open. Nothing where there is no content."""
    return tag("details", join([tag("summary", summary), content])) if content else Html("")


def interval_cells(exact: float, ci95: tuple[float, float]) -> tuple[Html, Html]:
    """A value and its 95 % interval."""
    fitted, low, high = interval(exact, ci95)
    ends = join([value(ci95[0], low), value(ci95[1], high)], " … ")
    return value(exact, fitted), ends


def describe(thing: Any) -> Html:
    """Any value of a JSON document as HTML; of a long list of numbers only count and range."""
    if hasattr(thing, "tolist"):  # of numpy
        return describe(thing.tolist())
    if isinstance(thing, Mapping):
        pairs = ((str(key).replace("_", " "), describe(v)) for key, v in thing.items())
        return tag("dl", join([join([tag("dt", key), tag("dd", text)], "") for key, text in pairs]))
    if isinstance(thing, bool):
        return Html("yes" if thing else "no")
    if isinstance(thing, int):
        return value(thing, str(thing))
    if isinstance(thing, float):
        return value(thing, trim_zeros(thing, 4))
    if thing is None or thing in ("", [], ()):
        return Html(NO_NUMBER)
    if isinstance(thing, Sequence) and not isinstance(thing, str):
        return _describe_sequence(thing)
    return Html(escape(str(thing)))


def is_numbers(thing: Any) -> TypeGuard[list[float]]:
    """Whether `thing` is a list of numbers that is not empty."""
    return isinstance(thing, list | tuple) and bool(thing) and all(type(v) in (int, float) for v in thing)


def _describe_sequence(things: Sequence[Any]) -> Html:
    if is_numbers(things) and len(things) > _MOST_NUMBERS:
        return Html(f"{len(things)} numbers from {html(number(min(things)))} to {html(number(max(things)))}")
    if all(isinstance(thing, Mapping) and thing.keys() == things[0].keys() for thing in things):
        names = [str(key).replace("_", " ") for key in things[0]]
        return table(names, [[describe(v) for v in thing.values()] for thing in things])
    if all(isinstance(thing, str | int | float) for thing in things):
        return join([describe(thing) for thing in things], ", ")
    return tag("ul", join([tag("li", describe(thing)) for thing in things]))
