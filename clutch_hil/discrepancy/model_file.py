"""Model file: a model with the effects of a result added, as an overlay that `--model` reads (protocols/files/parameters.py).

    # Written by clutch-hil 0.1.0, 2026-11-21T16:40:00+00:00
    # verdict: named: piston_seal_friction (confidence 0.97)
    [piston_seal_friction]
    force = { value = 61.8, uncertainty = 0.9, source = "fitted by clutch-hil discrepancy, 95 % interval 60.0..63.6 N, ..." }

It contains the re-fitted parameters of the baseline and those of the effects that are on. All others stay as declared.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import datetime
from importlib.metadata import version
from itertools import groupby
from pathlib import Path

from clutch_hil.discrepancy.result import Estimate, Result
from protocols.errors import InputError
from protocols.files.output_file import whole_file
from protocols.files.parameters import Parameter, ParameterSet, load_overlay
from protocols.files.toml_text import make_comment, quote_text
from protocols.files.units import space_unit

_MOVED = 1e-6  # uncertainties: a baseline parameter that moved less stays as declared
_NORMAL_95 = 1.959964  # standard deviations: half width of a 95 % interval


def write_model(result: Result, parameters: ParameterSet, path: Path, started: ParameterSet | None = None) -> None:
    """Write the fitted parameters of `result` to `path`, as changes of `parameters`, which declare the model as shipped.

    started: initial parameters of the search, where a model file had changed them; its changes stay in the new file.
    Raises InputError for a name missing in `parameters`, a value outside its bounds, another unit, or a folder that is not
    writable. The file appears only when it is complete.
    """
    data = combine_hashes(result.hashes)
    before = {name: p for name, p in (started or {}).items() if p != parameters[name]}
    moved = [e for e in result.baseline if not abs(e.value - parameters[e.name].value) <= _MOVED * e.uncertainty]
    estimates = [(e, "re-fitted") for e in moved] + [(e, "fitted") for e in result.parameters]
    after = {
        e.name: _change(
            parameters[e.name],
            e,
            f"{how} by clutch-hil discrepancy, {_format_interval(e)}, data SHA-256 {data[:16]}...",
        )
        for e, how in estimates
    }
    carried = (result.surrogate or {}).get(
        "values", {}
    )  # of none_of_these: it reproduces the rest without explaining it
    after |= {
        name: replace(
            parameters[name], value=float(value), source=f"surrogate of the missing physics, data SHA-256 {data}"
        )
        for name, value in carried.items()
    }
    text = "\n".join([*_format_header(result, data), *_format_parameters((before | after).values()), ""])
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")


def read_model(path: Path, parameters: ParameterSet) -> ParameterSet:
    """Return `parameters`, which declare baseline and candidates of the model, as changed by the file. Raises InputError."""
    return load_overlay(path, parameters)


def combine_hashes(hashes: Mapping[str, str]) -> str:
    """Return the SHA-256 of the SHA-256 values of all runs, independent of their order and paths."""
    return hashlib.sha256("\n".join(sorted(hashes.values())).encode()).hexdigest()


def _change(declared: Parameter, estimate: Estimate, source: str) -> Parameter:
    if estimate.unit != declared.unit:
        raise InputError(f"parameter {estimate.name} was fitted in {estimate.unit!r}; its unit is {declared.unit!r}")
    low, high = estimate.ci95
    # the longer side: an interval ends at the bounds of the parameter
    uncertainty = float(max(high - estimate.value, estimate.value - low)) / _NORMAL_95
    return replace(declared, value=float(estimate.value), uncertainty=uncertainty, source=source)


def _format_interval(estimate: Estimate) -> str:
    low, high = estimate.ci95
    return f"95 % interval {low:.5g}..{high:.5g}{space_unit(estimate.unit)}"


def _format_header(result: Result, data: str) -> list[str]:
    effects = ", ".join(result.effects) or "-"
    if result.alternatives:
        effects += f"; alternatives {'; '.join(', '.join(group) for group in result.alternatives)}"
    lines = [
        f"rig {result.rig}, extended by clutch-hil {version('clutch-hil')} discrepancy,"
        f" {datetime.now().astimezone().isoformat(timespec='seconds')}",
        f"verdict: {result.verdict}: {effects} (confidence {result.confidence:.3g})",
        f"data SHA-256 {data}, of",
        *(f"  {sha}  {name}" for name, sha in result.hashes.items()),
    ]
    return [make_comment(line) for line in lines]


def _format_parameters(parameters: Iterable[Parameter]) -> list[str]:
    lines = []
    for group, members in groupby(sorted(parameters, key=_find_group), key=_find_group):
        lines += ["", f"[{quote_text(group) if '.' in group else group}]"]
        for p in members:
            source = quote_text(p.source)
            entry = f"value = {float(p.value)!r}, uncertainty = {float(p.uncertainty)!r}, source = {source}"
            lines.append(f"{p.name.rpartition('.')[2]} = {{ {entry} }}")
    return lines


def _find_group(parameter: Parameter) -> str:
    return parameter.name.rpartition(".")[0]
