"""Demonstration of an effect: the rig with it, at typical values, compared with the rig without it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from clutch_hil.bench.excitation import INPUTS, QUANTITIES, Excitation, answer, excitations
from plant_sim.effects import catalogue
from plant_sim.effects.effect import Effect
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError, closest
from protocols.files.parameters import ParameterSet

_DEFAULT_EXCITATIONS = (
    "engagement",
    "triangle",
    "slip_sine",
    "slip_steps",
)  # tried for an effect that names no excitation
_FAULT_EXCITATIONS = _DEFAULT_EXCITATIONS[:1]  # for a fault, which comes in the middle of it
_COMPARED_COLUMNS = [
    column for column in QUANTITIES if column != "shaft_angle_rad"
]  # any change of slip adds up in the angle


@dataclass(frozen=True, eq=False)
class Demonstration:
    """Answers of the rig to one excitation without and with an effect, free of noise.

    column: the measured quantity that shows the effect. over: the column it is drawn over, each curve over its own.
    without, with_it: columns of docs/rig.md by name, each (n,), in the unit of its name.
    """

    excitation: Excitation
    column: str
    over: str
    without: Mapping[str, np.ndarray]
    with_it: Mapping[str, np.ndarray]

    @property
    def what(self) -> str:
        """Name of the quantity, as "clutch torque"."""
        return QUANTITIES[self.column][0]

    @property
    def unit(self) -> str:
        """Its unit."""
        return QUANTITIES[self.column][1]

    @property
    def difference(self) -> np.ndarray:
        """With the effect less without it (n,), in `unit`."""
        return self.with_it[self.column] - self.without[self.column]

    @property
    def largest(self) -> float:
        """Largest difference, in `unit`."""
        return float(np.abs(self.difference).max())

    @property
    def times_resolution(self) -> float:
        """The largest difference as a multiple of what the measurement resolves: its noise and quantisation."""
        return self.largest / QUANTITIES[self.column][2]


def demonstrate(effect: Effect) -> Demonstration:
    """The demonstration that the effect's `display` asks for; what it leaves open is what the effect changes most.

    A fault comes in the middle of the experiment. Raises InputError for an experiment or a column that does not exist.
    """
    display = effect.display
    known = {"excitation": excitations(), "column": QUANTITIES, "over": ("time_s", *INPUTS, *QUANTITIES)}
    for field, names in known.items():
        name = getattr(display, field)
        if name is not None and name not in names:
            raise InputError(
                f"effect {effect.name}: {field} {name!r} of its display is unknown; {closest(name, names)}"
            )
    if display.excitation is not None:
        excitation_names: Sequence[str] = (display.excitation,)
    else:
        excitation_names = _FAULT_EXCITATIONS if effect.block == "fault" else _DEFAULT_EXCITATIONS
    columns = _COMPARED_COLUMNS if display.column is None else [display.column]
    candidates = [one for name in excitation_names for one in _demonstrations(effect, name, columns)]
    return max(candidates, key=lambda one: one.times_resolution)


def _demonstrations(effect: Effect, name: str, columns: Sequence[str]) -> list[Demonstration]:
    """The answers to the excitation `name`, without and with the effect, a demonstration for each of `columns`."""
    beside = effect.display.beside
    excitation = excitations()[name]
    if beside:
        excitation = replace(excitation, title=f"{excitation.title}, beside {beside}")
    without = _simulate_without_effect(name, beside)
    parameters = _parameters(beside)
    changed = parameters.with_values(effect.typical())
    if effect.block == "fault":
        with_it = _simulate_settled(parameters, excitation, (len(excitation.voltage) // 2, changed))
    else:
        with_it = _simulate_settled(changed, excitation)
    over = effect.display.over or excitation.over
    return [Demonstration(excitation, column, over, without, with_it) for column in columns]


@cache
def _simulate_without_effect(name: str, beside: str | None) -> Mapping[str, np.ndarray]:
    """Columns of the answer to the excitation `name` without the effect."""
    return _simulate_settled(_parameters(beside), excitations()[name])


def _parameters(beside: str | None) -> ParameterSet:
    """Parameters of the nominal rig, with the effect `beside` at its typical values."""
    return wet_clutch.nominal().with_values(catalogue.effect(beside).typical() if beside else {})


def _simulate_settled(
    parameters: ParameterSet, excitation: Excitation, later: tuple[int, ParameterSet] | None = None
) -> Mapping[str, np.ndarray]:
    """Columns of the answer after the excitation's settling; `later`: see `answer`."""
    columns = answer(parameters, excitation, later=later)
    return {name: column[excitation.settling :] for name, column in columns.items()}
