"""Injection: a change of parameters of the running plant at a given time.

It switches an effect or a fault of the bus on or off, changes a parameter, or freezes or biases a sensor:

Injection(switch_on("internal_leakage"), at=10.0, ramp=2.0, until=20.0)
Injection(switch_on("frame_delay", {"commands": 20.0}), at=10.0)
Injection(freeze_sensor("pressure") | {"oil.sump_temperature": 90.0}, at=10.0)
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

from plant_sim.bus_faults.bus_fault import BusFault
from plant_sim.bus_faults.catalogue import BUS_FAULTS
from plant_sim.effects.catalogue import find_effect, load_effects
from plant_sim.effects.effect import Effect, Strength
from protocols.errors import InputError, suggest_closest

TIME_KEYS = ("at", "after", "ramp", "until", "for")  # keys of a request that give times [s]
_SHOWN = 60  # characters of a wrong name or value in a message
FREEZE = "sensor_freeze"  # effect that holds sensor signals; it has one strength for each sensor
LATEST = 1e9  # s: 30 years; times of samples are exact to a microsecond up to there
_TIME_TOLERANCE = 1e-9  # s: rounding error of decimal times as floats
BIAS = {  # effect that biases each sensor
    "pressure": "pressure_sensor_offset",
    "temperature": "temperature_sensor_offset",
    "motor_torque": "motor_torque_sensor_offset",
    "clutch_torque": "torque_sensor_offset",
    "encoder": "encoder_offset",
}


@dataclass(frozen=True)
class Injection:
    """A change of parameters to `values`, which are by dotted name and in declared units.

    The change begins at `at` [s, rig time] and is linear over `ramp` [s]. At `until` [s] the parameters begin to return, over a
    ramp of the same length, to their values at `at`; with an infinite `until` they stay. Raises InputError for impossible
    times.
    """

    values: Mapping[str, float]
    at: float = 0.0
    ramp: float = 0.0
    until: float = inf

    def __post_init__(self) -> None:
        """Raise InputError for an injection without values, or an impossible time."""
        if not self.values:
            raise InputError("an injection changes nothing; give a parameter and its value")
        for name, seconds in (("time", self.at), ("ramp", self.ramp)):
            if not 0.0 <= seconds <= LATEST:
                raise InputError(f"{name} {seconds:g} s of an injection is not possible; allowed are 0 to {LATEST:g} s")
        if not (self.until <= LATEST or self.until == inf):
            raise InputError(f"injection until {self.until:g} s is not possible; allowed are times up to {LATEST:g} s")
        if not self.until >= self.at + self.ramp - _TIME_TOLERANCE:
            raise InputError(
                f"injection until {self.until:g} s is not possible; its ramp ends at {self.at + self.ramp:g} s"
            )
        if not self.until > self.at + _TIME_TOLERANCE:
            raise InputError(f"injection from {self.at:g} s until {self.until:g} s is not possible: it would last 0 s")


def switch_on(name: str, given: Mapping[str, float] | None = None) -> dict[str, float]:
    """Return the parameter values that switch an effect or a fault of the bus on, by dotted name.

    `given` are values by short name. If they contain no strength, all strengths get their typical values. Raises InputError for
    an unknown name or parameter.
    """
    chosen, given = _find_switchable(name), given or {}
    known = [p.name for p in chosen.parameters]
    for short in given:
        if short not in known:
            kind = "bus fault" if name in BUS_FAULTS else "effect"
            raise InputError(f"{kind} {name} has no parameter {short!r}; {suggest_closest(short, known)}")
    every = [p for p in chosen.parameters if isinstance(p, Strength)]
    strengths = {} if any(s.name in given for s in every) else {s.name: s.typical for s in every}
    return {f"{name}.{short}": value for short, value in {**strengths, **given}.items()}


def switch_off(name: str) -> dict[str, float]:
    """Return the values that switch an effect or a fault of the bus off. Raises InputError for an unknown name."""
    return _find_switchable(name).list_off_values()


def _find_switchable(name: str) -> Effect | type[BusFault]:
    """Return the bus fault or effect of that name. Raises InputError that names the closest."""
    if name in BUS_FAULTS:
        return BUS_FAULTS[name]
    if name in load_effects():
        return find_effect(name)
    raise InputError(f"effect {name!r} is unknown; {suggest_closest(name, [*load_effects(), *BUS_FAULTS])}")


def freeze_sensor(sensor: str, frozen: bool = True) -> dict[str, float]:
    """Return the values that hold a sensor at its present signal, or release it. Raises InputError for an unknown sensor."""
    known = [s.name for s in find_effect(FREEZE).strengths]
    if sensor not in known:
        raise InputError(f"sensor {sensor!r} is unknown; {suggest_closest(sensor, known)}")
    return {f"{FREEZE}.{sensor}": float(frozen)}


def bias_sensor(sensor: str, value: float) -> dict[str, float]:
    """Return the values that add `value`, in the unit of the effect, to a sensor. Raises InputError for an unknown sensor."""
    if sensor not in BIAS:
        raise InputError(f"sensor {sensor!r} is unknown; {suggest_closest(sensor, BIAS)}")
    (first, *_) = find_effect(BIAS[sensor]).strengths
    return {f"{BIAS[sensor]}.{first.name}": value}


def parse_injection(values: Mapping[str, float], when: Mapping[str, float], now: float) -> Injection:
    """Return the injection for a request that arrives over telemetry at the rig time `now` [s].

    `when` may contain `at` [s, rig time] or `after` [s from now]; `ramp` [s]; `until` [s, rig time] or `for` [s after the end
    of the ramp]. Raises InputError for another key, for a value that is not a number, and for both keys of a pair.
    """
    for name, seconds in when.items():
        if name not in TIME_KEYS:
            raise InputError(
                f"an injection has no entry {name[:_SHOWN]!r}; {suggest_closest(name[:_SHOWN], TIME_KEYS)}"
            )
        if isinstance(seconds, bool) or not isinstance(seconds, (int, float)) or not abs(seconds) <= LATEST:
            raise InputError(
                f"{name} of an injection is {str(seconds)[:_SHOWN]}; it must be a time in s, at most {LATEST:g}"
            )
    for pair in (("at", "after"), ("until", "for")):
        if all(name in when for name in pair):
            raise InputError(
                f"{pair[0]!r} and {pair[1]!r} of an injection were both given; only one of them is allowed"
            )
    at = when.get("at", now + when.get("after", 0.0))
    ramp = when.get("ramp", 0.0)
    return Injection(values, at, ramp, when.get("until", at + ramp + when.get("for", inf)))
