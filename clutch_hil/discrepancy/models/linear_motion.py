"""Linear motion: effects of the catalogue as candidates of a contact that moves along a straight path.

The effects are those of the rotating clutch at a lever of 1 m: torque [Nm] and force [N], angle [rad] and path [m] then have
the same number. There are three differences. Bounds of the parameters follow from the size of the rig. A ripple has a `period`
instead of an `order` per turn. Friction of the baseline does not decrease with speed.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import pi

from clutch_hil.fitting.model import Candidate, Values
from plant_sim.effects.catalogue import find_effect
from plant_sim.effects.effect import Effect, Shape, Strength
from protocols.files.units import to_si

PERIOD = "period"
STRIBECK_DEPTH = 0.5  # 1 - beta for a depth of 1: friction decreases to half at high speed
_LAWS = "\n(M: friction force, theta: path, omega: speed; at a lever of 1 m)"


@dataclass(frozen=True)
class Scale:
    """Size of a rig: largest friction force [N], speed [m/s], path [m] and, where the load is known, load [N]."""

    force: float
    speed: float
    path: float
    load: float = 0.0


def make_candidates(scale: Scale, names: Iterable[str]) -> tuple[Candidate, ...]:
    """Return the effects `names` as candidates of a rig of size `scale`."""
    known = _scale_parameters(scale)
    return tuple(_make_candidate(find_effect(name), known[name]) for name in names)


def convert_law_values(candidate: Candidate, values: Values) -> list[float]:
    """Return an effect's parameters in SI, as its laws take them, from `values` by dotted name in the candidate's units."""
    own = {p.name: to_si(values.get(f"{candidate.name}.{p.name}", p.off), p.unit) for p in candidate.parameters}
    if PERIOD in own:
        own["order"] = 2.0 * pi / own[PERIOD]
    return [own.get(p.name, to_si(p.off, p.unit)) for p in find_effect(candidate.name).parameters]


def _make_candidate(one: Effect, parameters: tuple[Strength | Shape, ...]) -> Candidate:
    candidate = Candidate.of(one)
    return replace(candidate, parameters=parameters, equation=candidate.equation + _LAWS)


def _scale_parameters(s: Scale) -> Mapping[str, tuple[Strength | Shape, ...]]:
    """Return the parameters of each effect for a rig of this size."""
    size = "[D] by the size of the rig"
    millimetres = 1e3 * s.path
    ripple = (
        Shape(PERIOD, "mm", 0.01 * millimetres, (0.002 * millimetres, 0.2 * millimetres), f"{size}: of its path"),
        Shape("phase", "rad", 0.5, (-3.2, 3.2), "[D] where the zero of the path happens to be"),
    )
    return {
        "direction_asymmetry": (
            _find_parameter("direction_asymmetry", "asymmetry"),
            _find_parameter("direction_asymmetry", "viscous_part"),
        ),
        "position_ripple": (Strength("amplitude", "N", 0.0, 0.05 * s.force, (0.0, s.force), size), *ripple),
        "shaft_angle_ripple": (_find_parameter("shaft_angle_ripple", "amplitude"), *ripple),
        "motor_torque_ripple": (_find_parameter("motor_torque_ripple", "amplitude"), *ripple),
        "presliding": (
            Strength("angle", "m", 0.0, 0.01 * s.path, (0.0, 0.5 * s.path), f"{size}: path to break-away"),
            _find_parameter("presliding", "spread"),
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
            _find_parameter("friction_fade", "recovery"),
        ),
        "friction_level": (_find_parameter("friction_level", "drift"),),
        "load_dependent_friction": (
            _find_parameter("load_dependent_friction", "fall"),
            Shape("load", "N", max(s.load, 1.0), (0.05 * max(s.load, 1.0), 20.0 * max(s.load, 1.0)), size),
        ),
        "piston_seal_friction": (
            _find_parameter("piston_seal_friction", "pressure_slope"),
            Shape("travel", "m", 1e-4, (1e-6, 1e-2), "[D] pre-sliding travel of an elastomer lip and its groove"),
        ),
        "torque_sensor_offset": (Strength("offset", "N", 0.0, 0.05 * s.force, (-s.force, s.force), size),),
        "torque_sensor_gain": (_find_parameter("torque_sensor_gain", "gain"),),
        "torque_sensor_leakage": (_find_parameter("torque_sensor_leakage", "decay_rate"),),
        "torque_time_offset": (_find_parameter("torque_time_offset", "delay"),),
    }  # fmt: skip


def _find_parameter(name: str, parameter: str) -> Strength | Shape:
    """Return a parameter of an effect, unchanged from the catalogue."""
    return next(p for p in find_effect(name).parameters if p.name == parameter)
