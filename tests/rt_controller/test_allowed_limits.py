"""The guard takes no limit in another unit, outside its own range, missing, or more than it knows."""

from types import SimpleNamespace

import pytest

from protocols.errors import InputError
from protocols.files.parameters import load_defaults
from rt_controller.guard.allowed_limits import check_limits
from rt_controller.loop.node import LIMITS


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"pressure": {"value": 12.0}}, "guard.pressure has 12 bar; allowed are 1 to 9.9 bar"),
        ({"pressure": {"bounds": (1.0, 50.0)}}, "guard.pressure has 50 bar; allowed are 1 to 9.9 bar"),
        ({"pressure": {"unit": "kPa"}}, "guard.pressure is in 'kPa'; it is needed in bar"),
        ({"motor_torque": {"value": -1.0}}, "guard.motor_torque has -1 Nm; allowed are 0 to 65 Nm"),
        ({"temperature": {"unit": "K"}}, "guard.temperature is in 'K'; it is needed in degC"),
        ({"stale_cycles": {"value": float("nan")}}, "guard.stale_cycles has nan cycles"),
        ({"voltage": None}, "the guard has no limit guard.voltage; it is needed in V"),
        ({"torque": {"value": 3.0}}, "the guard has no use for a limit guard.torque"),
    ],
)
def test_limits_that_protect_from_nothing_are_refused(changed: dict, words: str) -> None:
    shipped = {name: (one.value, one.unit, one.bounds) for name, one in load_defaults(LIMITS).items()}
    fields = {
        name: SimpleNamespace(value=value, unit=unit, bounds=bounds) for name, (value, unit, bounds) in shipped.items()
    }
    check_limits(fields)
    for name, change in changed.items():
        if change is None:
            del fields[f"guard.{name}"]
        else:
            before = vars(fields.get(f"guard.{name}", fields["guard.pressure"]))
            fields[f"guard.{name}"] = SimpleNamespace(**before | change)
    with pytest.raises(InputError, match=words):
        check_limits(fields)
