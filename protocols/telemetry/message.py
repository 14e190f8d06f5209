"""Messages in JSON: checks of received messages. Each function raises InputError for an invalid message."""

import json
from collections.abc import Mapping
from math import isfinite
from typing import Any

from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError

NODES = ("plant", *CONTROLLERS)  # that a bench may have
_MOST_BYTES = 16 << 20  # of a message: all parameters of a plant take 0.1 MB, 10 000 events 3 MB
_SHOWN = 60  # characters of a wrong value

_MOST_WHOLE = 1 << 53  # integers below it are exact in a double
LATEST = 9e9  # s, UNIX time in the year 2255: its ns fit into 64 bits, as the viewer needs
_TEXT, _NUMBER, _WHOLE, _ANY_NUMBER = "a text", "a finite number", "a whole number from 0 to 2^53", "a number"
_TIME, _NUMBER_OR_NULL = f"a UNIX time from 0 to {LATEST:g} s", "a finite number or null"
_DESCRIPTION = {"session": _WHOLE}
_COLUMN = {"name": _TEXT, "unit": _TEXT, "meaning": _TEXT}
_EVENT = {
    "node": _TEXT, "name": _TEXT, "unit": _TEXT, "old": _NUMBER_OR_NULL, "new": _NUMBER, "time": _TIME, "row": _WHOLE,
}  # fmt: skip
_PARAMETER = {
    "name": _TEXT,
    "value": _NUMBER,
    "unit": _TEXT,
    "default": _NUMBER,
    "source": _TEXT,
    "uncertainty": _NUMBER,
}
_INJECTION = {"at": _NUMBER, "ramp": _NUMBER}
_REQUEST = {"node": _TEXT, "kind": _TEXT, "by": _TEXT, "time": _TIME, "row": _WHOLE}


def parse_message(payload: bytes) -> Any:
    """Return the value in a JSON message."""
    if len(payload) > _MOST_BYTES:
        raise InputError(f"a message has {len(payload)} bytes; allowed are {_MOST_BYTES}")
    try:
        return json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise InputError(f"a message is not JSON: {str(error)[:_SHOWN]}") from None


def check_description(value: Any) -> dict[str, Any]:
    """Return `value` if it is a valid node description (keys.py)."""
    described = _check("a description", value, _DESCRIPTION)
    if "epoch_s" in described:
        _check("a description", described, {"epoch_s": _TIME})
    columns = described.get("columns")
    if not isinstance(columns, list) or not columns:
        raise InputError("a description has no columns")
    for column in columns:
        if set(_check("a column of a description", column, _COLUMN)) != set(_COLUMN):
            raise InputError(f"a column of a description has {', '.join(column)}; allowed are {', '.join(_COLUMN)}")
    return described


def check_last(value: Any) -> dict[str, Any]:
    """Return `value` if it is a valid newest row of a node (keys.py); its number is -1 before the first row."""
    last = _check("a newest row", value, {})
    row = last.get("row")
    if not isinstance(row, int) or isinstance(row, bool) or row < -1:
        raise InputError(f"a newest row has the number {_shorten(row)}; allowed is a whole number from -1")
    for entry in _check("the values of a newest row", last.get("values", {}), {}).values():
        _check("a value of a newest row", entry, {"value": _NUMBER_OR_NULL})
    return last


def check_event(value: Any) -> dict[str, Any]:
    """Return `value` if it is a valid parameter change (keys.py)."""
    event = _check("an event", value, _EVENT)
    if event["node"] not in NODES:
        raise InputError(f"an event is of the node {_shorten(event['node'])}; allowed are {', '.join(NODES)}")
    for name, kind in {"by": _TEXT, "clock_s": _NUMBER}.items():
        if name in event:
            _check("an event", event, {name: kind})
    return _check("an event of an injection", event, _INJECTION) if "injection" in event else event


def check_events(value: Any) -> list[dict[str, Any]]:
    """Return `value` if it is a valid list of parameter changes."""
    if not isinstance(value, list):
        raise InputError(f"events are {_shorten(value)}; a list is needed")
    return [check_event(event) for event in value]


def check_parameters(value: Any) -> list[dict[str, Any]]:
    """Return `value` if it is a valid list of a node's parameters (keys.py)."""
    if not isinstance(value, list):
        raise InputError(f"parameters are {_shorten(value)}; a list is needed")
    for entry in value:
        _check("a parameter", entry, _PARAMETER)
        bounds, fixed = entry.get("bounds"), entry.get("fixed", 0)
        if not (isinstance(bounds, list) and len(bounds) == 2 and all(_is(_ANY_NUMBER, bound) for bound in bounds)):
            raise InputError(f"a parameter has the bounds {_shorten(bounds)}; two numbers are needed")
        if not (fixed is None or isinstance(fixed, str)):
            raise InputError(f"a parameter has fixed = {_shorten(fixed)}; null or a text is needed")
    return value


def check_request(value: Any) -> dict[str, Any]:
    """Return `value` if it is a valid accepted request (keys.py)."""
    return _check("a request", value, _REQUEST)


def check_requests(value: Any) -> list[dict[str, Any]]:
    """Return `value` if it is a valid list of requests."""
    if not isinstance(value, list):
        raise InputError(f"requests are {_shorten(value)}; a list is needed")
    return [check_request(request) for request in value]


def _check(what: str, value: Any, needed: Mapping[str, str]) -> dict[str, Any]:
    """Return `value` if it is an object that has the entries `needed`, each of the required kind."""
    if not isinstance(value, dict):
        raise InputError(f"{what} is {_shorten(value)}; an object is needed")
    for name, kind in needed.items():
        if name not in value or not _is(kind, value[name]):
            raise InputError(f"{what} has {name} = {_shorten(value.get(name))}; {kind} is needed")
    return value


def _is(kind: str, value: Any) -> bool:
    if kind is _TEXT:
        return isinstance(value, str)
    if kind is _NUMBER_OR_NULL and value is None:
        return True
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return False
    if kind is _WHOLE:
        return isinstance(value, int) and 0 <= value < _MOST_WHOLE
    if kind is _TIME:
        return 0 <= value <= LATEST
    if kind is _ANY_NUMBER:
        return value == value  # bounds may be infinite
    try:
        return isfinite(value)
    except OverflowError:  # an integer too large for a float
        return False


def _shorten(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
