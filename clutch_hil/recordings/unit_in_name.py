"""Unit in a name: `Torque [Nm]`, as tools write it where a file has no other place for units."""

import re
from functools import cache

from clutch_hil.recordings.channel import simplify_unit
from protocols.errors import InputError
from protocols.files.units import contradict, to_si

_LONGEST_NAME = 200  # longest name that is searched for a unit
_BRACKETED = re.compile(
    r"(?P<name>.*?)(?P<gap>[\s_]*)(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\)|<(?P<angle>[^<>]*)>|\{(?P<curly>[^{}]*)\})\s*"
)
# Units in a name without brackets, behind a separator, or in brackets before its end
_HINTED = (
    r"(?P<unit>[munµμ]s|(?i:rpm|psi|kpa|bar)|(?:rad|deg|km|m)[/_](?:s|h)|kmh|[kMh]?Pa|mbar|[mkc]?Nm|(?:ft|in)[_-]?lbf?|kN|mm|um|deg[CF]?|°[CF]"
    r"|m[VA]|k?Hz|min-1|min\^-1|min⁻¹|[1U]/min)"
)
_HINT = re.compile(rf"(?P<name>.+?)[ _/|:-]{_HINTED}")
_WITHIN = re.compile(rf"(?:[ _/|:,-]|[\[(<{{]){_HINTED}(?=[ _/|:,-]|[\])>}}])")
# Any unit in brackets before the end, `Amplitude (V) - Plot 0` of LabVIEW, but for letters that tell wheels or coils apart
_IN_BRACKETS = re.compile(r".+?[\[(](?P<unit>[smhVANW%]|[^\d\W][^\[\]()]+)[\])]\s*[ -].*")
_PER = re.compile(r"(rad|deg|km|m)_([sh])")
# The same in names such as `speedRpm`, for times also in capitals, and as a complete name
_CAMEL = re.compile(r"(?P<name>.*[a-z0-9])(?P<unit>Rpm|RPM|(?<![cdkm])Nm|KNm|KPa|Kpa|Bar|Psi|PSI)")
_OF_TIME = re.compile(r"(?i:(?P<name>t|time|zeit|time_?stamp)[ _]?(?P<unit>m?sec|[mu]s))")
_TIME_OVER_UNIT = re.compile(r"(?P<name>t|(?i:time|zeit))/(?P<unit>s|min|h)")  # DIN writes t/s; T is no time
# Units in lower case, as runs of this bench have them: only behind the name of their quantity, as nm is a length, too
_LOWER_CASE = {
    unit: re.compile(rf"(?i:(?P<name>.*(?:{quantity}).*?)[ _]{written})")
    for unit, written, quantity in (
        ("Nm", "nm", "torque|moment|trq|couple"), ("kNm", "knm", "torque|moment|trq|couple"),
        ("MPa", "mpa", "press|druck"), ("kN", "kn", "force|kraft"), ("V", "v", "volt|spannung"),
        ("mV", "mv", "volt|spannung"), ("mA", "ma", "current|strom|courant"), ("degC", "degc", ""),
    )
}  # fmt: skip
_WHOLE = {
    "rpm": "rpm", "millis": "ms", "micros": "us", "milliseconds": "ms", "microseconds": "us", "msec": "ms", "usec": "us",
    "ms": "ms", "us": "us", "knm": "kNm", "kpa": "kPa", "mbar": "mbar", "psi": "psi", "degf": "degF", "°f": "degF",
}  # fmt: skip
_ALONE = re.compile(r"in\s+(?P<unit>[^\W\d]\S*)")  # `in s`, the name of the time in files of Rohde & Schwarz
_AFTER_MARK = re.compile(r"(?P<name>.+?)(?:\s*/\s+|\s+/\s*|\s*,\s*|\s+in\s+)(?P<unit>\S+)")


def split_unit(text: str) -> tuple[str, str]:
    """Return name and unit of `Torque [Nm]`, `temp (degC)`, `speed / rpm`; the unit must be known, except in [ ] or < >."""
    if len(text) > _LONGEST_NAME:
        return text, ""
    if (match := _BRACKETED.fullmatch(text)) and match["name"]:
        square = match["square"] if match["square"] is not None else match["angle"]
        unit = (square if square is not None else match["round"] or match["curly"] or "").strip()
        index = unit.isdigit() and not (unit == "1" and match["gap"])  # x[2] is an element
        if unit and not index and (is_unit(unit) or unit in ("-", "--") or square is not None):
            return match["name"].strip(), unit
        return text, ""
    if (match := _ALONE.fullmatch(text)) and is_unit(match["unit"]):
        return text, match["unit"]
    if (match := _AFTER_MARK.fullmatch(text)) and is_unit(match["unit"]) and not match["unit"].isdigit():
        return match["name"].strip(), match["unit"]
    return text, ""


def take_unit(name: str, unit: str, kind: str) -> tuple[str, str]:
    """Return name and unit of a channel in a file with a field for units: if it is empty, a known unit in the name is used.

    An unknown word in brackets may have any meaning there, as in `wheel[FL]`.
    """
    if unit or kind != "number":
        return name, unit
    plain, own = split_unit(name)
    return (plain, own) if own and is_unit(own) else (name, unit)


def hint_unit(name: str) -> tuple[str, str]:
    """Return name and unit of `speed_rpm` or `p/kPa`, whose last word is not marked as a unit; the unit is "" if there is none.

    Also for a single unit within `torque [kNm] filtered` or `p_kPa_mean`; the name is then unchanged. Ambiguous words do not
    count: `min`, `in` and `rad` may be a least value, an inlet and a wheel.
    """
    if len(name) > _LONGEST_NAME:
        return name, ""
    if whole := _WHOLE.get(name.strip().lower(), ""):
        return name, whole
    if match := _OF_TIME.fullmatch(name):
        return match["name"], match["unit"].lower()
    if match := _TIME_OVER_UNIT.fullmatch(name):
        return match["name"], match["unit"]
    if match := _HINT.fullmatch(name) or _CAMEL.fullmatch(name):
        return match["name"], _write_unit(match["unit"])
    for unit, written in _LOWER_CASE.items():
        if match := written.fullmatch(name):
            return match["name"], unit
    within = {_write_unit(match["unit"]) for match in _WITHIN.finditer(name)}
    if not within and (match := _IN_BRACKETS.fullmatch(name)) and is_unit(match["unit"]):
        return name, _write_unit(match["unit"])
    return (name, within.pop()) if len(within) == 1 else (name, "")


def _write_unit(text: str) -> str:
    """Return a unit for an import map: as in the name, if that is a valid unit, else in its usual spelling."""
    unit = _PER.sub(r"\1/\2", text)
    simple = simplify_unit(unit)
    return simple if contradict(unit, simple) or not is_known(unit) else unit


def strip_brackets(cell: str) -> str:
    """Return a unit without the brackets around it."""
    return cell[1:-1].strip() if len(cell) > 1 and cell[0] + cell[-1] in ("[]", "()", "<>", "{}") else cell


@cache
def is_unit(text: str) -> bool:
    """Return whether a text is a known unit, after `simplify_unit`."""
    return is_known(simplify_unit(text))


def is_known(unit: str) -> bool:
    """Return whether a unit is known exactly as written."""
    try:
        to_si(1.0, unit)
    except InputError:
        return False
    return True
