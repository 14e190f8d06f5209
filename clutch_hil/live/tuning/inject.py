"""`clutch-hil inject`: change effects, parameters and sensors of a running plant over zenoh, now or at a later time."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import zenoh

from clutch_hil.bench.progress import format_table
from clutch_hil.live.tuning.bench_faults import list_bench_faults
from clutch_hil.live.tuning.catalogue import format_step, with_unit
from clutch_hil.live.tuning.tune import read_reply, request_parameters
from plant_sim.bus_faults.catalogue import BUS_FAULTS, PARAMETERS
from plant_sim.effects.catalogue import load_effects
from plant_sim.node.injection import bias_sensor, freeze_sensor, switch_off, switch_on
from protocols.can.two_clutches import CLUTCHES
from protocols.errors import InputError, format_count, suggest_closest
from protocols.files.other_units import parse_number
from protocols.telemetry.feed import ask, find_bench
from protocols.telemetry.keys import Keys, find_bus
from protocols.telemetry.lab import find_asker_name
from protocols.telemetry.message import check_description, check_events
from protocols.telemetry.session import open_consumer_session

_TIMEOUT = 5.0  # s for an injection: the plant needs one cycle, and its publisher gives up after 2 s
_PLANT_PREFIX = "plant."  # allowed before a name, because `clutch-hil tune` shows it


def parse_values(
    words: Sequence[str], off: bool, freeze: Sequence[str], bias: Sequence[str], find_unit: Callable[[str], str]
) -> dict[str, float]:
    """Return values by dotted name, in declared units, from the words of the command. Raises InputError.

    words: names of effects, SHORT=VALUE of the effect before it, or GROUP.NAME=VALUE. freeze: names of sensors. bias:
    SENSOR=VALUE. off: switches effects off, releases frozen sensors and removes biases. A VALUE may have another unit, as in
    `34 psi`; `find_unit` then returns the declared unit by dotted name.
    """
    given: dict[str, dict[str, float]] = {}  # by effect
    values: dict[str, float] = {}
    biases: dict[str, float] = {}
    for word in words:
        name, equals, text = word.removeprefix(_PLANT_PREFIX).partition("=")
        if not equals:
            if "." in name:
                raise InputError(f"parameter {name} has no value; write {name}=VALUE")
            switch_off(name)
            _add_once(given, name, {})
        elif off:
            raise InputError(f"{word!r} and --off cannot be combined; an effect that is switched off needs no value")
        elif "." in name:
            _add_once(values, name, _parse_number(word, name, text, find_unit))
        elif not given:
            raise InputError(f"{word!r} comes before any effect; write EFFECT {word}, or GROUP.{word}")
        else:
            effect = list(given)[-1]
            switch_on(effect, {name: 0.0})  # raises InputError for an unknown parameter
            _add_once(given[effect], name, _parse_number(word, f"{effect}.{name}", text, find_unit))
    for word in bias:
        sensor, equals, text = word.partition("=")
        if bool(equals) == off:
            raise InputError(f"--bias {word} is not possible; write --bias SENSOR=VALUE, or --bias SENSOR --off")
        (dotted,) = bias_sensor(sensor, 0.0)
        _add_once(biases, sensor, 0.0 if off else _parse_number(word, dotted, text, find_unit))
    return list_injection_values(given, values, freeze, biases, off)


def list_injection_values(
    effects: Mapping[str, Mapping[str, float]],
    plant: Mapping[str, float],
    freeze: Sequence[str],
    bias: Mapping[str, float],
    off: bool,
) -> dict[str, float]:
    """Return the values that an injection sets, by dotted name. Raises InputError for an unknown or repeated name.

    `effects`: their parameters by short name, typical strengths where none is given; `plant`: parameters by dotted name;
    `freeze`: sensors that keep their reading; `bias`: offset of each sensor, in the unit of the effect. `off` switches the
    effects off and releases the sensors.
    """
    values = dict(plant)
    parts = [switch_off(name) if off else switch_on(name, own) for name, own in effects.items()]
    parts += [freeze_sensor(sensor, not off) for sensor in freeze]
    parts += [bias_sensor(sensor, value) for sensor, value in bias.items()]
    for part in parts:
        for name, value in part.items():
            _add_once(values, name, value)
    return values


def inject(
    session: zenoh.Session,
    bench: str,
    values: Mapping[str, float],
    when: Mapping[str, float],
    by: str | None = None,
) -> list[dict[str, Any]]:
    """Inject `values` into the plant, all or none; return the planned changes, each with `at` [s] and `row`.

    when: see `plant_sim.node.injection.parse_injection`. by: name of the requester; the user of this process if None. Raises
    InputError with the plant's reason when it refuses, SilentError (tune.py) when it does not answer.
    """
    payload = json.dumps({"values": dict(values), **when})
    replies = session.get(
        Keys(bench, "plant").change_by(by or find_asker_name(None)), payload=payload, timeout=_TIMEOUT
    )
    return read_reply(bench, "plant", replies)["accepted"]


def find_unit(name: str, prefix: str, bus: str | None, router: str | None) -> str:
    """Return the unit of a parameter by dotted name: of an effect or a fault of the bus, or of the running plant.

    prefix: of the clutch in the plant, empty on a rig with one. Raises InputError.
    """
    group, _, short = name.partition(".")
    effects = load_effects()
    own = effects[group].parameters if group in effects else BUS_FAULTS[group].parameters if group in BUS_FAULTS else ()
    for parameter in own:
        if parameter.name == short:
            return parameter.unit
    with open_consumer_session(router) as session:
        entries = request_parameters(session, find_bench(session, bus, router), "plant")
    units = {str(entry["name"]): str(entry["unit"]) for entry in entries}
    if prefix + name not in units:
        raise InputError(f"parameter {prefix + name!r} is unknown; {suggest_closest(prefix + name, units)}")
    return units[prefix + name]


def run_injection(
    values: Mapping[str, float], when: Mapping[str, float], bus: str | None, router: str | None
) -> tuple[dict[str, Any], str, str, bool]:
    """Inject `values`; return document, text, verdict and True. Raises InputError."""
    by = find_asker_name(router)
    with open_consumer_session(router) as session:
        bench = find_bench(session, bus, router)
        about = ask(session, Keys(bench, "plant").describe, check_description, attempts=3) or {}
        _check_clutches(about, bench, values)
        accepted = inject(session, bench, values, when, by)
    warnings = list(_warn_of_end(about.get("profile_end_s"), accepted))
    lines = [f"read:    {format_count(len(values), 'value')} for the plant on {find_bus(bench)}"]
    lines += [f"{'wrote:   ' if not i else '         '}{describe_change(change)}" for i, change in enumerate(accepted)]
    lines += [f"warning: {text}" for text in warnings]
    first = min(change["at"] for change in accepted)
    verdict = (
        f"{format_count(len(accepted), 'change')} accepted, the first at {first:.3f} s of the plant, requested by {by}"
    )
    document = {"bench": bench, "accepted": accepted, "by": by, "warnings": warnings, "verdict": verdict}
    return document, "\n".join(lines), verdict, True


def _warn_of_end(end: Any, accepted: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield a warning for changes that begin after the `end` of the plant's profile [s]; it is None without a profile."""
    late = [change for change in accepted if isinstance(end, int | float) and change["at"] >= end]
    if late:
        yield (
            f"{format_count(len(late), 'change')} at {late[0]['at']:g} s or later: the profile ends at {end:g} s, and so does"
            " clutch-hil up; only a plant that was started alone continues"
        )


def _check_clutches(about: Mapping[str, Any], bench: str, values: Mapping[str, float]) -> None:
    """Raise InputError where `values` belong to a clutch, a or b, and the plant has only one."""
    named = [name for name in values if name.partition(".")[0] in CLUTCHES]
    if named and len(about.get("controllers", CLUTCHES)) == 1:
        raise InputError(
            f"{named[0]} names a clutch, but the plant on {find_bus(bench)} has only one: leave the name of the clutch out"
        )


def describe_change(change: Mapping[str, Any]) -> str:
    """Return a change as text for people."""
    along = f", along {change['ramp']:g} s" if change["ramp"] else ""
    return (
        with_unit(f"{change['name']}  {format_step(change['old'], change['new'])}", change["unit"])
        + f", at {change['at']:.3f} s (row {change['row']}){along}"
    )


def read_state(session: zenoh.Session, bench: str) -> dict[str, Any]:
    """Return the state of the running plant: whether `blind`, parameters `changed` from their default, changes `to_come`.

    Raises InputError when it does not answer.
    """
    entries = request_parameters(session, bench, "plant")
    events = ask(session, Keys(bench, "plant").events, check_events, attempts=3)
    about = ask(session, Keys(bench, "plant").describe, check_description, attempts=3)
    return {
        "bench": bench,
        "blind": bool((about or {}).get("blind")),
        "changed": [entry for entry in entries if entry["value"] != entry["default"]] + list_bus_faults(events or []),
        "to_come": list_planned(events or []),
    }


def show_state(bus: str | None, router: str | None) -> tuple[dict[str, Any], str, str, bool]:
    """Show the active and the planned changes of the running plant; return document, text, verdict and True.

    Raises InputError.
    """
    with open_consumer_session(router) as session:
        now = read_state(session, find_bench(session, bus, router))
    changed, planned = now["changed"], now["to_come"]
    now |= {"bench_faults": list_bench_faults(find_bus(now["bench"]).partition("~")[0])}
    rows = [("parameter", "now", "as shipped")]
    rows += [(e["name"], with_unit(f"{e['value']:.6g}", e["unit"]), f"{e['default']:.6g}") for e in changed]
    lines = [format_table(rows)] if changed else []
    lines += [f"to come: {describe_change(change)}" for change in planned]
    lines += [f"fault of the bench: {fault}" for fault in now["bench_faults"]]
    lines += [f"read:    the plant on {find_bus(now['bench'])}", "wrote:   nothing"]
    verdict = (
        f"{format_count(len(changed), 'parameter')} not as shipped, {format_count(len(planned), 'change')} planned"
    )
    if now["blind"]:
        verdict = "the plant is blind: it does not show what is on"
    return now | {"verdict": verdict}, "\n".join(lines), verdict, True


def list_bus_faults(events: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return parameters of bus faults that are not off, from the `events` of a plant, as entries of its parameters."""
    started = {e["name"]: e for e in events if e.get("injection") == "started" and e["name"] in PARAMETERS}
    entries = [
        {"name": name, "value": event["new"], "unit": event["unit"], "default": PARAMETERS[name].value}
        for name, event in started.items()
    ]
    return [entry for entry in entries if entry["value"] != entry["default"]]


def list_planned(events: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return changes by injections among the `events` of a node that are accepted and have not started; the next one first."""
    started = [(event["name"], event["row"]) for event in events if event.get("injection") == "started"]
    accepted = [event for event in events if event.get("injection") == "accepted"]
    waiting = [event for event in accepted if (event["name"], event["row"]) not in started]
    return sorted(waiting, key=lambda event: event["row"])


def _add_once(values: dict[str, Any], name: str, value: Any) -> None:
    if name in values:
        raise InputError(f"{name} was given twice")
    values[name] = value


def _parse_number(word: str, name: str, text: str, find_unit: Callable[[str], str]) -> float:
    if (value := parse_number(name, text, lambda: find_unit(name))) is None:
        raise InputError(f"{word!r} needs a number after the =")
    return value
