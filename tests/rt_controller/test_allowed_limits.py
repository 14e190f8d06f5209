"""The guard takes no limit in another unit, outside its own range, missing, or more than it knows. Each test has the module as
argument, so that it can run on mutants (tests/mutation)."""

from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import rt_controller.guard.allowed_limits
from protocols.errors import InputError
from protocols.files.parameters import load_defaults
from rt_controller.loop.parameter_sets import LIMITS

SHIPPED = {name: (one.value, one.unit, one.bounds) for name, one in load_defaults(LIMITS).items()}


@pytest.fixture(scope="module")
def allowed_limits() -> ModuleType:
    return rt_controller.guard.allowed_limits


def make_limits() -> dict[str, Any]:
    """The shipped limits, to be changed."""
    return {
        name: SimpleNamespace(value=value, unit=unit, bounds=bounds) for name, (value, unit, bounds) in SHIPPED.items()
    }


def test_limits_that_protect_from_nothing_are_refused(allowed_limits: ModuleType) -> None:
    for name, change, words in (
        (
            "pressure",
            {"value": 12.0},
            "the guard's limit guard.pressure has 12 bar; allowed is up to 9.9 bar, 99% of guard.pressure_range",
        ),
        ("pressure", {"bounds": (1.0, 70.0)}, "the guard's limit guard.pressure has 70 bar; allowed are 1 to 59.4 bar"),
        (
            "data_key",
            {"value": 2577.5},
            "the guard's limit guard.data_key has 2577.5; allowed is the whole number of the",
        ),
        ("pressure", {"unit": "kPa"}, "the guard's limit guard.pressure is in 'kPa'; it is needed in bar"),
        ("motor_torque", {"value": -1.0}, "the guard's limit guard.motor_torque has -1 Nm; allowed are 0 to 3500 Nm"),
        ("temperature", {"unit": "K"}, "the guard's limit guard.temperature is in 'K'; it is needed in degC"),
        ("stale_cycles", {"value": float("nan")}, "the guard's limit guard.stale_cycles has nan cycles; allowed are"),
        ("voltage", None, "the guard has no limit guard.voltage; it is needed in V, 0.1 to 9.9998"),
        ("torque", {"value": 3.0}, "the guard does not know the limit guard.torque; it knows stale_cycles, "),
    ):
        limits = make_limits()
        allowed_limits.check_limits(limits)
        if change is None:
            del limits[f"guard.{name}"]
        else:
            before = vars(limits.get(f"guard.{name}", limits["guard.pressure"]))
            limits[f"guard.{name}"] = SimpleNamespace(**before | change)
        with pytest.raises(InputError) as refused:
            allowed_limits.check_limits(limits)
        assert str(refused.value).startswith(words)


def test_a_range_ends_where_that_of_the_shipped_limit_does(allowed_limits: ModuleType) -> None:
    for name, (_, _, (low, high)) in SHIPPED.items():
        least, most = low - 1e-3 * (abs(low) or 1.0), high * 1.001
        for change in (
            {"value": least}, {"value": most}, {"bounds": (least, high)}, {"bounds": (low, most)},
        ):  # fmt: skip
            limits = make_limits()
            vars(limits[name]).update(change)
            with pytest.raises(InputError, match=name):
                allowed_limits.check_limits(limits)
        for end in (low, high):
            limits = make_limits()
            limits["guard.motor_range"].value, limits["guard.pressure_range"].value = 4600.0, 60.0
            limits[name].value = end
            allowed_limits.check_limits(limits)


def test_a_limit_of_the_motor_that_no_command_exceeds_is_refused(allowed_limits: ModuleType) -> None:
    for torque, most, refused in (
        (65.0, 65.536, False),
        (65.536, 65.536, True),
        (66.0, 65.536, True),
        (300.0, 393.2, False),
    ):
        limits = make_limits()
        limits["guard.motor_torque"].value, limits["guard.motor_range"].value = torque, most
        if refused:
            sentence = rf"guard\.motor_torque has {torque:g} Nm; allowed is less than guard\.motor_range, {most:g} Nm"
            with pytest.raises(InputError, match=sentence):
                allowed_limits.check_limits(limits)
        else:
            allowed_limits.check_limits(limits)


def test_a_slip_at_which_the_angle_wraps_between_two_samples_is_no_limit(allowed_limits: ModuleType) -> None:
    for speed, rate, refused in (
        (31.4, 50, False), (250.0, 50, False), (250.1, 50, True), (1000.0, 200, False), (1000.0, 199, True),
    ):  # fmt: skip
        limits = make_limits()
        limits["guard.slip_speed"].value = speed
        if refused:
            sentence = rf"guard\.slip_speed has {speed:g} rad/s; at {rate} Hz allowed is up to {5 * rate:g} rad/s"
            with pytest.raises(InputError, match=sentence):
                allowed_limits.check_speed(limits, rate)
        else:
            allowed_limits.check_speed(limits, rate)


def test_a_pressure_at_the_end_of_its_channel_is_no_limit(allowed_limits: ModuleType) -> None:
    for pressure, most, refused in ((9.9, 10.0, False), (9.901, 10.0, True), (24.75, 25.0, False), (24.76, 25.0, True)):
        limits = make_limits()
        limits["guard.pressure"].value, limits["guard.pressure_range"].value = pressure, most
        if refused:
            allowed = rf"up to {0.99 * most:g} bar, 99% of guard\.pressure_range"
            sentence = rf"guard\.pressure has {pressure:g} bar; allowed is {allowed}"
            with pytest.raises(InputError, match=sentence):
                allowed_limits.check_limits(limits)
        else:
            allowed_limits.check_limits(limits)


def test_of_limits_that_the_guard_does_not_know_the_first_is_told(allowed_limits: ModuleType) -> None:
    limits = make_limits()
    for name in ("torque", "current", "speed"):
        limits[f"guard.{name}"] = limits["guard.pressure"]
    with pytest.raises(
        InputError, match=r"does not know the limit guard\.current; it knows stale_cycles, .*, frozen_dwell$"
    ):
        allowed_limits.check_limits(limits)


def test_parameters_of_others_are_no_limits(allowed_limits: ModuleType) -> None:
    limits = make_limits() | {"phases.pressure": make_limits()["guard.voltage"]}
    allowed_limits.check_limits(limits)
    limits["phases.voltage"] = limits.pop("guard.voltage")
    with pytest.raises(InputError, match=r"the guard has no limit guard\.voltage"):
        allowed_limits.check_limits(limits)
