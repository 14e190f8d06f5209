"""Demonstration of an effect: the rig with the effect at typical values, compared with the rig without it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from clutch_hil.bench.effect_sheets.excitation import INPUTS, QUANTITIES, Excitation, answer, make_excitations
from plant_sim.effects import catalogue
from plant_sim.effects.effect import Effect
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError, suggest_closest
from protocols.files.parameters import ParameterSet

# used for an effect whose `display` names no excitation
_DEFAULT_EXCITATIONS = ("engagement", "triangle", "slip_sine", "slip_steps")
_FAULT_EXCITATIONS = _DEFAULT_EXCITATIONS[:1]  # used for a fault, which begins in the middle of the excitation
# The angle is left out, because it integrates any change of the slip
_COMPARED_COLUMNS = [column for column in QUANTITIES if column != "shaft_angle_rad"]


@dataclass(frozen=True, eq=False)
class Demonstration:
    """Responses of the rig to one excitation without and with an effect, free of noise.

    column: the measured quantity that shows the effect. over: the column on the horizontal axis, separate for each curve.
    without, with_it: columns of docs/rig.md by name, each (n,), in the unit of its name.
    """

    excitation: Excitation
    column: str
    over: str
    without: Mapping[str, np.ndarray]
    with_it: Mapping[str, np.ndarray]

    @property
    def what(self) -> str:
        """Return the name of the quantity, such as "clutch torque"."""
        return QUANTITIES[self.column][0]

    @property
    def unit(self) -> str:
        """Return the unit of the quantity."""
        return QUANTITIES[self.column][1]

    @property
    def difference(self) -> np.ndarray:
        """Return the response with the effect minus the response without it (n,), in `unit`."""
        return self.with_it[self.column] - self.without[self.column]

    @property
    def largest(self) -> float:
        """Return the largest absolute difference, in `unit`."""
        return float(np.abs(self.difference).max())

    @property
    def times_resolution(self) -> float:
        """Return the largest difference divided by the resolution of the measurement, which is its noise and quantisation."""
        return self.largest / QUANTITIES[self.column][2]


def demonstrate(effect: Effect) -> Demonstration:
    """Simulate the demonstration that the effect's `display` asks for.

    Where `display` names no excitation or no column, the one with the largest difference relative to its resolution is chosen.
    A fault begins in the middle of the excitation. Raises InputError for an excitation or a column that does not exist.
    """
    display = effect.display
    known = {"excitation": make_excitations(), "column": QUANTITIES, "over": ("time_s", *INPUTS, *QUANTITIES)}
    for field, names in known.items():
        name = getattr(display, field)
        if name is not None and name not in names:
            raise InputError(
                f"effect {effect.name}: {field} {name!r} of its display is unknown; {suggest_closest(name, names)}"
            )
    if display.excitation is not None:
        excitation_names: Sequence[str] = (display.excitation,)
    else:
        excitation_names = _FAULT_EXCITATIONS if effect.block == "fault" else _DEFAULT_EXCITATIONS
    columns = _COMPARED_COLUMNS if display.column is None else [display.column]
    candidates = [one for name in excitation_names for one in _play_demonstrations(effect, name, columns)]
    return max(candidates, key=lambda one: one.times_resolution)


def _play_demonstrations(effect: Effect, name: str, columns: Sequence[str]) -> list[Demonstration]:
    """Simulate the excitation `name` without and with the effect; return a demonstration for each of `columns`."""
    beside = effect.display.beside
    excitation = make_excitations()[name]
    if beside:
        excitation = replace(excitation, title=f"{excitation.title}, beside {beside}")
    without = _simulate_without_effect(name, beside)
    parameters = _make_parameters(beside)
    changed = parameters.with_values(effect.list_typical_values())
    if effect.block == "fault":
        with_it = _simulate_settled(parameters, excitation, (len(excitation.voltage) // 2, changed))
    else:
        with_it = _simulate_settled(changed, excitation)
    over = effect.display.over or excitation.over
    return [Demonstration(excitation, column, over, without, with_it) for column in columns]


@cache
def _simulate_without_effect(name: str, beside: str | None) -> Mapping[str, np.ndarray]:
    """Return the columns of the response to the excitation `name` without the effect."""
    return _simulate_settled(_make_parameters(beside), make_excitations()[name])


def _make_parameters(beside: str | None) -> ParameterSet:
    """Return the parameters of the nominal rig, with the effect `beside` at its typical values."""
    return wet_clutch.load_nominal().with_values(catalogue.find_effect(beside).list_typical_values() if beside else {})


def _simulate_settled(
    parameters: ParameterSet, excitation: Excitation, later: tuple[int, ParameterSet] | None = None
) -> Mapping[str, np.ndarray]:
    """Return the columns of the response after the excitation's settling; `later`: see `answer`."""
    columns = answer(parameters, excitation, later=later)
    return {name: column[excitation.settling :] for name, column in columns.items()}
