"""Effects of the catalogue as candidates of a contact that moves straight.

The plug-ins are those of the turning clutch, put at a lever of 1 m: torque [Nm] and force [N], angle [rad] and path [m] are the
same number. What changes is how far each parameter may go, which follows from the size of the rig; that a ripple has a `period`
in place of an `order` a turn; and that friction which does not fall with speed is what the baseline has.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import pi

from clutch_hil.discrepancy.model import Candidate, Values
from plant_sim.effects.catalogue import effect
from plant_sim.effects.effect import Effect, Shape, Strength
from protocols.files.units import to_si

PERIOD = "period"
STRIBECK_DEPTH = 0.5  # 1 - beta that a depth of 1 means: friction falls to half at high speed
_LAWS = "\n(M: friction force, theta: path, omega: speed; at a lever of 1 m)"


@dataclass(frozen=True)
class Scale:
    """Size of a rig: greatest friction force [N], speed [m/s], path [m] and, where the load is known, load [N]."""

    force: float
    speed: float
    path: float
    load: float = 0.0


def candidates(scale: Scale, names: Iterable[str]) -> tuple[Candidate, ...]:
    """The effects `names` as candidates of a rig of size `scale`."""
    known = _declared(scale)
    return tuple(_candidate(effect(name), known[name]) for name in names)


def law_values(candidate: Candidate, values: Values) -> list[float]:
    """SI values of an effect's parameters as its laws take them, from `values` by dotted name in the candidate's units."""
    own = {p.name: to_si(values.get(f"{candidate.name}.{p.name}", p.off), p.unit) for p in candidate.parameters}
    if PERIOD in own:
        own["order"] = 2.0 * pi / own[PERIOD]
    return [own.get(p.name, to_si(p.off, p.unit)) for p in effect(candidate.name).parameters]


def _candidate(one: Effect, parameters: tuple[Strength | Shape, ...]) -> Candidate:
    candidate = Candidate.of(one)
    return replace(candidate, parameters=parameters, equation=candidate.equation + _LAWS)


def _declared(s: Scale) -> Mapping[str, tuple[Strength | Shape, ...]]:
    """Parameters by effect."""
    size = "[D] by the size of the rig"
    millimetres = 1e3 * s.path
    ripple = (
        Shape(PERIOD, "mm", 0.01 * millimetres, (0.002 * millimetres, 0.2 * millimetres), f"{size}: of its path"),
        Shape("phase", "rad", 0.5, (-3.2, 3.2), "[D] where the zero of the path happens to be"),
    )
    return {
        "direction_asymmetry": (
            _plain("direction_asymmetry", "asymmetry"),
            _plain("direction_asymmetry", "viscous_part"),
        ),
        "position_ripple": (Strength("amplitude", "N", 0.0, 0.05 * s.force, (0.0, s.force), size), *ripple),
        "shaft_angle_ripple": (_plain("shaft_angle_ripple", "amplitude"), *ripple),
        "motor_torque_ripple": (_plain("motor_torque_ripple", "amplitude"), *ripple),
        "presliding": (
            Strength("angle", "m", 0.0, 0.01 * s.path, (0.0, 0.5 * s.path), f"{size}: path to break-away"),
            _plain("presliding", "spread"),
        ),
        "stribeck_change": (
            Strength("depth", "1", 0.0, 0.4, (-1.9, 1.9), f"[D] times {STRIBECK_DEPTH}; negative: friction rises with speed"),
            Shape("speed", "m/s", 0.1 * s.speed, (1e-3 * s.speed, s.speed), size),
        ),
        "friction_lag": (
            Strength("attraction", "1", 1.0, 0.01, (1e-4, 1.0), "[D] of a baseline that follows its speed at once"),
        ),
        "friction_fade": (
            Strength("fade", "1/J", 0.0, 0.1 / (s.force * s.speed), (0.0, 10.0 / (s.force * s.speed)), f"{size}: of a second"),
            _plain("friction_fade", "recovery"),
        ),
        "friction_level": (_plain("friction_level", "drift"),),
        "load_dependent_friction": (
            _plain("load_dependent_friction", "fall"),
            Shape("load", "N", max(s.load, 1.0), (0.05 * max(s.load, 1.0), 20.0 * max(s.load, 1.0)), size),
        ),
        "piston_seal_friction": (
            _plain("piston_seal_friction", "pressure_slope"),
            Shape("travel", "m", 1e-4, (1e-6, 1e-2), "[D] pre-sliding travel of an elastomer lip and its groove"),
        ),
        "torque_sensor_offset": (Strength("offset", "N", 0.0, 0.05 * s.force, (-s.force, s.force), size),),
        "torque_sensor_gain": (_plain("torque_sensor_gain", "gain"),),
        "torque_sensor_leakage": (_plain("torque_sensor_leakage", "decay_rate"),),
        "torque_time_offset": (_plain("torque_time_offset", "delay"),),
    }  # fmt: skip


def _plain(name: str, parameter: str) -> Strength | Shape:
    """A parameter as the catalogue has it."""
    return next(p for p in effect(name).parameters if p.name == parameter)
