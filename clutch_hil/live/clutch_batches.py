"""Batches of each clutch: rows of a bench of two clutches under the column names that a bench of one clutch has."""

from dataclasses import replace
from functools import lru_cache

from clutch_hil.live.dashboard import split_clutch_name
from protocols.can.two_clutches import CLUTCHES, CONTROLLERS
from protocols.node import Column
from protocols.telemetry.batch import Batch

_LAYOUTS = 16  # layouts of columns that are kept: three nodes of two runs, before and after a restart


def split_by_clutch(batch: Batch) -> list[tuple[str, Batch]]:
    """Return the rows of a batch for each clutch, a or b, with the column names of a single clutch, which is a.

    A controller has rows for its clutch only. Rows of a plant of two clutches are returned for both; columns that the clutches
    share are in both.
    """
    return [
        (clutch, replace(batch, columns=columns, rows=batch.rows[:, list(numbers)]) if numbers else batch)
        for clutch, columns, numbers in _make_layouts(batch.node, batch.columns)
    ]


def make_path_suffix(clutch: str) -> str:
    """Return the end of the names of entities of a clutch, a or b: empty for a, as of a single clutch."""
    return "" if clutch == CLUTCHES[0] else f"_{clutch}"


@lru_cache(_LAYOUTS)
def _make_layouts(node: str, columns: tuple[Column, ...]) -> list[tuple[str, tuple[Column, ...], tuple[int, ...]]]:
    """Return clutch, columns and their numbers in the batch, for each clutch; no numbers where the batch is as it must be."""
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
