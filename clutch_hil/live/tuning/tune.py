"""`clutch-hil tune`: list, show and set the parameters of running services over zenoh."""

import json
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import zenoh

from clutch_hil.live.tuning.catalogue import (
    WHOLE,
    Catalogue,
    describe_parameter,
    format_tables,
    hide_off_effects,
    parse_assignments,
    with_unit,
)
from plant_sim.effects.catalogue import load_effects
from protocols.errors import InputError, format_count, join_names
from protocols.files.other_units import refuse_unit_alone
from protocols.telemetry.feed import find_bench, list_live_nodes
from protocols.telemetry.keys import NODES, Keys, find_bus
from protocols.telemetry.lab import find_asker_name
from protocols.telemetry.message import check_parameters, parse_message
from protocols.telemetry.session import open_consumer_session

_LIST_TIMEOUT = 2.0  # s for a list of parameters: it needs no loop, and a stopped process counts as gone after 2 s
_ATTEMPTS = 3  # to get a list: a service that waits longer for a busy CPU loses its link, and gets it back 0.5 s later
_RETRY_PERIOD = 0.5  # s between attempts
_CHANGE_TIMEOUT = 5.0  # s for a change: a loop needs one cycle for it, and its publisher gives up after 2 s
_MOST_REASON = 1000  # characters of a refusal that are shown
_TIMEOUT_REPLY = "Timeout"  # zenoh's own reply when no reply arrived in time


class SilentError(InputError):
    """Raised when a node does not answer."""


def request_parameters(session: zenoh.Session, bench: str, node: str) -> list[dict[str, Any]]:
    """Return the parameters of a node: name, value, unit, bounds, default, source, uncertainty, and why it is fixed or None.

    Raises SilentError when the node does not answer.
    """
    left = _ATTEMPTS
    while True:
        left -= 1
        try:
            replies = session.get(
                Keys(bench, node).parameters, timeout=_LIST_TIMEOUT, consolidation=zenoh.ConsolidationMode.NONE
            )
            return read_reply(bench, node, replies, check_parameters)
        except SilentError:
            if not left:
                raise
        time.sleep(_RETRY_PERIOD)


def set_parameters(
    session: zenoh.Session, bench: str, node: str, values: Mapping[str, float], by: str | None = None
) -> dict[str, Any]:
    """Set parameters between two cycles of a node, all or none; return `row`, the first row with them, and `changed`.

    by: name of the requester; the user of this process if None. Raises InputError with the node's reason when it refuses, or
    when it does not answer.
    """
    key = Keys(bench, node).change_by(by or find_asker_name(None))
    replies = session.get(key, payload=json.dumps(values), timeout=_CHANGE_TIMEOUT)
    return read_reply(bench, node, replies)


def read_reply(
    bench: str, node: str, replies: Iterable[zenoh.Reply], check: Callable[[Any], Any] = lambda answer: answer
) -> Any:
    """Return the JSON in the reply of a node that passes `check`; replies of other programs do not pass.

    Raises InputError with the reason of the node when it refuses, SilentError when there is no reply.
    """
    reasons = []
    for reply in replies:
        if reply.ok is not None:
            with suppress(InputError):
                return check(parse_message(reply.ok.payload.to_bytes()))
        elif reply.err is not None and (reason := _read_reason(reply.err)) != _TIMEOUT_REPLY:
            reasons.append(reason)
    if reasons:
        raise InputError(reasons[0])
    raise SilentError(f"the {node} on {find_bus(bench)} does not answer; it may still be starting, or be stopped")


def _read_reason(error: zenoh.ReplyError) -> str:
    return " ".join(error.payload.to_bytes().decode(errors="replace").split())[:_MOST_REASON]


def list_parameters(session: zenoh.Session, bench: str) -> Catalogue:
    """Return the parameters of every node that answers. Raises InputError when none does."""
    entries: dict[str, dict[str, Any]] = {}
    reasons = []
    for node in sorted({*NODES, *list_live_nodes(session, bench)}):
        try:
            entries |= {f"{node}.{entry['name']}": entry for entry in request_parameters(session, bench, node)}
        except InputError as error:
            reasons.append(str(error))
    if not entries:
        raise InputError("; ".join(reasons))
    return Catalogue(bench, entries)


def run_tune(arguments: Sequence[str], bus: str | None, router: str | None) -> tuple[dict[str, Any], str, str, bool]:
    """List all parameters, show the named ones, or set those with a value; return document, text, verdict and True.

    If one name or value is wrong, nothing is set. Raises InputError when there is no bench, a name is unknown, a node does not
    answer, or a service refuses.
    """
    setting = ["=" in argument for argument in arguments]
    if any(setting) and not all(setting):
        refuse_unit_alone(word := arguments[setting.index(False)])
        raise InputError(f"{word!r} has no value, but other arguments have one; write it as NAME=VALUE")
    for argument in arguments:
        if _is_number(argument):
            raise InputError(f"{argument!r} is a number, and no name of a parameter; write NAME=VALUE to set one")
    by = find_asker_name(router) if any(setting) else None
    with open_consumer_session(router) as session:
        bench = find_bench(session, bus, router)
        catalogue = list_parameters(session, bench)
        if by:
            return _set_and_describe(session, bench, parse_assignments(catalogue, arguments), by)
    return _show_values(catalogue, arguments)


def _is_number(text: str) -> bool:
    """Return whether a word of a command is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def change_parameters(
    session: zenoh.Session, bench: str, values: Mapping[str, Mapping[str, float]], by: str | None = None
) -> list[dict[str, Any]]:
    """Set parameters by node and name; return the changes: node, name, `old`, `new`, unit and `row`, the first row with them.

    by: see `set_parameters`. Raises InputError with the reason of the node that refuses, and the changes made before.
    """
    changed: list[dict[str, Any]] = []
    for node, wanted in values.items():
        try:
            answer = set_parameters(session, bench, node, wanted, by)
        except InputError as error:
            done = f"; changed already: {join_names(c['node'] + '.' + c['name'] for c in changed)}" if changed else ""
            raise InputError(f"{error}{done}") from None
        changed += [{"node": node, "row": answer["row"], **change} for change in answer["changed"]]
    return changed


def _set_and_describe(
    session: zenoh.Session, bench: str, values: Mapping[str, Mapping[str, float]], by: str
) -> tuple[dict[str, Any], str, str, bool]:
    changed = change_parameters(session, bench, values, by)
    lines = [_describe_change(change) for change in changed]
    text = f"read:    {format_count(len(changed), 'value')}\n" + "\n".join(
        f"{'wrote:   ' if i == 0 else '         '}{line}" for i, line in enumerate(lines)
    )
    kept = sum(change["new"] == change["old"] for change in changed)
    verdict = f"{format_count(len(changed) - kept, 'parameter')} changed, requested by {by}"
    verdict += f"; {kept} already had this value" if kept else ""
    return {"bench": bench, "changed": changed, "by": by}, text, verdict, True


def _describe_change(change: Mapping[str, Any]) -> str:
    name = f"{change['node']}.{change['name']}"
    if change["new"] == change["old"]:
        return with_unit(f"{name}  {change['new']:g}", change["unit"]) + ", as before"
    changed = with_unit(f"{name}  {change['old']:g} -> {change['new']:g}", change["unit"])
    return f"{changed}, from row {change['row']} of the {change['node']} on"


def _show_values(catalogue: Catalogue, arguments: Sequence[str]) -> tuple[dict[str, Any], str, str, bool]:
    names: dict[str, None] = {} if arguments else dict.fromkeys(catalogue.entries)
    grouped = not arguments
    for argument in arguments:
        group = [] if argument in catalogue.entries else catalogue.list_group(argument)
        grouped = grouped or bool(group)
        names |= dict.fromkeys(group or [catalogue.find_full_name(argument)])
    chosen = {name: catalogue.entries[name] for name in names}
    if grouped:
        rows, off = (chosen, []) if arguments else hide_off_effects(chosen, load_effects())
        width = shutil.get_terminal_size().columns if sys.stdout.isatty() else WHOLE
        body = format_tables(rows, width) + _describe_off_effects(off, width)
    else:
        body = "\n\n".join(describe_parameter(name, entry) for name, entry in chosen.items())
    read = f"{format_count(len(catalogue.entries), 'parameter')} of {' and '.join(catalogue.nodes)}"
    silence = f"; {catalogue.silence}" if catalogue.silence else ""
    text = f"{body}\nread:    {read} on {find_bus(catalogue.bench)}{silence}\nwrote:   nothing"
    fixed = sum(entry["fixed"] is not None for entry in chosen.values())
    verdict = f"{format_count(len(chosen), 'parameter')}, {fixed} of them fixed while the service runs"
    return {"parameters": chosen}, text, verdict, True


def _describe_off_effects(names: Sequence[str], width: int) -> str:
    """Return a paragraph about effects that are off, to follow the tables; empty when there are none."""
    if not names:
        return ""
    line = (
        f"{format_count(len(names), 'effect')} of the plant off; `clutch-hil tune NAME.` shows one: {', '.join(names)}"
    )
    return "\n\n" + textwrap.fill(line, width, break_on_hyphens=False)
