"""Calibration: result of an identification for plant and controller, as one TOML file.

    [calibration]
    rig = "wet_clutch"
    date = "2026-11-26T01:30:00+00:00"

    [[calibration.runs]]
    file = "stribeck.parquet"
    sha256 = "..."

    [plant.clutch]
    coulomb_slope = { value = 17.02, uncertainty = 0.011, source = "identified from 5 runs, 95 % 16.99..17.04 Nm/bar" }

    [controller.model]
    coulomb_slope = { ... }

    [correlation]
    names = [...]
    matrix = [[...]]

`protocols/files/parameters.py` reads the sections of plant and controller like any other file that changes parameters.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np

from clutch_hil.fitting.intervals import NORMAL_95
from protocols.can.two_clutches import CONTROLLERS
from protocols.files.output_file import whole_file
from protocols.files.toml_text import make_comment, quote_text
from protocols.files.units import space_unit


@dataclass(frozen=True)
class Identified:
    """An identified parameter: value and half width of its 95 % interval in `unit`. declared: value before identification."""

    name: str
    value: float
    half: float
    unit: str
    declared: float

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval."""
        return self.value - self.half, self.value + self.half

    @property
    def source(self) -> str:
        """Source of the value, for a parameter file."""
        low, high = self.interval
        return f"identified, 95 % interval {low:.6g}..{high:.6g}{space_unit(self.unit)}"

    def make_document(self) -> dict:
        """Return the parameter as a JSON document."""
        return {
            "name": self.name, "value": self.value, "unit": self.unit, "ci95": list(self.interval), "declared": self.declared,
        }  # fmt: skip


@dataclass(frozen=True)
class Calibration:
    """A calibration of a `rig`.

    parameters: identified parameters of the plant. controller: values by dotted name, with their source. controller_b: those of
    clutch b on a rig with two clutches. correlation (p, p): of the parameters.
    runs: SHA-256 by name. held: parameters that were not identified, with the reason. warnings, notes: sentences.
    fixed: values of the plant that were not fitted and differ from the declared ones, with their source.
    absent: effects that were tested and found absent; the plant section does not contain them.
    """

    rig: str
    parameters: Sequence[Identified]
    controller: Mapping[str, tuple[float, str]]
    correlation: np.ndarray
    runs: Mapping[str, str]
    held: Mapping[str, str] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    notes: Sequence[str] = ()
    absent: Sequence[Identified] = ()
    fixed: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    controller_b: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    date: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))

    def __getitem__(self, name: str) -> Identified:
        return next(one for one in self.parameters if one.name == name)

    def write(self, path: Path | str) -> None:
        """Write the file to `path`; it appears only when it is complete. Raises InputError."""
        with whole_file(Path(path)) as part:
            part.write_text("\n".join([*self._format_lines(), ""]), encoding="utf-8")

    def _format_lines(self) -> list[str]:
        lines = [
            f"Written by clutch-hil identify {version('clutch-hil')}",
            *(f"not identified: {n}: {why}" for n, why in self.held.items()),
            *(f"absent: {one.name}: {one.source}" for one in self.absent),
            *(f"warning: {text}" for text in self.warnings),
        ]
        lines = [make_comment(text) for text in lines]
        lines += ["", "[calibration]", f"rig = {quote_text(self.rig)}", f"date = {quote_text(self.date)}"]
        for name, digest in self.runs.items():
            lines += ["", "[[calibration.runs]]", f"file = {quote_text(name)}", f"sha256 = {quote_text(digest)}"]
        plant = {
            one.name: f"value = {float(one.value)!r}, unit = {quote_text(one.unit)},"
            f" uncertainty = {float(one.half) / NORMAL_95!r}, source = {quote_text(one.source)}"
            for one in self.parameters
        } | {name: f"value = {float(value)!r}, source = {quote_text(why)}" for name, (value, why) in self.fixed.items()}
        controllers = {
            part: {n: f"value = {float(value)!r}, source = {quote_text(why)}" for n, (value, why) in values.items()}
            for part, values in zip(CONTROLLERS, (self.controller, self.controller_b), strict=True)
        }
        for part, entries in (("plant", plant), *controllers.items()):
            for group in dict.fromkeys(name.rpartition(".")[0] for name in entries):
                members = [name for name in entries if name.rpartition(".")[0] == group]
                key = quote_text(group) if "." in group else group
                lines += ["", f"[{part}.{key}]", *(f"{n.rpartition('.')[2]} = {{ {entries[n]} }}" for n in members)]
        rows = [f"    [{', '.join(f'{value:.4f}' for value in row)}]," for row in self.correlation.tolist()]
        names = ", ".join(quote_text(one.name) for one in self.parameters)
        return [*lines, "", "[correlation]", f"names = [{names}]", "matrix = [", *rows, "]"]

    def make_document(self) -> dict:
        """Return the calibration as a JSON document."""
        return {
            "rig": self.rig,
            "date": self.date,
            "parameters": [p.make_document() for p in self.parameters],
            "absent": [p.make_document() for p in self.absent],
            "controller": {name: value for name, (value, _) in self.controller.items()},
            **({"controller_b": {n: v for n, (v, _) in self.controller_b.items()}} if self.controller_b else {}),
            "held": dict(self.held), "warnings": list(self.warnings), "notes": list(self.notes), "runs": dict(self.runs),
        }  # fmt: skip
