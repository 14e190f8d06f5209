"""Follow-up: a report's proposed experiment is played, its recording joins the evidence, and the decision is taken again."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from clutch_hil.bench.sealed import checksum
from clutch_hil.discrepancy.experiment_design import Experiment
from protocols.errors import InputError

if TYPE_CHECKING:
    from clutch_hil.discrepancy.result import Result

RIG = "wet_clutch"  # whose bench we have


@dataclass(frozen=True)
class Report:
    """What a `report.json` says for a follow-up: its verdict, the runs that were fitted and those `held_out`, unchanged since,
    the `experiment` that it proposes, and the model file that its search began with, if any."""

    path: Path
    verdict: str
    runs: tuple[Path, ...]
    held_out: tuple[Path, ...]
    experiment: Experiment
    model: Path | None

    @classmethod
    def read(cls, path: Path) -> "Report":
        """The report at `path`. Raises InputError when it is none, proposes no experiment, or its runs have been changed."""
        document = _document(path)
        if (rig := document.get("rig")) != RIG:
            raise InputError(f"report {path} is of the rig {rig!r}; experiments can be played on {RIG}")
        experiment = _experiment(path, document.get("experiment"))
        hashes = document.get("runs")
        if not isinstance(hashes, Mapping) or not hashes:
            raise InputError(f"report {path} names no runs; write it anew with clutch-hil discrepancy")
        for name, sha in hashes.items():
            if not Path(name).is_file():
                raise InputError(
                    f"run {name} of report {path} does not exist; run this command where the report was made"
                )
            if checksum(Path(name)) != sha:
                raise InputError(f"run {name} has been changed since report {path} was written: its SHA-256 is another")
        held_out = tuple(map(str, document.get("holdout") or ()))
        model = document.get("model")
        fitted = tuple(Path(name) for name in hashes if name not in held_out)
        return cls(
            path,
            str(document["verdict"]),
            fitted,
            tuple(map(Path, held_out)),
            experiment,
            Path(model) if model else None,
        )


def _document(path: Path) -> Mapping[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"report {path} does not exist") from None
    except (OSError, ValueError) as error:
        raise InputError(f"report {path} cannot be read: {error}") from None
    if not isinstance(document, Mapping) or "verdict" not in document:
        raise InputError(f"{path} is no report of clutch-hil discrepancy: it has no verdict")
    return document


def _experiment(path: Path, proposed: Any) -> Experiment:
    if not isinstance(proposed, Mapping):
        raise InputError(f"report {path} proposes no experiment: its verdict waits for none")
    if not proposed.get("profile"):
        raise InputError(
            f"report {path} proposes no experiment: {proposed.get('why', 'none separates the alternatives')}"
        )
    settings = proposed.get("settings", {})
    try:
        return Experiment(str(proposed["profile"]), float(settings["temperature"]), int(settings["rate"]))
    except (KeyError, TypeError, ValueError):
        raise InputError(
            f"report {path}: settings of the experiment are {settings!r}; needed are temperature and rate"
        ) from None


def decide_again(
    report: Report, new: Path, out: Path, progress: Callable[[float, int], None]
) -> tuple["Result", list[Path]]:
    """The result with the run `new` among the evidence of `report`, and the files that were written into `out`."""
    from clutch_hil.discrepancy.models.named import model_named
    from clutch_hil.discrepancy.outcome import run_and_write
    from protocols.files.runs import read_run

    runs = {str(path): read_run(path).columns for path in (*report.runs, new)}
    held_out = {str(path): read_run(path).columns for path in report.held_out}
    known = model_named(RIG, report.model)
    return run_and_write(known, RIG, report.model, runs, held_out, None, out, lambda what, share: progress(share, 1))
