"""Injection: a change of the running plant at a time. An effect on or off, a parameter, a sensor that freezes or is biased.

Injection(effect_on("internal_leakage"), at=10.0, ramp=2.0, until=20.0)
Injection(sensor_frozen("pressure") | {"oil.sump_temperature": 90.0}, at=10.0)
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite

from plant_sim.effects.catalogue import effect
from protocols.errors import InputError, closest

WHEN = ("at", "after", "ramp", "until", "for")  # what a request from outside may say about time
FREEZE = "sensor_freeze"  # the effect that holds sensors, with a strength for each
_ROUNDED = 1e-9  # s by which decimal seconds may miss each other as floats
BIAS = {  # the effect that biases each of them
    "pressure": "pressure_sensor_offset",
    "temperature": "temperature_sensor_offset",
    "motor_torque": "motor_torque_sensor_offset",
    "clutch_torque": "torque_sensor_offset",
    "encoder": "encoder_offset",
}


@dataclass(frozen=True)
class Injection:
    """Parameters take `values`, by dotted name in declared units, from `at` on [s, rig time], along a line of `ramp` [s].

    At `until` [s] they go back to what they were at `at`, along such a line; where it is infinite they stay. Raises InputError
    for times that cannot be.
    """

    values: Mapping[str, float]
    at: float = 0.0
    ramp: float = 0.0
    until: float = inf

    def __post_init__(self) -> None:
        """Raise InputError when there is nothing to change, or a time cannot be."""
        if not self.values:
            raise InputError("an injection changes nothing; name a parameter and its value")
        for name, seconds in (("time", self.at), ("ramp", self.ramp)):
            if not (isfinite(seconds) and seconds >= 0.0):
                raise InputError(f"{name} {seconds:g} s of an injection is not possible; allowed are 0 s and more")
        if not self.until >= self.at + self.ramp - _ROUNDED:
            raise InputError(
                f"injection until {self.until:g} s is not possible; its ramp ends at {self.at + self.ramp:g} s"
            )
        if not self.until > self.at + _ROUNDED:
            raise InputError(f"injection from {self.at:g} s until {self.until:g} s is not possible: it would last 0 s")


def effect_on(name: str, given: Mapping[str, float] | None = None) -> dict[str, float]:
    """Values that switch an effect on: its parameters `given` by short name, or its strengths' typical values where no
    strength is given. Raises InputError."""
    one, given = effect(name), given or {}
    known = [p.name for p in one.parameters]
    for short in given:
        if short not in known:
            raise InputError(f"effect {name} has no parameter {short!r}; {closest(short, known)}")
    strengths = {} if any(s.name in given for s in one.strengths) else {s.name: s.typical for s in one.strengths}
    return {f"{name}.{short}": value for short, value in {**strengths, **given}.items()}


def effect_off(name: str) -> dict[str, float]:
    """Values that switch an effect off. Raises InputError."""
    return effect(name).off()


def sensor_frozen(sensor: str, frozen: bool = True) -> dict[str, float]:
    """Values that hold a sensor at what it shows, or release it. Raises InputError."""
    known = [s.name for s in effect(FREEZE).strengths]
    if sensor not in known:
        raise InputError(f"sensor {sensor!r} is unknown; {closest(sensor, known)}")
    return {f"{FREEZE}.{sensor}": float(frozen)}


def sensor_bias(sensor: str, value: float) -> dict[str, float]:
    """Values that let a sensor show `value` too much, in the unit of its effect. Raises InputError."""
    if sensor not in BIAS:
        raise InputError(f"sensor {sensor!r} is unknown; {closest(sensor, BIAS)}")
    (first, *_) = effect(BIAS[sensor]).strengths
    return {f"{BIAS[sensor]}.{first.name}": value}


def requested(values: Mapping[str, float], when: Mapping[str, float], now: float) -> Injection:
    """The injection that a request from outside asks for, at the rig time `now` [s]. Raises InputError.

    `when` has at most one of `at` [s, rig time] and `after` [s from now], `ramp` [s], at most one of `until` [s, rig time] and
    `for` [s from the ramp's end].
    """
    for name, seconds in when.items():
        if name not in WHEN:
            raise InputError(f"an injection has no {name!r}; {closest(name, WHEN)}")
        if isinstance(seconds, bool) or not isinstance(seconds, (int, float)):
            raise InputError(f"{name} of an injection is {seconds!r}; seconds are needed")
    for pair in (("at", "after"), ("until", "for")):
        if all(name in when for name in pair):
            raise InputError(f"an injection was given {pair[0]!r} and {pair[1]!r}; allowed is one of them")
    at = when.get("at", now + when.get("after", 0.0))
    ramp = when.get("ramp", 0.0)
    return Injection(values, at, ramp, when.get("until", at + ramp + when.get("for", inf)))
