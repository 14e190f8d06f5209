"""`clutch-hil inject` for faults of processes and of the computer: request them from this user's `clutch-hil up`."""

from collections.abc import Mapping, Sequence
from typing import Any

from clutch_hil.bench.faults.catalogue import HOST_FAULTS
from clutch_hil.bench.faults.fault_requests import request_fault
from plant_sim.bus_faults.catalogue import BUS_FAULTS
from plant_sim.effects.catalogue import load_effects
from protocols.errors import InputError, join_names, suggest_closest
from protocols.files.other_units import parse_number, refuse_unit_alone


def read_bench_fault(words: Sequence[str], process: str | None, signal: str | None, off: bool) -> dict[str, Any] | None:
    """Read the request for a fault of the bench from the words of the command; None if they describe something else.

    words: the name of a host fault, and NAME=VALUE of its parameters; with `off`, names of faults to end. process: the service
    that gets a `signal`, kill if None. Raises InputError.
    """
    if process is not None:
        if words or off:
            raise InputError(f"--process and {words[0] if words else '--off'} cannot be combined")
        return {"process": process, "signal": signal or "kill"}
    if signal is not None:
        raise InputError("--signal was given without --process; give the service with --process")
    known = [*load_effects(), *BUS_FAULTS, *HOST_FAULTS]
    for word in words:
        if not set(word) & set("=.") and word not in known:
            refuse_unit_alone(word)
            raise InputError(f"effect or fault {word!r} is unknown; {suggest_closest(word, known)}")
    names = [word for word in words if word in HOST_FAULTS]
    if not names:
        return None
    if off:
        if others := [word for word in words if word not in HOST_FAULTS]:
            raise InputError(
                f"{names[0]} and {others[0]} cannot be combined; end a fault of the computer in a separate command"
            )
        return {"end": names}
    if words[0] != names[0] or len(names) > 1 or any("=" not in word for word in words[1:]):
        raise InputError(
            f"cannot inject {' '.join(words)} together; inject a fault of the computer in a separate command"
        )
    values = dict(word.split("=", 1) for word in words[1:])
    if len(values) < len(words) - 1:
        raise InputError(f"a parameter of {names[0]} was given twice")
    numbers = {name: _parse_number(names[0], name, text) for name, text in values.items()}
    return {"host_fault": names[0], "values": numbers}


def run_bench_fault(
    request: Mapping[str, Any], when: Mapping[str, float], bus: str | None
) -> tuple[dict[str, Any], str, str, bool]:
    """Request a fault from the bench, at the times `when`; return document, text, verdict and True. Raises InputError."""
    answer = request_fault(bus, {**request, **when})
    read = f"read:    the bench on {answer['bus']}"
    if "ended" in answer:
        ended = join_names(answer["ended"])
        verdict = f"{ended}: ended" if answer["ended"] else "none of these faults was on"
        wrote = f"the end of {ended}" if answer["ended"] else "nothing"
        return answer | {"verdict": verdict}, f"{read}\nwrote:   {wrote}", verdict, True
    until = "" if answer["until"] is None else f" to {answer['until']:.3f} s"
    verdict = f"{answer['planned']}: planned from {answer['at']:.3f} s{until} of the run"
    return answer | {"verdict": verdict}, f"{read}\nwrote:   a fault of the bench", verdict, True


def list_bench_faults(bus: str | None) -> list[str]:
    """Return the active faults of the bench; none where this user has no bench on this computer."""
    try:
        on: list[str] = request_fault(bus, {})["on"]
    except InputError:
        return []
    return on


def _parse_number(fault: str, name: str, text: str) -> float:
    """Return the number in `text` in the unit of the parameter `name` of a host fault. Raises InputError."""
    units = {parameter.name: parameter.unit for parameter in HOST_FAULTS[fault].parameters}
    if name not in units:
        allowed = suggest_closest(name, units) if units else "it has none"
        raise InputError(f"host fault {fault} has no parameter {name!r}; {allowed}")
    if (value := parse_number(f"{fault}.{name}", text, lambda: units[name])) is None:
        raise InputError(f"{name}={text} needs a number after the =")
    return value
