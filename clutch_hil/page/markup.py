"""Markup: the HTML elements of a page. Text is escaped here."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, TypeGuard

from clutch_hil.page.wording import NO_NUMBER, format_interval, format_number, trim_zeros

_MOST_NUMBERS = 8  # longest list of numbers that is printed in full
_PNG_SIZE = slice(16, 24)  # position in a PNG of width and height, four bytes each


class Html(str):
    """Text that is already HTML, and is not escaped again."""

    __slots__ = ()


def make_html(content: object) -> str:
    """Return `content` escaped, unless it is `Html`."""
    return content if isinstance(content, Html) else escape(str(content))


def make_element(name: str, content: object, **attributes: str) -> Html:
    """Return an element; `class_` stands for the attribute class."""
    own = "".join(f' {key.rstrip("_")}="{escape(value)}"' for key, value in attributes.items() if value)
    return Html(f"<{name}{own}>{make_html(content)}</{name}>")


def join(parts: Sequence[object], between: str = "\n") -> Html:
    """Join the parts that are not empty."""
    return Html(between.join(make_html(part) for part in parts if part != ""))


def make_value(exact: float, text: str) -> Html:
    """Return a number as text, with its exact value as in report.json in the attribute `value`."""
    return Html(f'<data value="{float(exact)!r}">{escape(text)}</data>')


def make_table(
    header: Sequence[str], rows: Sequence[Sequence[object]], numeric: str = "", marks: Sequence[str] = ()
) -> Html:
    """Return a table; `numeric` has an "n" for each right-aligned column, `marks` a class for each row."""
    if not rows:
        return Html("")
    kinds = numeric.ljust(len(header))

    def make_line(cells: Sequence[object], cell: str, mark: str) -> Html:
        inside = [
            make_element(cell, c, class_={"n": "n", "h": "hash"}.get(k, "")) for c, k in zip(cells, kinds, strict=True)
        ]
        return make_element("tr", join(inside, ""), class_=mark)

    classes = marks or [""] * len(rows)
    body = join([make_line(row, "td", mark) for row, mark in zip(rows, classes, strict=True)])
    inside = join([make_element("thead", make_line(header, "th", "")), make_element("tbody", body)])
    return make_element("div", make_element("table", inside), class_="wide")


def make_figure(png: bytes | None, alternative: str, caption: object) -> Html:
    """Return a PNG inside the page, with a caption; nothing for None."""
    if png is None:
        return Html("")
    width, height = (int.from_bytes(png[_PNG_SIZE][k : k + 4], "big") for k in (0, 4))
    source = f"data:image/png;base64,{b64encode(png).decode()}"
    image = Html(f'<img src="{source}" width="{width}" height="{height}" alt="{escape(alternative)}">')
    return make_element("figure", join([image, make_element("figcaption", caption)]))


def fold(summary: str, content: Html) -> Html:
    """Return content that a reader can unfold; on paper it is always open. Nothing where there is no content."""
    return make_element("details", join([make_element("summary", summary), content])) if content else Html("")


def make_interval_cells(exact: float, ci95: tuple[float, float]) -> tuple[Html, Html]:
    """Return a value and its 95 % interval."""
    fitted, low, high = format_interval(exact, ci95)
    ends = join([make_value(ci95[0], low), make_value(ci95[1], high)], " … ")
    return make_value(exact, fitted), ends


def describe(thing: Any) -> Html:
    """Return any value of a JSON document as HTML; only count and range of a long list of numbers."""
    if hasattr(thing, "tolist"):  # of numpy
        return describe(thing.tolist())
    if isinstance(thing, Mapping):
        pairs = ((str(key).replace("_", " "), describe(v)) for key, v in thing.items())
        return make_element(
            "dl", join([join([make_element("dt", key), make_element("dd", text)], "") for key, text in pairs])
        )
    if isinstance(thing, bool):
        return Html("yes" if thing else "no")
    if isinstance(thing, int):
        return make_value(thing, str(thing))
    if isinstance(thing, float):
        return make_value(thing, trim_zeros(thing, 4))
    if thing is None or thing in ("", [], ()):
        return Html(NO_NUMBER)
    if isinstance(thing, Sequence) and not isinstance(thing, str):
        return _describe_sequence(thing)
    return Html(escape(str(thing)))


def is_numbers(thing: Any) -> TypeGuard[list[float]]:
    """Return whether `thing` is a non-empty list of numbers."""
    return isinstance(thing, list | tuple) and bool(thing) and all(type(v) in (int, float) for v in thing)


def _describe_sequence(things: Sequence[Any]) -> Html:
    if is_numbers(things) and len(things) > _MOST_NUMBERS:
        return Html(
            f"{len(things)} numbers from {make_html(format_number(min(things)))} to {make_html(format_number(max(things)))}"
        )
    if all(isinstance(thing, Mapping) and thing.keys() == things[0].keys() for thing in things):
        names = [str(key).replace("_", " ") for key in things[0]]
        return make_table(names, [[describe(v) for v in thing.values()] for thing in things])
    if all(isinstance(thing, str | int | float) for thing in things):
        return join([describe(thing) for thing in things], ", ")
    return make_element("ul", join([make_element("li", describe(thing)) for thing in things]))
