"""Table: the effects that are on, as the kernel of a rig takes them."""

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from plant_sim.effects.catalogue import effects
from plant_sim.effects.effect import Effect
from plant_sim.effects.none import NONE, NoEffect
from plant_sim.effects.signals import HOOKS
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet


class Table(NamedTuple):
    """Effects that are on: names; laws to call, by hook; parameters; where each one's states begin.

    calls (n, 3) int64: address of a law, its first parameter, its first state; begins (hooks + 1,) int64: first call of each
    hook; values (m,) float64 in SI; spans: (first, after last) state of each effect, by name; size: number of states, 1
    where there are none.
    """

    names: tuple[str, ...]
    calls: np.ndarray
    begins: np.ndarray
    values: np.ndarray
    spans: Mapping[str, tuple[int, int]]
    size: int

    @property
    def kernel(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int] | None:
        """What a rig's kernel takes; None when no effect is on."""
        return self.attachments if len(self.calls) else None

    @property
    def attachments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Calls, begins, values and the number of states, also when no effect is on."""
        return self.calls, self.begins, self.values, self.size

    def at_rest(self) -> np.ndarray:
        """States of effects just switched on: zeros (k,)."""
        return np.zeros(self.size)

    def carried(self, states: np.ndarray, before: "Table") -> np.ndarray:
        """States (k,) for this table from those of the table `before`: kept where an effect stays on."""
        mine = self.at_rest()
        for name, (begin, end) in self.spans.items():
            if name in before.spans:
                first, last = before.spans[name]
                mine[begin:end] = states[first:last]
        return mine


def switched_on(parameters: ParameterSet) -> tuple[str, ...]:
    """Names of the effects of which a strength is not off."""
    return tuple(e.name for e in effects().values() if _active(e, parameters) is not NONE)


def table(parameters: ParameterSet, rig: Any, c: Mapping[str, float], also: tuple[str, ...] = ()) -> Table:
    """The table of the effects that are on, and of those named in `also`, which may be off.

    rig: Numba type of the rig's parameter record; c: its values in SI by field. Raises InputError for effects that exclude
    each other.
    """
    chosen = [e for e in effects().values() if e.name in also or _active(e, parameters) is not NONE]
    return attached_table(chosen, [parameters[f"{e.name}.{p.name}"].si for e in chosen for p in e.parameters], rig)


def attached_table(chosen: Sequence[Effect], values: Sequence[float], rig: Any) -> Table:
    """The table of the effects `chosen`, with the SI `values` of their parameters one after the other. Raises InputError."""
    _check_exclusions(chosen)
    offsets = [0, *accumulate(len(e.parameters) for e in chosen)]
    starts = [0, *accumulate(e.state_type.itemsize // 8 for e in chosen)]
    hooked: list[list[tuple[int, int, int]]] = [[] for _ in HOOKS]
    for _, i in sorted((e.rank, i) for i, e in enumerate(chosen)):
        for hook in chosen[i].laws:
            hooked[hook].append((chosen[i].address(hook, rig), offsets[i], starts[i]))
    return Table(
        names=tuple(e.name for e in chosen),
        calls=np.array([call for calls in hooked for call in calls], dtype=np.int64).reshape(-1, 3),
        begins=np.array([0, *accumulate(map(len, hooked))], dtype=np.int64),
        values=np.array(values or [0.0]),
        spans={e.name: (starts[i], starts[i + 1]) for i, e in enumerate(chosen)},
        size=max(starts[-1], 1),
    )


def added_rate(parameters: ParameterSet, c: Mapping[str, float]) -> float:
    """What the effects that are on add to the fastest rate of piston and cylinder [1/s]."""
    rates = (
        e.rate(parameters.si(e.name), c) for e in effects().values() if _active(e, parameters) is not NONE and e.rate
    )
    return sum(rates)


def compile_all(rig: Any) -> None:
    """Compile or load every law for a rig, so that switching one on costs nothing later."""
    for one in effects().values():
        for hook in one.laws:
            one.address(hook, rig)


def _active(one: Effect, parameters: ParameterSet) -> Effect | NoEffect:
    """The effect, or the null effect where all its strengths are off."""
    for name, off in one.switches:  # of each effect, for each rig that is made: in the loop of the running plant too
        if parameters[name].value != off:
            return one
    return NONE


def _check_exclusions(chosen: Sequence[Effect]) -> None:
    names = [e.name for e in chosen]
    for one in chosen:
        if others := [name for name in one.excludes if name in names]:
            raise InputError(
                f"effects {one.name} and {others[0]} exclude each other: both model one part; allowed is one"
            )
