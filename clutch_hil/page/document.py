"""Document: a whole page from its sections."""

from collections.abc import Sequence

from clutch_hil.page.markup import Html, join, make_element
from clutch_hil.page.style import STYLE

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"  # content security: the page loads nothing


def compose_document(title: str, header: Html, sections: Sequence[tuple[str, Sequence[Html]]]) -> str:
    """Return the HTML text of a page. sections: heading and contents of each; they are numbered."""
    body = [header]
    for count, (heading, content) in enumerate(sections, 1):
        body.append(make_element("section", join([make_element("h2", f"{count}. {heading}"), *content])))
    head = [
        Html('<meta charset="utf-8"><meta name="viewport" content="width=device-width">'),
        Html(f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'),
        make_element("title", title),
        make_element("style", Html(STYLE)),
    ]
    whole = join([make_element("head", join(head)), make_element("body", join(body))])
    return f'<!doctype html>\n<html lang="en">\n{whole}\n</html>\n'
