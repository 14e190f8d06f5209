"""Messages in JSON: a right one passes, any other is one sentence."""

import json
from collections.abc import Callable
from typing import Any

import pytest

from protocols.errors import InputError
from protocols.telemetry.message import (
    check_description,
    check_event,
    check_events,
    check_last,
    check_parameters,
    parse_message,
)

DESCRIPTION = {"session": 7, "columns": [{"name": "time_s", "unit": "s", "meaning": "time"}], "rig": "wet_clutch"}
EVENT = {"node": "plant", "name": "a.b", "unit": "Nm", "old": None, "new": 2.0, "time": 1.7e9, "row": 5}
INJECTED = EVENT | {"injection": "started", "at": 1.0, "ramp": 0.5}
PARAMETER = {
    "name": "a.b", "value": 1.0, "unit": "Nm", "default": 1.0, "source": "[D]", "uncertainty": 0.0,
    "bounds": [0.0, float("inf")], "fixed": None,
}  # fmt: skip
RUBBISH = [None, True, 3, -1.5, "text", [], {}, [[]], [None], {"a": 1}, 10**400, float("nan"), float("inf"), {"": {}}]


@pytest.mark.parametrize(
    ("check", "right"),
    [
        (check_description, DESCRIPTION), (check_last, {"row": -1, "values": {}}), (check_last, {"row": 10**12}),
        (check_event, EVENT), (check_event, INJECTED), (check_events, []), (check_events, [EVENT, INJECTED]),
        (check_parameters, [PARAMETER, PARAMETER | {"fixed": "a limit"}]), (check_parameters, []),
    ],
)  # fmt: skip
def test_what_services_send_passes(check: Callable[[Any], Any], right: Any) -> None:
    assert check(parse_message(json.dumps(right).encode())) == right


@pytest.mark.parametrize("check", [check_description, check_last, check_event])
@pytest.mark.parametrize("rubbish", RUBBISH)
def test_rubbish_is_refused(check: Callable[[Any], Any], rubbish: Any) -> None:
    with pytest.raises(InputError):
        check(rubbish)


@pytest.mark.parametrize(("check", "right"), [(check_description, DESCRIPTION), (check_event, INJECTED)])
@pytest.mark.parametrize("rubbish", [None, True, -1, [], {}, float("nan"), 10**400])
def test_a_wrong_or_missing_entry_is_refused(check: Callable[[Any], Any], right: dict[str, Any], rubbish: Any) -> None:
    needed = set(right) - {"rig", "injection"}
    for name in needed:
        with pytest.raises(InputError):
            check({key: value for key, value in right.items() if key != name})
        allowed = {"old": [None, -1], "new": [-1], "at": [-1], "ramp": [-1]}
        if rubbish not in allowed.get(name, []):
            with pytest.raises(InputError):
                check(right | {name: rubbish})
    if "time" in right:
        with pytest.raises(InputError, match="an event has time = 1e\\+300; a UNIX time"):
            check(right | {"time": 1e300})
    for name, one in {"epoch_s": check_description, "clock_s": check_event}.items():
        if check is one:
            assert check(right | {name: 5.0})[name] == 5.0
            with pytest.raises(InputError, match=f"has {name} = "):
                check(right | {name: rubbish if rubbish != -1 else "-1"})
    with pytest.raises(InputError, match="events are 3"):
        check_events(3)


@pytest.mark.parametrize("values", [None, 3, [], {"a": None}, {"a": 1.0}, {"a": {}}, {"a": {"value": "1"}}])
def test_values_of_a_newest_row_that_are_none_are_refused(values: Any) -> None:
    with pytest.raises(InputError, match=r"value.* of a newest row "):
        check_last({"row": 1, "values": values})
    assert check_last({"row": 1, "values": {"a": {"value": None}, "b": {"value": 1.0, "unit": "bar"}}})


@pytest.mark.parametrize(
    "payload", [b"", b"{", b"\xff\xfe", b"[" * 100_000, b"1" * 5000, b'{"a": 1' + b" " * (17 << 20) + b"}"]
)
def test_what_is_no_json_or_too_much_is_refused(payload: bytes) -> None:
    with pytest.raises(InputError, match="a message "):
        parse_message(payload)


@pytest.mark.parametrize(
    "wrong",
    [
        {"name": None}, {"value": "1"}, {"value": float("nan")}, {"default": None}, {"bounds": [0.0]}, {"bounds": [0.0, "1"]},
        {"bounds": [0.0, float("nan")]}, {"bounds": None}, {"fixed": 1}, {"unit": 3}, {"source": []}, {"uncertainty": True},
    ],
)  # fmt: skip
def test_wrong_parameters_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        check_parameters([PARAMETER, PARAMETER | wrong])


@pytest.mark.parametrize("rubbish", [r for r in RUBBISH if r != []])
def test_what_is_no_list_of_parameters_is_refused(rubbish: Any) -> None:
    with pytest.raises(InputError):
        check_parameters(rubbish)
