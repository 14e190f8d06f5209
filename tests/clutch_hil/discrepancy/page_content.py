"""What a page of a report holds, for tests that read it."""

import base64
from html.parser import HTMLParser


class Content(HTMLParser):
    """What a page holds: tags, where they point to, text, numbers with their exact values."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.numbers: list[tuple[float, str]] = []
        self.text = ""
        self._exact: float | None = None
        self.feed(text)

    def handle_starttag(self, name, attributes):
        given = dict(attributes)
        self.tags.append(name)
        if name not in ("meta", "img"):
            self.open.append(name)
        self.addresses += [given[key] for key in ("src", "href", "srcset", "action", "data") if key in given]
        if name == "data":
            self._exact = float(given["value"])

    def handle_endtag(self, name):
        assert self.open.pop() == name

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.text += data
        if self._exact is not None:
            self.numbers.append((self._exact, data))
            self._exact = None

    @property
    def pictures(self):
        return [base64.b64decode(address.partition(",")[2]) for address in self.addresses]


def parse_number(text):
    """The number that a text tells."""
    plain = text.replace("−", "-").replace(",", "")
    power = 0
    if "·" in plain:
        plain, _, ten = plain.partition(" · 10")
        power = int(ten.split()[0].translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")))
    value = float(plain.split()[0]) * 10.0**power
    return value / 100.0 if "%" in text else value
