"""Parameter files: TOML in which every number has a unit, a source, an uncertainty and bounds.

A defaults file declares the parameters, one line each:

    [clutch]
    coulomb_slope = { value = 10.8, unit = "Nm/bar", uncertainty = 0.3, bounds = [1.0, 100.0], source = "Table 6.4" }

A user's file changes some of them, `coulomb_slope = 11.5` in the declared unit, `contact_pressure = "34 psi"` in another one,
or an inline table to change more fields.
A calibration is a user's file for plant and controller. It names its rig in [calibration], and has groups [plant.clutch],
[controller.model], .. For a rig of two clutches it has [plant."a.clutch"], .., [controller.model], .. of clutch a, and
[controller_b.model], .. of clutch b.
"""

import reprlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, isfinite
from numbers import Real  # includes NumPy's numbers
from pathlib import Path
from typing import Any

from protocols.errors import InputError, suggest_closest
from protocols.files.other_units import convert_fields, describe_other_unit, split_quantity
from protocols.files.units import space_unit, to_si
from protocols.input_file import read_toml

_FIELDS = ("value", "unit", "uncertainty", "bounds", "source")
PLANT, CONTROLLER = "plant", "controller"  # parts of a calibration
CALIBRATION = "calibration"  # its table that names the rig; no group of parameters has this name


@dataclass(frozen=True)
class Parameter:
    """A number with its source; value, `uncertainty` (one standard deviation) and `bounds` are in `unit`."""

    name: str
    value: float
    unit: str
    uncertainty: float
    bounds: tuple[float, float]
    source: str

    def __post_init__(self) -> None:
        """Check the fields. Raises InputError for a value outside its bounds, an unknown unit, or no source."""
        to_si(self.value, self.unit)
        low, high = self.bounds
        if not (isfinite(self.value) and low <= self.value <= high):
            unit, hint = space_unit(self.unit), describe_other_unit(self.value, self.unit, low, high)
            raise InputError(f"parameter {self.name} = {self.value:g}{unit} is outside {low:g}..{high:g}{hint}")
        if not 0.0 <= self.uncertainty < inf:
            raise InputError(f"parameter {self.name} has uncertainty {self.uncertainty:g}; allowed is 0 or more")
        if not self.source.strip():
            raise InputError(f"parameter {self.name} has no source; state where its value comes from")

    @property
    def si(self) -> float:
        """The value in SI units."""
        return to_si(self.value, self.unit)


class ParameterSet(Mapping[str, Parameter]):
    """Immutable parameters by dotted name (`clutch.coulomb_slope`); a change gives a new set.

    Raises InputError for an unknown name.
    """

    def __init__(self, parameters: Mapping[str, Parameter]) -> None:
        self._parameters = dict(parameters)

    def __getitem__(self, name: str) -> Parameter:
        try:
            return self._parameters[name]
        except KeyError:
            raise InputError(f"parameter {name!r} is unknown; {suggest_closest(name, self._parameters)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._parameters)

    def __len__(self) -> int:
        return len(self._parameters)

    def __contains__(self, name: object) -> bool:
        return name in self._parameters

    def with_values(self, values: Mapping[str, float]) -> "ParameterSet":
        """Return a copy with new `values` by dotted name, each in its declared unit. Raises InputError."""
        changed = {name: replace(self[name], value=_check_number(name, value)) for name, value in values.items()}
        copy = ParameterSet(self._parameters | changed)
        copy.__dict__["_groups"] = self._groups  # the names are the same
        return copy

    def list_si(self, group: str) -> dict[str, float]:
        """Return the SI values of the parameters of one group, by short name."""
        return {short: self._parameters[name].si for name, short in self._groups.get(group, ())}

    @cached_property
    def _groups(self) -> dict[str, list[tuple[str, str]]]:
        """(dotted name, short name) of the parameters in each group."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for name in self._parameters:
            group, _, short = name.partition(".")
            groups.setdefault(group, []).append((name, short))
        return groups

    def as_values(self) -> dict[str, float]:
        """Return the values by dotted name, each in its declared unit, as a run file stores them."""
        return {name: parameter.value for name, parameter in self._parameters.items()}


def load_defaults(path: Path) -> ParameterSet:
    """Read a file that declares parameters with all fields. Raises InputError naming the file and the entry."""
    parameters = {}
    for name, entry in _read_entries(path):
        if not isinstance(entry, dict) or sorted(entry) != sorted(_FIELDS):
            raise InputError(f"{path}: {name} must be a table with exactly the fields {', '.join(_FIELDS)}")
        parameters[name] = _parse_parameter(path, name, entry)
    return ParameterSet(parameters)


def list_changed(path: Path, part: str = PLANT) -> tuple[str, ...]:
    """Return the dotted names of the parameters that a user's file, or a `part` of a calibration, changes.

    Raises InputError.
    """
    return tuple(name for name, _ in _read_entries(path, part))


def read_rig(path: Path) -> str:
    """Return the rig for which a calibration was made. Raises InputError for a file that is not a calibration."""
    head = read_toml(path, "parameter file").get(CALIBRATION)
    rig = head.get("rig") if isinstance(head, dict) else None
    if not isinstance(rig, str):
        raise InputError(
            f"{path} names no rig in a table [{CALIBRATION}]; a calibration.toml of clutch-hil identify is needed"
        )
    return rig


def load_overlay(path: Path, defaults: ParameterSet, part: str = PLANT, rig: str = "") -> ParameterSet:
    """Return `defaults` changed by a user's file, which may name any subset, or by a `part` of a calibration.

    rig: for which a calibration must be made; "" accepts any. Raises InputError naming the file and the entry.
    """
    changed = dict(defaults)
    for name, entry in _read_entries(path, part, rig):
        try:
            declared = defaults[name]
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        fields = entry if isinstance(entry, dict) else {"value": entry}
        if unknown := set(fields) - set(_FIELDS):
            raise InputError(f"{path}: {name} has the unknown field {min(unknown)!r}; allowed are {', '.join(_FIELDS)}")
        if isinstance(text := fields.get("value"), str) and "unit" not in fields and (quantity := split_quantity(text)):
            fields |= dict(zip(("value", "unit"), quantity, strict=True))
        try:
            fields = convert_fields(name, fields, declared.unit)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        changed[name] = _parse_parameter(path, name, {f: getattr(declared, f) for f in _FIELDS} | fields)
        _check_sign(path, declared, changed[name])
    return ParameterSet(changed)


def _check_sign(path: Path, declared: Parameter, changed: Parameter) -> None:
    """Raise InputError if a user's bounds allow a sign or 0 that the declared bounds exclude, e.g. an inertia below 0."""
    (low, high), (new_low, new_high) = declared.bounds, changed.bounds
    for side, way, was, now in (("lower", "above", low, new_low), ("upper", "below", -high, -new_high)):
        if was >= 0.0 and (now < 0.0 or now == 0.0 < was):
            needed = f"{way} 0" if was else f"0 or {way} it"
            raise InputError(
                f"{path}: {changed.name} has bounds {new_low:g} to {new_high:g}; its {side} bound must be {needed}, as where"
                " the parameter is declared"
            )


def _read_entries(path: Path, part: str = PLANT, rig: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (dotted name, entry) of each line in each `[group]`; for a calibration, only those of its `part`."""
    document = read_toml(path, "parameter file")
    groups = _find_part(path, document, part, rig) if CALIBRATION in document else document
    for group, entries in groups.items():
        if not isinstance(entries, dict):
            raise InputError(f"{path}: {group} is outside of a [group]")
        for name, entry in entries.items():
            yield f"{group}.{name}", entry


def _find_part(path: Path, document: Mapping[str, Any], part: str, rig: str) -> Mapping[str, Any]:
    """Return the `part` of a calibration. Raises InputError if it has none, or is for another rig."""
    head, groups = document[CALIBRATION], document.get(part)
    of = head.get("rig") if isinstance(head, dict) else None
    if not isinstance(of, str) or (rig and of != rig):
        raise InputError(f"calibration {path} is of the rig {reprlib.repr(of)}; allowed is {rig or 'a name'!r}")
    if not isinstance(groups, dict):
        raise InputError(
            f"calibration {path} has no table [{part}]; parts of a calibration are {PLANT} and {CONTROLLER}, and"
            f" {CONTROLLER}_b where there are two clutches"
        )
    return groups


def _parse_parameter(path: Path, name: str, entry: Mapping[str, Any]) -> Parameter:
    try:
        bounds = entry["bounds"]
        if not isinstance(bounds, (list, tuple)) or len(bounds) != 2:
            raise InputError(f"parameter {name} has bounds {bounds!r}; allowed is [low, high]")
        low, high = (_check_number(name, bound) for bound in bounds)
        if not low <= high:
            raise InputError(f"parameter {name} has bounds [{low:g}, {high:g}]; allowed is [low, high]")
        unit = "" if entry["unit"] == "1" else f" in {entry['unit']},"
        allowed = f"a number is needed,{unit} {low:g} <= value <= {high:g}"
        return Parameter(
            name=name,
            value=_check_number(name, entry["value"], allowed),
            unit=str(entry["unit"]),
            uncertainty=_check_number(name, entry["uncertainty"]),
            bounds=(low, high),
            source=str(entry["source"]),
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _check_number(name: str, value: object, allowed: str = "a number is needed") -> float:
    if isinstance(value, Real) and not isinstance(value, bool):
        with suppress(OverflowError):  # an integer too large for a float
            return float(value)
    raise InputError(f"parameter {name} is {reprlib.repr(value)}; {allowed}")
