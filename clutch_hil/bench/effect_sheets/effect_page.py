"""Page of the effects, docs/effects.md: the parts that `clutch-hil effects --write` writes.

A part is between `<!-- begin PART -->` and `<!-- end -->`. Text outside the parts is written by people.
"""

import re
from collections.abc import Iterable, Sequence

from clutch_hil.bench.effect_sheets.excitation import INPUTS, QUANTITIES, make_excitations
from plant_sim.effects import signals
from plant_sim.effects.effect import Effect
from protocols.errors import InputError, join_names, suggest_closest

_PART = re.compile(r"(?<=<!-- begin )(\w+)( -->\n)(.*?)(?=<!-- end -->)", re.DOTALL)
_PICTURE = re.compile(r"<!-- picture of (.*?) -->")
_ROW = re.compile(r"^\| \w+ \| `(\w+)`[ *]* \| .* \| (.*) \|$", re.MULTILINE)  # of the table of all effects
_UNIT = re.compile(r" \[.*?\]")


def rewrite_page(text: str, effects: Sequence[Effect]) -> str:
    """Return the `text` of the page with its parts rewritten from `effects`, in this order.

    Raises InputError for an unknown part, for a page without parts, and where the table in `text` has an effect or a parameter
    that is missing in `effects`. Run files and models contain these names, so a published name must stay.
    """
    parts = {
        "experiments": _format_experiments(),
        "columns": _format_columns(),
        "hooks": _format_hooks(),
        "effects": _format_effects(effects),
    }
    if gone := list_published_names(text) - names(effects):
        raise InputError(
            f"published names are gone: {join_names(gone)}; run files and models contain them:"
            " keep them, or edit the page first"
        )

    def rewrite_part(part: re.Match[str]) -> str:
        name, end, _ = part.groups()
        if name not in parts:
            raise InputError(f"part {name!r} is unknown; {suggest_closest(name, parts)}")
        return f"{name}{end}{parts[name]}\n"

    text, count = _PART.subn(rewrite_part, text)
    if not count:
        raise InputError("the page has no parts to write; a part is between <!-- begin PART --> and <!-- end -->")
    return text


def list_pictured_names(text: str) -> list[str]:
    """Return the names of the effects in the page's picture, in its order; [] for a page without a picture."""
    mark = _PICTURE.search(text)
    return mark[1].split(", ") if mark else []


def list_published_names(text: str) -> set[str]:
    """Return the names of the effects in the page's table, and of their parameters as `effect.parameter`."""
    rows = _ROW.findall(text)
    parameters = {f"{effect}.{name}" for effect, cell in rows for name in _UNIT.sub("", cell).split(", ")}
    return {effect for effect, _ in rows} | parameters


def names(effects: Iterable[Effect]) -> set[str]:
    """Return the names of effects, and of their parameters as `effect.parameter`."""
    return {name for effect in effects for name in (effect.name, *effect.list_typical_values())}


def _format_effects(effects: Sequence[Effect]) -> str:
    """Return a table of the effects; a star marks those that are not candidates."""
    rows = []
    for effect in effects:
        parameters = ", ".join(p.name if p.unit == "1" else f"{p.name} [{p.unit}]" for p in effect.parameters)
        star = "" if effect.candidate else " *"
        rows.append((effect.block, f"`{effect.name}`{star}", effect.title, parameters))
    return _format_table(("block", "effect", "what", "parameters"), rows)


def _format_experiments() -> str:
    rows = [(f"`{name}`", excitation.title, f"`{excitation.over}`") for name, excitation in make_excitations().items()]
    return _format_table(("excitation", "what", "drawn over"), rows)


def _format_columns() -> str:
    rows = [(f"`{column}`", what, unit, f"{resolution:g}") for column, (what, unit, resolution) in QUANTITIES.items()]
    rows += [(f"`{column}`", what, unit, "") for column, (what, unit) in INPUTS.items()]
    return _format_table(("column", "what", "unit", "resolution"), rows)


def _format_hooks() -> str:
    """Return the table of hooks from the docstring of signals.py."""
    lines = [line[4:] for line in str(signals.__doc__).splitlines() if line.startswith("    ")]
    return "\n".join(["```", *lines, "```"])


def _format_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [f"| {' | '.join(cells)} |" for cells in (head, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:]])
