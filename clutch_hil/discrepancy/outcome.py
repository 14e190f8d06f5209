"""Outcome: run a search over recorded runs, and write its report and its model file."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from clutch_hil.bench.sealed import checksum
from clutch_hil.discrepancy.model import Columns, Model
from clutch_hil.discrepancy.model_file import read_model, write_model
from clutch_hil.discrepancy.models.named import declared, model_named
from clutch_hil.discrepancy.regimes import Regimes
from clutch_hil.discrepancy.report import write_report
from clutch_hil.discrepancy.result import Result
from clutch_hil.discrepancy.search import investigate
from clutch_hil.discrepancy.selection import Progress


def run_and_write(
    known: Model,
    rig: str,
    model: Path | None,
    runs: Mapping[str, Columns],
    held_out: Mapping[str, Columns],
    names: Sequence[str] | None,
    out: Path,
    progress: Progress,
) -> tuple[Result, list[Path]]:
    """Find what is missing in the model `known` to explain `runs`, and write the report and the model file into `out`.

    rig, model: name of the rig, and model file, that `known` was made of. runs, held_out: columns by path. names: restricts the
    candidates. Returns the result and the files written. Raises InputError.
    """
    result = investigate(known, runs, held_out, names, progress)
    hashes = {name: checksum(Path(name)) for name in (*runs, *held_out)}
    result = replace(result, hashes=hashes, holdout=list(held_out), model=str(model) if model else None)
    shipped = declared(model_named(rig))
    write_model(result, shipped, out / "model.toml", read_model(model, shipped) if model else None)
    start = {name: p.value for name, p in known.parameters.items()}
    regimes = Regimes(known, [*runs.values(), *held_out.values()], start)
    files = write_report(result, out, regimes, shlex.join(["clutch-hil", *sys.argv[1:]]))
    return result, [*files, out / "model.toml"]
