"""The parameters of a controller and its guard: the shipped files, changed by a user's, completed and checked."""

import os
from collections.abc import Collection
from pathlib import Path

from protocols.can.frames import FrameCodec
from protocols.can.two_clutches import CLUTCHES, CONTROLLERS
from protocols.errors import InputError
from protocols.files.parameters import CONTROLLER, ParameterSet, list_changed, load_defaults, load_overlay
from rt_controller.guard.allowed_limits import check_limits
from rt_controller.guard.layout import LAYOUT_VALUES
from rt_controller.law.clutch_size import scale_size
from rt_controller.law.contact_maps import shift_maps
from rt_controller.law.valve_gains import Valve, scale_gains

PARAMETERS = Path(__file__).parents[1] / "parameters" / "controller.toml"
# Rigs with one and with two clutches that the law applies to. A calibration of another rig is refused
RIG, RIG_OF_TWO = "wet_clutch", "power_shift"
LIMITS = Path(__file__).parents[1] / "parameters" / "limits.toml"
OWN_LIMITS = "CLUTCH_HIL_LIMITS"  # environment variable: file of changed limits of the guard, e.g. of a larger bench
# Limit of the law -> limit of the guard. If the law's limit is higher, every demand that reaches it ends in a fault
_GUARDED = {
    "pressure.voltage_limit": "guard.voltage", "pressure.slow_above": "guard.pressure",
    "torque.pressure_limit": "guard.pressure", "lock.pressure_limit": "guard.pressure",
    "phases.motor_torque_limit": "guard.motor_torque", "phases.speed_limit": "guard.slip_speed",
}  # fmt: skip
# Limit or band of the law -> limit of the guard. If a user changes only the guard's limit, the law's scales in proportion
_FOLLOWING = {
    "phases.motor_torque_limit": "guard.motor_torque", "phases.speed_limit": "guard.slip_speed",
    "torque.demand_limit": "guard.motor_torque", "pressure.voltage_limit": "guard.voltage",
    "pressure.slow_above": "guard.pressure", "torque.pressure_limit": "guard.pressure", "lock.pressure_limit": "guard.pressure",
    # multiples of the noise and of the counts of the pressure
    "phases.contact_band": "guard.pressure_range", "phases.frozen_change": "guard.pressure_range",
}  # fmt: skip
# Pressures that rise from an open clutch to a filled one
_RISING = (
    ("phases.released_pressure", "model.contact_pressure"), ("phases.lost_pressure", "model.contact_pressure"),
    ("model.contact_pressure", "phases.fill_pressure"), ("model.contact_pressure", "torque.pressure_limit"),
)  # fmt: skip
# Pressures that keep their share of the contact pressure, and one that keeps its distance, where a user changes only that
_CONTACT, _FILL, _SLOPE = "model.contact_pressure", "phases.fill_pressure", "model.coulomb_slope"
_SHARES_OF_CONTACT = ("phases.released_pressure", "phases.lost_pressure", "pressure.floor")


def load_controller_parameters(changed: Path | None = None, clutch: str | None = None) -> ParameterSet:
    """Return the parameters of `controller.toml`, changed by a user's file if given. Raises InputError.

    The file may leave out what follows its clutch, see `follow_clutch`. clutch: a or b if there are two clutches; selects the
    part of a calibration.
    """
    shipped = load_defaults(PARAMETERS)
    if changed is None:
        return shipped
    part = name_calibration_part(clutch)
    own = load_overlay(changed, shipped, part, RIG_OF_TWO if clutch else RIG)
    return own.with_values(follow_clutch(own, list_changed(changed, part)))


def follow_clutch(parameters: ParameterSet, given: Collection[str]) -> dict[str, float]:
    """Return what follows contact pressure, valve and torque of `parameters`, by dotted name; arguments of `follow_contact`."""
    shipped = load_defaults(PARAMETERS)
    scaled = _scale(parameters, shipped, given)
    return follow_contact(parameters, given) | shift_maps(parameters, shipped, given) | scaled


def _scale(parameters: ParameterSet, shipped: ParameterSet, given: Collection[str]) -> dict[str, float]:
    """Return what follows valve and torque, within its bounds; `shipped`: the parameters of `controller.toml`."""
    valve = scale_gains(Valve.of(parameters), Valve.of(shipped))
    size = scale_size(parameters[_SLOPE].value / shipped[_SLOPE].value)
    scaled = {}
    for name in (valve.keys() | size.keys()) - set(given):
        low, high = parameters[name].bounds
        scaled[name] = min(max(valve.get(name, 1.0) * size.get(name, 1.0) * shipped[name].value, low), high)
    return scaled


def follow_contact(parameters: ParameterSet, given: Collection[str]) -> dict[str, float]:
    """Return the pressures that follow the contact pressure of `parameters`, by dotted name, each in its declared unit.

    They keep their position relative to the contact pressure of `controller.toml`, within their bounds: an open clutch must
    have less, a filled one more. given: names that the user set, which do not follow.
    """
    shipped = load_defaults(PARAMETERS)
    contact, was = parameters[_CONTACT].value, shipped[_CONTACT].value
    share, more = contact / was, contact - was  # exactly 1 and 0 with the shipped contact pressure
    following = {name: shipped[name].value * share for name in _SHARES_OF_CONTACT}
    following[_FILL] = shipped[_FILL].value + more
    bounds = {name: parameters[name].bounds for name in following}
    return {
        name: min(max(value, bounds[name][0]), bounds[name][1])
        for name, value in following.items()
        if name not in given
    }


def name_calibration_part(clutch: str | None) -> str:
    """Return the name of the calibration part for the controller of `clutch`: a, b, or None for a single clutch."""
    return CONTROLLERS[CLUTCHES.index(clutch)] if clutch else CONTROLLER


def load_limits() -> ParameterSet:
    """Return the guard's limits: those of `limits.toml`, changed by the file that OWN_LIMITS names. Raises InputError."""
    shipped = load_defaults(LIMITS)
    own = os.environ.get(OWN_LIMITS)
    limits = load_overlay(Path(own), shipped) if own else shipped
    check_limits(limits)
    return limits


def select_layout_values(limits: ParameterSet) -> dict[str, float]:
    """Return those of the guard's `limits` that describe the database, as `check_layout` takes them."""
    return {name: limits[f"guard.{name}"].value for name in LAYOUT_VALUES}


def load_shipped_parameters() -> ParameterSet:
    """Return the default parameters of controller and guard."""
    return ParameterSet({**load_defaults(PARAMETERS), **load_limits()})


def load_node_parameters(changed: Path | None = None, clutch: str | None = None) -> ParameterSet:
    """Return the parameters of controller and guard, those of the controller changed by a user's file if given.

    Limits of the law that the user left alone follow the guard's. clutch: see `load_controller_parameters`. Raises InputError,
    also for parameters that contradict each other.
    """
    limits = load_limits()
    parameters = ParameterSet({**_follow_guard(load_controller_parameters(changed, clutch), limits), **limits})
    check_parameters(parameters)
    return parameters


def _follow_guard(own: ParameterSet, limits: ParameterSet) -> ParameterSet:
    """Return the controller's parameters with those of _FOLLOWING scaled to the guard's `limits`.

    Only parameters that have their default values are scaled. They stay within their own bounds.
    """
    shipped, guarded = load_defaults(PARAMETERS), load_defaults(LIMITS)
    ratios = {name: limits[guard].value / guarded[guard].value for name, guard in _FOLLOWING.items()}
    return own.with_values(
        {
            name: min(max(ratio * own[name].value, own[name].bounds[0]), own[name].bounds[1])
            for name, ratio in ratios.items()
            if own[name].value == shipped[name].value
        }
    )


def check_slip_limit(limits: ParameterSet, motor: FrameCodec) -> None:
    """Raise InputError for a slip limit that no speed demand of this bench can reach."""
    slip, most = limits["guard.slip_speed"], motor.scale["speed_demand"] * 2 ** (motor.bits["speed_demand"] - 1)
    if slip.value > most:
        where = f" of {own}" if (own := os.environ.get(OWN_LIMITS)) else ""
        raise InputError(
            f"the guard's limit guard.slip_speed{where} has {slip.value:g} rad/s; allowed is up to {most:g} rad/s, which the"
            " frames of this bench carry; `clutch-hil frames --speed` makes frames for higher speeds"
        )


def check_parameters(parameters: ParameterSet) -> None:
    """Raise InputError for parameters that contradict each other."""
    for own, limit in _GUARDED.items():
        value, allowed = parameters[own], parameters[limit]
        if value.value > allowed.value:
            raise InputError(
                f"parameter {own} = {value.value:g} {value.unit} is above the guard's limit of {allowed.value:g} {allowed.unit}"
            )
    for lower, higher in _RISING:
        low, high = parameters[lower], parameters[higher]
        if low.value >= high.value:
            raise InputError(
                f"parameter {lower} = {low.value:g} {low.unit} is not below {higher} = {high.value:g} {high.unit}; the clutch"
                " could not be filled, or would count as open while it is closed: change one of them"
            )
    if parameters["driveline.ratio_a"].value == parameters["driveline.ratio_b"].value:
        same = parameters["driveline.ratio_a"].value
        raise InputError(f"parameters driveline.ratio_a and driveline.ratio_b are both {same:g}; two gears must differ")
