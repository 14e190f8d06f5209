"""Batches of each clutch: rows of a bench with two clutches, with the column names of a bench with one clutch."""

from dataclasses import replace
from functools import lru_cache

from clutch_hil.live.viewer.dashboard import split_clutch_name
from protocols.can.two_clutches import CLUTCHES, CONTROLLERS
from protocols.node import Column
from protocols.telemetry.batch import Batch

_LAYOUTS = 16  # cached layouts of columns: three nodes of two runs, before and after a restart


def split_by_clutch(batch: Batch) -> list[tuple[str, Batch]]:
    """Return the rows of a batch for each clutch, a or b, with the column names of a single clutch.

    A controller has rows for its clutch only. Rows of a plant with two clutches are returned for both clutches, and both
    contain the shared columns.
    """
    return [
        (clutch, replace(batch, columns=columns, rows=batch.rows[:, list(numbers)]) if numbers else batch)
        for clutch, columns, numbers in _make_layouts(batch.node, batch.columns)
    ]


def make_path_suffix(clutch: str) -> str:
    """Return the suffix of the entity names of a clutch, a or b: empty for a, as for a single clutch."""
    return "" if clutch == CLUTCHES[0] else f"_{clutch}"


@lru_cache(_LAYOUTS)
def _make_layouts(node: str, columns: tuple[Column, ...]) -> list[tuple[str, tuple[Column, ...], tuple[int, ...]]]:
    """Return clutch, columns and their indices in the batch, for each clutch; no indices where the batch needs no change."""
    single = [split_clutch_name(column) for column in columns]
    if node == CONTROLLERS[1]:
        clutches: tuple[str, ...] = CLUTCHES[1:]
    elif node != CONTROLLERS[0] and {clutch for _, clutch in single} >= set(CLUTCHES):
        clutches = CLUTCHES
    else:
        return [(CLUTCHES[0], columns, ())]
    layouts = []
    for clutch in clutches:
        numbers = tuple(number for number, (_, own) in enumerate(single) if own in ("", clutch))
        layouts.append((clutch, tuple(columns[n]._replace(name=single[n][0]) for n in numbers), numbers))
    return layouts
