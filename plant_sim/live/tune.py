"""`clutch-hil tune`: list, show and set the parameters of running services, over zenoh."""

import difflib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import zenoh

from plant_sim.bench.progress import table_text
from protocols.errors import InputError, listing
from protocols.telemetry.feed import find_bench, nodes_alive
from protocols.telemetry.keys import Keys, bus_of
from protocols.telemetry.session import consumer_session

_TIMEOUT = 5.0  # s for an answer; one takes a millisecond, a loop that is asked to change something one cycle more
_SOURCE_WIDTH = 48  # characters of a source in a table; all of it is told when a parameter is asked for by name


def parameters(session: zenoh.Session, bench: str, node: str) -> list[dict[str, Any]]:
    """Parameters of a node: name, value, unit, bounds, default, source, uncertainty, and why it is fixed or None.

    Raises InputError when the node does not answer.
    """
    return _asked(session, bench, node, None)


def set_parameters(session: zenoh.Session, bench: str, node: str, values: Mapping[str, float]) -> dict[str, Any]:
    """Set parameters between two cycles of a node, all or none; return `row`, the first with them, and `changed`.

    Raises InputError with the node's reason when it refuses, or when it does not answer.
    """
    return _asked(session, bench, node, json.dumps(values))


def _asked(session: zenoh.Session, bench: str, node: str, payload: str | None) -> Any:
    for reply in session.get(Keys(bench, node).parameters, payload=payload, timeout=_TIMEOUT):
        if reply.ok is not None:
            return json.loads(reply.ok.payload.to_string())
        if reply.err is not None:
            raise InputError(reply.err.payload.to_string())
    raise InputError(f"the {node} on {bus_of(bench)} does not answer; is it stopped?")


@dataclass(frozen=True)
class Catalogue:
    """Every parameter of a bench by its full name, NODE.GROUP.NAME."""

    entries: Mapping[str, Mapping[str, Any]]

    def named(self, name: str) -> str:
        """The full name of a parameter, given with or without its node. Raises InputError."""
        if name in self.entries:
            return name
        found = [full for full in self.entries if full.partition(".")[2] == name]
        if len(found) > 1:
            raise InputError(f"parameter {name!r} is ambiguous; there are {listing(found)}")
        if not found:
            raise self._unknown(name)
        return found[0]

    def group(self, prefix: str) -> list[str]:
        """Full names of a group, with or without its node: `controller`, `torque.`, `plant.clutch.*`."""
        start = prefix.rstrip("*").rstrip(".") + "."
        return [full for full in self.entries if full.startswith(start) or full.partition(".")[2].startswith(start)]

    def _unknown(self, name: str) -> InputError:
        shorts = {full.partition(".")[2]: full for full in self.entries}
        close = difflib.get_close_matches(name, [*self.entries, *shorts], n=3, cutoff=0.5)
        known = sorted({full.rpartition(".")[0] for full in self.entries})
        hint = f"did you mean {' or '.join(close)}?" if close else f"groups are {listing(known)}"
        return InputError(f"parameter {name!r} is unknown; {hint}")


def assignments(catalogue: Catalogue, arguments: Iterable[str]) -> dict[str, dict[str, float]]:
    """NAME=VALUE arguments as values by node and name. Raises InputError."""
    values: dict[str, dict[str, float]] = {}
    for argument in arguments:
        name, _, text = argument.partition("=")
        full = catalogue.named(name.strip())
        entry = catalogue.entries[full]
        try:
            value = float(text)
        except ValueError:
            low, high = entry["bounds"]
            allowed = f"a number is needed, {low:g} to {high:g} {entry['unit']}"
            raise InputError(f"parameter {full} is given as {text!r}; {allowed}") from None
        node, _, short = full.partition(".")
        if short in values.setdefault(node, {}):
            raise InputError(f"parameter {full} is given twice")
        values[node][short] = value
    return values


def tuned(arguments: Sequence[str], bus: str | None, router: str | None) -> tuple[dict[str, Any], str, str, bool]:
    """List all parameters, show those named, or set those with a value; return document, text, verdict and True.

    Raises InputError when there is no bench, a name is unknown, or a service refuses.
    """
    setting = ["=" in argument for argument in arguments]
    if any(setting) and not all(setting):
        raise InputError(f"tune was given {arguments[setting.index(False)]!r} without a value beside NAME=VALUE")
    with consumer_session(router) as session:
        bench = find_bench(session, bus)
        nodes = nodes_alive(session, bench)
        catalogue = Catalogue(
            {f"{node}.{entry['name']}": entry for node in nodes for entry in parameters(session, bench, node)}
        )
        if any(setting):
            return _set(session, bench, assignments(catalogue, arguments))
    read = f"read:    {len(catalogue.entries)} parameters of {' and '.join(nodes)} on {bus_of(bench)}"
    return _shown(catalogue, arguments, read)


def _set(
    session: zenoh.Session, bench: str, values: Mapping[str, Mapping[str, float]]
) -> tuple[dict[str, Any], str, str, bool]:
    changed: list[dict[str, Any]] = []
    for node, wanted in values.items():
        try:
            answer = set_parameters(session, bench, node, wanted)
        except InputError as error:
            done = f"; changed already: {listing(c['node'] + '.' + c['name'] for c in changed)}" if changed else ""
            raise InputError(f"{error}{done}") from None
        changed += [{"node": node, "row": answer["row"], **change} for change in answer["changed"]]
    lines = [
        f"{change['node']}.{change['name']}  {change['old']:g} -> {change['new']:g} {change['unit']}, "
        f"from row {change['row']} of the {change['node']} on"
        for change in changed
    ]
    text = f"read:    {len(changed)} values\n" + "\n".join(
        f"{'wrote:   ' if i == 0 else '         '}{line}" for i, line in enumerate(lines)
    )
    noun = "parameter" if len(changed) == 1 else "parameters"
    return {"bench": bench, "changed": changed}, text, f"{len(changed)} {noun} changed", True


def _shown(catalogue: Catalogue, arguments: Sequence[str], read: str) -> tuple[dict[str, Any], str, str, bool]:
    names: dict[str, None] = {} if arguments else dict.fromkeys(catalogue.entries)
    grouped = not arguments
    for argument in arguments:
        group = [] if argument in catalogue.entries else catalogue.group(argument)
        grouped = grouped or bool(group)
        names |= dict.fromkeys(group or [catalogue.named(argument)])
    chosen = {name: catalogue.entries[name] for name in names}
    body = _table(chosen) if grouped else "\n\n".join(_details(name, entry) for name, entry in chosen.items())
    fixed = sum(entry["fixed"] is not None for entry in chosen.values())
    verdict = f"{len(chosen)} parameters, {fixed} of them fixed while the service runs"
    return {"parameters": chosen}, f"{body}\n{read}\nwrote:   nothing", verdict, True


def _table(entries: Mapping[str, Mapping[str, Any]]) -> str:
    rows: list[tuple[str, ...]] = [("parameter", "value", "unit", "bounds", "default", "fixed", "source")]
    for name, entry in entries.items():
        low, high = entry["bounds"]
        source = entry["source"]
        if len(source) > _SOURCE_WIDTH:
            source = source[: _SOURCE_WIDTH - 1] + "…"
        rows.append(
            (
                name,
                f"{entry['value']:.6g}",
                entry["unit"],
                f"{low:g}..{high:g}",
                f"{entry['default']:.6g}",
                "fixed" if entry["fixed"] else "",
                source,
            )
        )
    return table_text(rows)


def _details(name: str, entry: Mapping[str, Any]) -> str:
    low, high = entry["bounds"]
    unit = entry["unit"]
    lines = [
        f"{name} = {entry['value']:.10g} {unit}",
        f"  bounds       {low:g} to {high:g} {unit}",
        f"  default      {entry['default']:.10g} {unit}",
        f"  uncertainty  {entry['uncertainty']:g} {unit}",
        f"  source       {entry['source']}",
        f"  at run time  {'can be changed' if entry['fixed'] is None else 'fixed: ' + entry['fixed']}",
    ]
    return "\n".join(lines)
