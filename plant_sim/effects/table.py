"""Table of the effects that are on, as the kernel of a rig reads it."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from plant_sim.effects.catalogue import load_effects
from plant_sim.effects.dry_call import call_dry
from plant_sim.effects.effect import Effect
from plant_sim.effects.none import NONE, NoEffect
from plant_sim.effects.signals import HOOKS
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.user_code import describe_error


class Table(NamedTuple):
    """The effects that are on: their names, the laws to call at each hook, their parameters and states.

    names: of the effects.
    calls: (n, 3) int64, a row for each law: its address, the index of its effect's first parameter, of its first state.
    begins: (hooks + 1,) int64, the first row of `calls` of each hook; the last one is n.
    values: (m,) float64, parameters in SI.
    spans: indices of the first state of each effect and of the one after its last, by name.
    size: number of states, at least 1.
    """

    names: tuple[str, ...]
    calls: np.ndarray
    begins: np.ndarray
    values: np.ndarray
    spans: Mapping[str, tuple[int, int]]
    size: int

    @property
    def kernel(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int] | None:
        """Argument of a rig's kernel: `attachments`, or None when no effect is on."""
        return self.attachments if len(self.calls) else None

    @property
    def attachments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Calls, begins, values and the number of states."""
        return self.calls, self.begins, self.values, self.size

    def make_rest_states(self) -> np.ndarray:
        """States (k,) of effects that were just switched on: zeros."""
        return np.zeros(self.size)

    def carry_over(self, states: np.ndarray, before: "Table") -> np.ndarray:
        """States (k,) for this table: those of the table `before` for an effect that stays on, else 0."""
        moved = self.make_rest_states()
        for name, (begin, end) in self.spans.items():
            if name in before.spans:
                moved[begin:end] = states[slice(*before.spans[name])]
        return moved


def list_active_effects(parameters: ParameterSet) -> tuple[str, ...]:
    """Names of the effects that `parameters` switch on: a strength of each is not at its `off`."""
    return tuple(e.name for e in load_effects().values() if _replace_idle(e, parameters) is not NONE)


def make_table(parameters: ParameterSet, rig: Any, c: Mapping[str, float], also: tuple[str, ...] = ()) -> Table:
    """The table of the effects that are on, and of those named in `also`, which may be off.

    rig: Numba type of the rig's parameter record. c: the record's values in SI by field. Raises InputError for effects that
    exclude each other, and for a user's effect whose laws are wrong.
    """
    chosen = [e for e in load_effects().values() if e.name in also or _replace_idle(e, parameters) is not NONE]
    _check_laws(chosen, rig, c)
    return make_table_of(chosen, [parameters[f"{e.name}.{p.name}"].si for e in chosen for p in e.parameters], rig)


def make_table_of(chosen: Sequence[Effect], values: Sequence[float], rig: Any) -> Table:
    """The table of the effects `chosen`.

    values: SI values of their parameters, in the order of the effects and of each one's parameters. rig: see `make_table`.
    Raises InputError for effects that exclude each other.
    """
    _check_exclusions(chosen)
    offsets = [0, *accumulate(len(e.parameters) for e in chosen)]
    starts = [0, *accumulate(e.state_type.itemsize // 8 for e in chosen)]
    hooked: list[list[tuple[int, int, int]]] = [[] for _ in HOOKS]
    for _, i in sorted((e.rank, i) for i, e in enumerate(chosen)):
        for hook in chosen[i].laws:
            hooked[hook].append((chosen[i].find_address(hook, rig), offsets[i], starts[i]))
    return Table(
        names=tuple(e.name for e in chosen),
        calls=np.array([call for calls in hooked for call in calls], dtype=np.int64).reshape(-1, 3),
        begins=np.array([0, *accumulate(map(len, hooked))], dtype=np.int64),
        values=np.array(values or [0.0]),
        spans={e.name: (starts[i], starts[i + 1]) for i, e in enumerate(chosen)},
        size=max(starts[-1], 1),
    )


def sum_added_rates(parameters: ParameterSet, c: Mapping[str, float]) -> float:
    """Sum of the amounts that active effects add to the fastest rate of piston and cylinder [1/s]; `c`: see `make_table`."""
    on = (e for e in load_effects().values() if e.rate and _replace_idle(e, parameters) is not NONE)
    return sum(_compute_rate(e, parameters.list_si(e.name), c) for e in on)


def _compute_rate(one: Effect, p: Mapping[str, float], c: Mapping[str, float]) -> float:
    assert one.rate is not None
    try:
        return float(one.rate(p, c))
    except Exception as error:  # a user's function may raise anything
        if one.comes_with_bench:
            raise
        raise InputError(f"effect {one.name} ({one.path}): its rate raises {describe_error(error)}") from None


def compile_all(rig: Any, c: Mapping[str, float]) -> None:
    """Compile every law for a rig, or load it from disk, so that switching an effect on later compiles nothing.

    rig, c: see `make_table`. Raises InputError for a user's effect whose laws are wrong.
    """
    for one in load_effects().values():
        for hook in one.laws:
            one.find_address(hook, rig)
    _check_laws(load_effects().values(), rig, c)


def _check_laws(effects: Iterable[Effect], rig: Any, c: Mapping[str, float]) -> None:
    """Call the laws of users' effects, once for each type of rig. Raises InputError."""
    for one in effects:  # must be fast: the running plant makes a table each time it makes a rig
        if not one.comes_with_bench and rig not in one.checked:
            call_dry(one, rig, c)
            one.checked.add(rig)


def _replace_idle(one: Effect, parameters: ParameterSet) -> Effect | NoEffect:
    """The effect, or the null effect where all its strengths are off."""
    for name, off in one.switches:  # must be fast: the running plant asks for every effect each time it makes a rig
        if parameters[name].value != off:
            return one
    return NONE


def _check_exclusions(chosen: Sequence[Effect]) -> None:
    """Raise InputError if two of the effects model the same part."""
    names = [e.name for e in chosen]
    for one in chosen:
        if others := [name for name in one.excludes if name in names]:
            raise InputError(
                f"effects {one.name} and {others[0]} exclude each other, because both model the same part; use only one"
            )
