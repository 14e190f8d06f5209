"""Catalogue: the parameters of a running bench; find them by name, check values, and format them as text."""

import difflib
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from clutch_hil.bench.progress import format_table
from protocols.errors import InputError, join_names
from protocols.files.other_units import describe_other_unit, parse_number
from protocols.files.units import space_unit
from protocols.telemetry.keys import NODES, find_bus

WHOLE = sys.maxsize  # characters of a line without a terminal: nothing is cut
_SOURCE_LEAST = (
    12  # least characters of a source in a table; with less room it is left out. `describe_parameter` shows all of it
)
_GAP = 2  # characters between the columns of a table


@dataclass(frozen=True)
class Catalogue:
    """Every parameter of a bench by full name, NODE.GROUP.NAME, as described by the nodes that answered."""

    bench: str
    entries: Mapping[str, Mapping[str, Any]]

    @property
    def nodes(self) -> list[str]:
        """Return the names of the nodes that answered."""
        return list(dict.fromkeys(full.partition(".")[0] for full in self.entries))

    @property
    def silence(self) -> str:
        """Return a clause that names the nodes that did not answer; empty if all did."""
        silent = [node for node in NODES if node not in self.nodes]
        return f"the {silent[0]} on {find_bus(self.bench)} does not answer" if silent else ""

    def find_full_name(self, name: str) -> str:
        """Return the full name of a parameter given with or without its node. Raises InputError."""
        if name in self.entries:
            return name
        matches = [full for full in self.entries if full.partition(".")[2] == name]
        if len(matches) > 1:
            raise InputError(f"parameter {name!r} is ambiguous; it can be {join_names(matches)}")
        if not matches:
            raise self._make_error(name)
        return matches[0]

    def list_group(self, prefix: str) -> list[str]:
        """Return the full names of the parameters in a group, given with or without its node: `torque.`, `plant.clutch.*`."""
        start = prefix.rstrip("*").rstrip(".") + "."
        return [full for full in self.entries if full.startswith(start) or full.partition(".")[2].startswith(start)]

    def check_value(self, name: str, text: str) -> float:
        """Return the value in `text` if it is valid for the parameter with the full name `name`. Raises InputError.

        A text such as `34 psi` is converted to the unit of the parameter.
        """
        entry = self.entries[name]
        low, high = entry["bounds"]
        if (value := parse_number(f"parameter {name}", text, lambda: str(entry["unit"]))) is None:
            allowed = with_unit(f"a number is needed, {low:g} to {high:g}", entry["unit"])
            raise InputError(f"parameter {name} is given as {text!r}; {allowed}")
        if entry["fixed"]:
            raise InputError(entry["fixed"])
        if not low <= value <= high:
            given = with_unit(f"{value:g}", entry["unit"])
            hint = describe_other_unit(value, entry["unit"], low, high)
            raise InputError(f"parameter {name} = {given} is outside {low:g}..{high:g}{hint}")
        return value

    def _make_error(self, name: str) -> InputError:
        shorts = {full.partition(".")[2]: full for full in self.entries}
        close = difflib.get_close_matches(name, [*self.entries, *shorts], n=3, cutoff=0.5)
        node = name.partition(".")[0]
        if not self.silence or node in self.nodes:
            groups = {full.rpartition(".")[0] for full in self.entries}
            hint = f"did you mean {' or '.join(close)}?" if close else f"groups are {join_names(groups)}"
            return InputError(f"parameter {name!r} is unknown; {hint}")
        if node in NODES:
            return InputError(f"{self.silence}; it may still be starting, or be stopped")
        nearest = f"; the nearest name is {close[0]}" if close else ""
        return InputError(f"{self.silence}, and the {self.nodes[0]} has no parameter {name!r}{nearest}")


def parse_assignments(catalogue: Catalogue, arguments: Iterable[str]) -> dict[str, dict[str, float]]:
    """Parse NAME=VALUE arguments into checked values by node and name. Raises InputError."""
    values: dict[str, dict[str, float]] = {}
    for argument in arguments:
        name, _, text = argument.partition("=")
        full = catalogue.find_full_name(name.strip())
        node, _, short = full.partition(".")
        if short in values.setdefault(node, {}):
            raise InputError(f"parameter {full} was given twice")
        values[node][short] = catalogue.check_value(full, text)
    return values


def format_tables(entries: Mapping[str, Mapping[str, Any]], width: int) -> str:
    """Format parameters by full name as a table for each node, in lines of at most `width` characters."""
    grouped = groupby(entries.items(), lambda item: item[0].partition(".")[0])
    return "\n\n".join(format_table(_fit_columns(_format_rows(node, dict(items)), width)) for node, items in grouped)


def hide_off_effects(
    entries: Mapping[str, Mapping[str, Any]], names: Collection[str]
) -> tuple[dict[str, Any], list[str]]:
    """Return `entries` by full name without those of `names`, effects, that are off; and the names of these effects."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for full, entry in entries.items():
        groups.setdefault(full.rpartition(".")[0], []).append(entry)
    off = [
        group
        for group, members in groups.items()
        if group.rpartition(".")[2] in names and all(entry["value"] == entry["default"] for entry in members)
    ]
    shown = {full: entry for full, entry in entries.items() if full.rpartition(".")[0] not in off}
    return shown, [group.partition(".")[2] for group in off]


def _format_rows(node: str, entries: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [(f"parameter of the {node}", "value", "bounds", "default", "source")]
    for name, entry in entries.items():
        low, high = entry["bounds"]
        rows.append(
            (
                name.partition(".")[2],
                with_unit(f"{entry['value']:.6g}", entry["unit"]),
                "fixed" if entry["fixed"] else f"{low:g}..{high:g}",
                f"{entry['default']:.6g}",
                entry["source"],
            )
        )
    return rows


def _fit_columns(rows: Sequence[Sequence[str]], width: int) -> list[list[str]]:
    """Return rows with the columns that fit into `width`. The last column, the source, is cut where needed."""
    needed = [max(map(len, column)) for column in zip(*rows, strict=True)]
    room = [width - sum(_GAP + before for before in needed[:i]) for i in range(len(needed))]
    needed[-1] = min(needed[-1], _SOURCE_LEAST)
    columns = [i for i, least in enumerate(needed) if i == 0 or least <= room[i]]
    return [[row[i] if len(row[i]) <= room[i] else row[i][: room[i] - 1] + "…" for i in columns] for row in rows]


def describe_parameter(name: str, entry: Mapping[str, Any]) -> str:
    """Describe one parameter in full, as lines."""
    low, high = entry["bounds"]
    unit = entry["unit"]
    lines = [
        with_unit(f"{name} = {entry['value']:.10g}", unit),
        with_unit(f"  bounds       {low:g} to {high:g}", unit),
        with_unit(f"  default      {entry['default']:.10g}", unit),
        with_unit(f"  uncertainty  {entry['uncertainty']:g}", unit),
        f"  source       {entry['source']}",
        f"  at run time  {'can be changed' if entry['fixed'] is None else 'fixed: ' + entry['fixed']}",
    ]
    return "\n".join(lines)


def with_unit(text: str, unit: str) -> str:
    """Return `text` followed by its unit; the unit 1 is omitted."""
    return f"{text}{space_unit(unit)}"


def format_step(old: float | None, new: float) -> str:
    """Return a change as `2 -> 3`, or as `-> 3` where the old value is unknown, as for a blind plant."""
    return f"{'' if old is None else f'{old:g} '}-> {new:g}"
