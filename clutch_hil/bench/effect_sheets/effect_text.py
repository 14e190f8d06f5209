"""Effects as text and as documents for JSON: a list of all effects, and a sheet about one effect."""

import re
import textwrap
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

import plant_sim.effects
from clutch_hil.bench.effect_sheets.demonstration import Demonstration
from clutch_hil.bench.pictures.bars import draw_sparkline
from plant_sim.effects.effect import BLOCKS, Effect, Shape, Strength
from plant_sim.effects.signals import HOOKS

_SPARKLINE_WIDTH = 40  # characters of a sparkline
_COLUMN_GAP = "  "  # between the columns of a table
_SECTION = re.compile(r"([A-Z][\w ]*?) {2,}(.*)")  # first line of a section: its name at the margin, then its text
_NAME_WIDTH = 16  # characters before the text of a section, as in the files of effects


def sort_effects(effects: Iterable[Effect]) -> list[Effect]:
    """Sort effects by block, in the order of the signal from the valve to the sensors, then by name."""
    return sorted(effects, key=lambda effect: (BLOCKS.index(effect.block), effect.name))


def is_ours(effect: Effect) -> bool:
    """Return whether the file of the effect is in this package; otherwise it is a user's."""
    return Path(plant_sim.effects.__file__).parent in effect.path.parents


def split_sections(effect: Effect) -> dict[str, str]:
    """Return the sections of the docstring in the effect's file, by name; lines as written, without indentation."""
    texts: dict[str, str] = {}
    for line in effect.text.splitlines()[1:]:
        if section := _SECTION.match(line):
            texts[section[1]] = section[2]
        elif texts and line.strip():
            texts[list(texts)[-1]] += f"\n{line.strip()}"
    return texts


def list_text(effects: Sequence[Effect], width: int) -> str:
    """Return a list of effects sorted by block: a line for each effect and each parameter, cut at `width` characters."""
    parameters = iter(_align_rows([_format_cells(p) for effect in effects for p in effect.parameters]))
    lines = []
    for block, members in groupby(effects, lambda effect: effect.block):
        lines += ["", block.upper()]
        for effect in members:
            remarks = [] if effect.candidate else ["no candidate"]
            remarks += [] if is_ours(effect) else [f"from {effect.path.parent}"]
            remark = f" ({'; '.join(remarks)})" if remarks else ""
            lines += [
                f"  {effect.name}{remark}: {effect.title}",
                *(f"      {next(parameters)}" for _ in effect.parameters),
            ]
    return "\n".join(line if len(line) <= width else f"{line[: width - 1]}…" for line in lines[1:])


def format_sheet(effect: Effect, demonstration: Demonstration, width: int) -> str:
    """Describe an effect in lines of about `width` characters, with a small plot of its influence on the rig."""
    texts = {
        **split_sections(effect),
        "Block": effect.block,
        "Hooks": ", ".join(HOOKS[hook] for hook in sorted(effect.laws)),
        "States": ", ".join(f"{s.name}{f' ({s.size})' if s.size > 1 else ''} [{s.unit}]" for s in effect.states)
        or "none",
        "Excludes": ", ".join(effect.excludes) or "nothing",
        "Candidate": f"{'yes' if effect.candidate else 'no'}, of `clutch-hil discrepancy`",
    }
    lines = [_format_section(name, text, width) for name, text in texts.items()]
    rows = _align_rows([_format_cells(p) for p in effect.parameters])
    parameters = [textwrap.fill(row, max(width, 40), subsequent_indent=" " * _NAME_WIDTH) for row in rows]
    return "\n".join([f"{effect.name}: {effect.title}", "", *lines, "", *parameters, "", _plot(demonstration)])


def make_document(effect: Effect) -> dict[str, Any]:
    """Return an effect as a document for JSON; values and bounds in the parameter's unit."""
    return {
        "name": effect.name,
        "block": effect.block,
        "title": effect.title,
        "candidate": effect.candidate,
        "path": str(effect.path),
        "ours": is_ours(effect),
        "hooks": [HOOKS[hook] for hook in sorted(effect.laws)],
        "states": [{"name": s.name, "unit": s.unit, "size": s.size} for s in effect.states],
        "excludes": list(effect.excludes),
        "sections": split_sections(effect),
        "parameters": [
            {
                "name": f"{effect.name}.{p.name}",
                "kind": "strength" if isinstance(p, Strength) else "shape",
                "unit": p.unit,
                "off": p.off if isinstance(p, Strength) else None,
                "typical": p.typical,
                "bounds": list(p.bounds),
                "source": p.source,
            }
            for p in effect.parameters
        ],
    }


def _format_cells(p: Strength | Shape) -> tuple[str, ...]:
    """Return a row of the table of parameters."""
    off = f"off {p.off:g}" if isinstance(p, Strength) else "shape"
    return (p.name, p.unit, off, f"typical {p.typical:g}", f"{p.bounds[0]:g}..{p.bounds[1]:g}", p.source)


def _align_rows(rows: Sequence[Sequence[str]]) -> list[str]:
    """Format rows as lines with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [_COLUMN_GAP.join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]


def _format_section(name: str, text: str, width: int) -> str:
    """Format a section with its name. Lines that are too long are wrapped; others, such as equations, are unchanged."""
    lines = [part for line in text.splitlines() for part in textwrap.wrap(line, max(width - _NAME_WIDTH, 40)) or [""]]
    return "\n".join(f"{name if i == 0 else '':<{_NAME_WIDTH}}{line}".rstrip() for i, line in enumerate(lines))


def _plot(demonstration: Demonstration) -> str:
    """Plot the quantity without and with the effect, and the difference, as sparklines over time."""
    without, with_it = demonstration.without[demonstration.column], demonstration.with_it[demonstration.column]
    low, high = min(without.min(), with_it.min()), max(without.max(), with_it.max())
    rows = (
        ("without", without, low, high),
        ("with", with_it, low, high),
        ("with - without", demonstration.difference, *_find_span(demonstration.difference)),
    )
    lines = [f"{demonstration.what} [{demonstration.unit}] over time: {demonstration.excitation.title}"]
    lines += [
        f"{name:<{_NAME_WIDTH}}{draw_sparkline(_average(y), *ends)}  {ends[0]:.4g}..{ends[1]:.4g} {demonstration.unit}"
        for name, y, *ends in rows
    ]
    return "\n".join(lines)


def _find_span(values: np.ndarray) -> tuple[float, float]:
    """Return the smallest and the largest of the values and 0."""
    return min(float(values.min()), 0.0), max(float(values.max()), 0.0)


def _average(values: np.ndarray) -> np.ndarray:
    """Return means (_SPARKLINE_WIDTH,) of neighbouring values (n,)."""
    return np.array([part.mean() for part in np.array_split(values, _SPARKLINE_WIDTH)])
