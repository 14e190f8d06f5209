"""Unsealing: read the truth of a blind run, if neither the run nor its truth file was changed."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.bench.progress import format_table
from clutch_hil.bench.run_file import read_run
from clutch_hil.bench.sealed import SEAL, compute_checksum, make_truth_path, select_public_metadata
from plant_sim.effects.catalogue import load_effects
from protocols.errors import InputError
from protocols.files.run import Run
from protocols.telemetry.truth import reveals_truth


def read_truth(path: Path, folder: Path | None = None) -> tuple[Path, Run]:
    """Find the truth file of the blind run at `path`, beside it or in `folder`; return its path and the whole run in it.

    Raises InputError if the run is not blind, if its truth file is missing, or if one of the two was changed.
    """
    run = read_run(path)
    seal = run.metadata.get(SEAL)
    if not (isinstance(seal, dict) and {"file", "sha256"} <= seal.keys()):
        if (truth := make_truth_path(path, folder)).exists():
            raise InputError(
                f"run {path} has been changed since it was recorded: its seal is missing, but its truth file {truth} exists"
            )
        raise InputError(f"run {path} is not sealed: it was recorded without --blind")
    truth = (folder or path.parent) / seal["file"]
    if not truth.exists():
        raise InputError(f"truth file {truth} of run {path} does not exist; give its folder with --truth")
    if compute_checksum(truth) != seal["sha256"]:
        raise InputError(f"truth file {truth} has been changed since the run was recorded: its SHA-256 differs")
    whole = read_run(truth)
    columns = [name for name in whole.columns if not reveals_truth(name)]
    for name in dict.fromkeys((*run.columns, *columns)):
        mine, sealed = run.columns.get(name), whole.columns.get(name)
        if mine is None or sealed is None or not np.array_equal(mine, sealed, equal_nan=True):
            raise _change_error(path, f"the column {name}")
    expected = select_public_metadata(whole.metadata) | {SEAL: seal}
    for name in dict.fromkeys((*run.metadata, *expected)):
        if json.dumps(run.metadata.get(name)) != json.dumps(expected.get(name)):  # compared as text, NaN equals NaN
            raise _change_error(path, f"its metadata entry {name}")
    return truth, whole


def describe_truth(path: Path, truth: Path, whole: Run) -> tuple[dict[str, Any], str, str, bool]:
    """Describe what the truth file adds to the run at `path`; return document, text, verdict and True."""
    metadata = whole.metadata
    on = _list_active_effects(metadata["plant_parameters"])
    injections, settings = metadata["injections"], metadata["settings"]
    columns = [name for name in whole.columns if reveals_truth(name)]
    values = [(name, short, f"{value:g}") for name, own in on.items() for short, value in own.items()]
    changes = [
        (i["name"], i["unit"], f"{i['old']:g}", f"{i['new']:g}", f"{i['at']:.3f}", f"{i['ramp']:g}", str(i["row"]))
        for i in injections
    ]
    lines = _format_table(("effect on at the start", "parameter", "value"), values)
    lines += _format_table(("injected", "unit", "from", "to", "at [s]", "along [s]", "row"), changes)
    lines += [f"settings: {', '.join(f'{name} {value}' for name, value in settings.items())}"]
    lines += [f"columns:  {', '.join(columns)}", f"read:    {path}", f"         {truth}", "wrote:   nothing"]
    verdict = (
        f"run and truth file are as recorded; effects on at the start {len(on)}, changes injected {len(injections)}"
    )
    document = {
        "run": str(path), "truth": str(truth), "effects": on, "injections": injections, "settings": settings,
        "scenario": metadata.get("scenario"), "columns": columns, "verdict": verdict,
    }  # fmt: skip
    return document, "\n".join(lines), verdict, True


def _format_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [format_table([head, *rows]) if rows else f"{head[0]}: nothing", ""]


def _list_active_effects(parameters: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Return the parameters of the effects that are on, by effect and short name."""
    off = {name: effect.list_off_values() for name, effect in load_effects().items()}
    on = [name for name, values in off.items() if any(parameters.get(p, value) != value for p, value in values.items())]
    return {
        name: {
            p.name: parameters[f"{name}.{p.name}"]
            for p in load_effects()[name].parameters
            if f"{name}.{p.name}" in parameters
        }
        for name in on
    }


def _change_error(path: Path, what: str) -> InputError:
    return InputError(f"run {path} has been changed since it was recorded: {what} differs from its truth file")
