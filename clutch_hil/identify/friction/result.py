"""IdentifiedFriction: a friction law that was identified, with its intervals, and the TOML file that keeps it.

    friction = ch.read_friction("friction.toml")
    friction.model                      # a model of plant_sim.friction: simulate, couple, put it into a rig
    friction.feedforward()              # inertia, friction and offset for the position axis

The file has units, 95 % intervals, correlation, the hash of each run, and how the law was chosen. It loads back to the
last digit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.bench.arguments import take_path
from clutch_hil.identify.friction.law import CONSTANTS, PARAMETERS, Structure, find_law
from plant_sim.friction.model import FrictionModel
from plant_sim.rigs.position_feedforward import Feedforward
from protocols.errors import InputError, name_file_in_errors
from protocols.files.output_file import whole_file
from protocols.files.toml_table import TomlTable, read_table
from protocols.files.toml_text import make_comment, quote_text

KIND = "friction"
_KEYS = (
    "kind", "law", "elements", "terms", "rig", "date", "verdict", "warnings", "units", "errors", "constants", "parameters",
    "correlation", "runs", "steps",
)  # fmt: skip


@dataclass(frozen=True)
class Parameter:
    """A fitted parameter: `value` with its 95 % interval `low` to `high` in `unit`; not-a-number where it does not hold."""

    name: str
    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class UsedRun:
    """A run that was read: its `source`, the SHA-256 of its file, and how it was `used`: fitted or held out."""

    source: str
    sha256: str
    used: str


@dataclass(frozen=True)
class TriedStep:
    """A structure on the way to the result: its text, RMS errors [N] where fitted and held out, whether it is `chosen`."""

    structure: str
    parameters: int
    fitted: float
    held_out: float
    chosen: bool


@dataclass(frozen=True)
class IdentifiedFriction:
    """A friction law that runs were explained with.

    `structure` and `parameters` are the law; `constants` what was not fitted. `errors` [N]: RMS `fitted`, `held_out` on
    stretches (cross-validation), and `held_out_runs`, not-a-number without any. `units` of position, force and load.
    `correlation` (m, m) in the order of `parameters`. `starts`: how many searches ended at this minimum, of how many.
    """

    structure: Structure
    parameters: tuple[Parameter, ...]
    constants: Mapping[str, float]
    correlation: np.ndarray
    errors: Mapping[str, float]
    units: tuple[str, str, str]
    starts: tuple[int, int]
    steps: tuple[TriedStep, ...]
    runs: tuple[UsedRun, ...]
    warnings: tuple[str, ...]
    date: str
    rig: str = ""

    def __getitem__(self, name: str) -> float:
        """Value of a parameter or constant by name, in SI; 0 for that of a term of the rig that was not needed."""
        known = self.values
        if name in known:
            return known[name]
        if name in ("mass", "offset", "delay", "load_gain"):
            return 0.0
        raise InputError(f"the law has no parameter {name!r}; it has {', '.join(known)}")

    @cached_property
    def values(self) -> dict[str, float]:
        """All values by name, SI."""
        return {**self.constants, **{one.name: one.value for one in self.parameters}}

    @cached_property
    def model(self) -> FrictionModel:
        """The friction model, for `plant_sim` and `clutch_hil.friction.simulate`. Raises InputError."""
        return self.structure.build(self.values)

    @property
    def mass(self) -> float:
        """Moved mass [kg or kg m^2]; 0 where the runs did not show it."""
        return self["mass"]

    def feedforward(self) -> Feedforward:
        """Inertia, friction and offset of a wanted motion, for `plant_sim.rigs.position_axis`."""
        return Feedforward(self.mass, self.model, self["offset"])

    def interval(self, name: str) -> tuple[float, float]:
        """The 95 % interval of a parameter. Raises InputError."""
        for one in self.parameters:
            if one.name == name:
                return one.low, one.high
        raise InputError(f"the law has no parameter {name!r}; it has {', '.join(one.name for one in self.parameters)}")

    @property
    def verdict(self) -> str:
        """One line: the law and how well it explains what was not fitted."""
        unit = self.units[1]
        error = self.errors["held_out_runs"] if isfinite(self.errors["held_out_runs"]) else self.errors["held_out"]
        what = "runs" if isfinite(self.errors["held_out_runs"]) else "stretches"
        doubts = f", {len(self.warnings)} warning{'s' * (len(self.warnings) != 1)}" if self.warnings else ""
        return f"{self.structure}: {error:.3g} {unit} RMS on held-out {what}{doubts}"

    def as_json(self) -> dict[str, Any]:
        """The document of `--json`, and of the file."""
        return {
            "kind": KIND,
            "law": self.structure.law.name,
            "elements": self.structure.elements,
            "terms": list(self.structure.terms),
            "rig": self.rig,
            "date": self.date,
            "verdict": self.verdict,
            "warnings": list(self.warnings),
            "units": dict(zip(("position", "force", "load"), self.units, strict=True)),
            "errors": {**self.errors, "starts_here": self.starts[0], "starts": self.starts[1]},
            "constants": dict(self.constants),
            "parameters": {
                one.name: {"value": one.value, "low": one.low, "high": one.high, "unit": one.unit}
                for one in self.parameters
            },
            "correlation": {"names": [one.name for one in self.parameters], "matrix": self.correlation.tolist()},
            "runs": [vars(one) for one in self.runs],
            "steps": [vars(one) for one in self.steps],
        }

    def write(self, path: Path | str) -> Path:
        """Write the TOML file; it appears when it is complete. Raises InputError."""
        path = Path(path)
        with whole_file(path) as part:
            part.write_text(as_toml(self.as_json()), encoding="utf-8")
        return path


def read_friction(path: Path | str) -> IdentifiedFriction:
    """The law in a file that `clutch-hil identify --friction` wrote. Raises InputError, which names the entry."""
    path = take_path("path", path)
    with name_file_in_errors("file", path):
        return _read_friction(path)


def _read_friction(path: Path) -> IdentifiedFriction:
    document = read_table(path, _KEYS)
    if document.need("kind", str) != KIND:
        raise InputError(f"file {path} is of the kind {document.get('kind', str)!r}; {KIND!r} is needed")
    terms = _read_texts(document, "terms")
    if unknown := [term for term in terms if term not in PARAMETERS]:
        raise InputError(f"file {path}: term {unknown[0]!r} is unknown; known are {', '.join(PARAMETERS)}")
    structure = Structure(find_law(document.need("law", str)), document.need("elements", int), terms)
    entries = document.read_subtable("parameters")
    if set(entries) != set(structure.names):
        raise InputError(
            f"file {path} has the parameters {', '.join(entries)}; {structure} has {', '.join(structure.names)}"
        )
    parameters = []
    for name in structure.names:
        entry = entries.read_subtable(name, ("value", "low", "high", "unit"))
        low, high = (_read_number(entry, key) for key in ("low", "high"))
        parameters.append(Parameter(name, entry.need("value", float), low, high, entry.get("unit", str, "")))
    units = document.read_subtable("units", ("position", "force", "load"))
    errors = document.read_subtable("errors")
    friction = IdentifiedFriction(
        structure=structure,
        parameters=tuple(parameters),
        constants={name: document.read_subtable("constants", CONSTANTS).need(name, float) for name in CONSTANTS},
        correlation=np.array(document.read_subtable("correlation").get("matrix", list, []), float),
        errors={name: _read_number(errors, name) for name in ("fitted", "held_out", "held_out_runs")},
        units=(units.need("position", str), units.need("force", str), units.get("load", str, "")),
        starts=(errors.get("starts_here", int, 0), errors.get("starts", int, 0)),
        steps=tuple(
            TriedStep(
                one.need("structure", str), one.get("parameters", int, 0), _read_number(one, "fitted"),
                _read_number(one, "held_out"), one.get("chosen", bool, False),
            )
            for one in document.read_subtables("steps", ("structure", "parameters", "fitted", "held_out", "chosen"))
        ),
        runs=tuple(
            UsedRun(one.need("source", str), one.get("sha256", str, ""), one.get("used", str, ""))
            for one in document.read_subtables("runs", ("source", "sha256", "used"))
        ),
        warnings=_read_texts(document, "warnings"),
        date=document.get("date", str, ""),
        rig=document.get("rig", str, ""),
    )  # fmt: skip
    _ = friction.model  # raises InputError for parameters that it cannot have
    return friction


def _read_texts(document: TomlTable, key: str) -> tuple[str, ...]:
    values = document.get(key, list, [])
    if not all(isinstance(value, str) for value in values):
        raise InputError(f"entry {key} is {values!r:.60}; allowed is a list of texts")
    return tuple(values)


def _read_number(table: TomlTable, key: str) -> float:
    """A number that may be missing, or not-a-number."""
    try:
        return float(table.get(key, float, nan))
    except InputError:
        if (value := dict(table._entries).get(key)) != value:  # not-a-number alone differs from itself
            return nan
        raise


def as_toml(document: Mapping[str, Any]) -> str:
    """The document of a result as the text of its file."""
    lines = [make_comment("Written by clutch-hil identify --friction. Values in SI, intervals at 95 %.")]
    tables: list[str] = []
    for key, value in document.items():
        if isinstance(value, dict):
            tables.append(f"\n[{key}]")
            tables += [f"{name} = {_format_value(entry)}" for name, entry in value.items()]
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for entry in value:
                tables.append(f"\n[[{key}]]")
                tables += [f"{name} = {_format_value(item)}" for name, item in entry.items()]
        else:
            lines.append(f"{key} = {_format_value(value)}")
    return "\n".join([*lines, *tables]) + "\n"


def _format_value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{name} = {_format_value(item)}" for name, item in value.items()) + " }"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(_format_value(item) for item in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value) if isfinite(value) else ("nan" if value != value else ("inf" if value > 0 else "-inf"))
    return quote_text(value) if isinstance(value, str) else str(value)
