"""Follow-up: play the experiment that a report proposes, add its recording to the evidence, and decide again."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from clutch_hil.bench.rig import list_rigs_with_model
from clutch_hil.bench.sealed import compute_checksum
from clutch_hil.discrepancy.experiment_design import Experiment
from clutch_hil.discrepancy.result import IDENTIFY_FIRST
from protocols.errors import InputError
from protocols.input_file import read_json

if TYPE_CHECKING:
    from clutch_hil.discrepancy.outcome import Discrepancy


@dataclass(frozen=True)
class Report:
    """The content of a `report.json` that a follow-up needs.

    It contains the rig, the verdict, the fitted and the `held_out` runs, and the proposed `experiment`. `model` is the model
    file that the search started from, if any. `forced`: hard check findings were overridden; the follow-up then overrides them
    too.
    """

    path: Path
    rig: str
    verdict: str
    runs: tuple[Path, ...]
    held_out: tuple[Path, ...]
    experiment: Experiment
    model: Path | None
    forced: bool = False

    @classmethod
    def read(cls, path: Path) -> "Report":
        """Read the report at `path`. Raises InputError if it is no report, proposes no experiment, or its runs have changed."""
        document = _read_document(path)
        if (rig := document.get("rig")) not in (playable := list_rigs_with_model()):
            raise InputError(f"report {path} is of the rig {rig!r}; experiments can be played on {', '.join(playable)}")
        if document["verdict"] == IDENTIFY_FIRST:
            command = (document.get("recalibration") or {}).get("command")
            what = f"type: {command}" if command else "state the parameters of its model again"
            raise InputError(f"report {path} says to identify the rig first, and proposes no experiment; {what}")
        experiment = read_proposal(f"report {path}", document.get("experiment"))
        hashes = document.get("runs")
        if not isinstance(hashes, Mapping) or not hashes:
            raise InputError(f"report {path} names no runs; write it again with clutch-hil discrepancy")
        for name, sha in hashes.items():
            if not os.path.isfile(name):
                raise InputError(
                    f"run {name} of report {path} does not exist; run this command in the folder in which the report was made"
                )
            if compute_checksum(Path(name)) != sha:
                raise InputError(f"run {name} has been changed since report {path} was written: its SHA-256 differs")
        held_out = tuple(map(str, document.get("holdout") or ()))
        model = document.get("model")
        fitted = tuple(Path(name) for name in hashes if name not in held_out)
        return cls(
            path,
            str(rig),
            str(document["verdict"]),
            fitted,
            tuple(map(Path, held_out)),
            experiment,
            Path(model) if model else None,
            document.get("forced") is True,
        )


def _read_document(path: Path) -> Mapping[str, Any]:
    document = read_json(path, "report")
    if not isinstance(document, Mapping) or "verdict" not in document:
        raise InputError(f"{path} is not a report of clutch-hil discrepancy: it has no verdict")
    return document


def read_proposal(source: str, proposed: Any) -> Experiment:
    """Return the experiment that the entry `experiment` of a result proposes; `source` names the result. Raises InputError."""
    if not isinstance(proposed, Mapping):
        raise InputError(f"{source} proposes no experiment: its verdict needs none")
    if not proposed.get("profile"):
        raise InputError(
            f"{source} proposes no experiment: {proposed.get('why', 'no experiment separates the alternatives')}"
        )
    settings = proposed.get("settings", {})
    try:
        shift = float(settings["shift"]) if "shift" in settings else 0.0
        return Experiment(str(proposed["profile"]), float(settings["temperature"]), int(settings["rate"]), shift)
    except (KeyError, TypeError, ValueError):
        raise InputError(
            f"{source}: settings of the experiment are {settings!r}; temperature and rate are needed"
        ) from None


def decide_again(
    report: Report, new: Path, out: Path, progress: Callable[[float, int], None], command: str
) -> tuple["Discrepancy", list[Path]]:
    """Repeat the search with the run `new` added to the evidence of `report`; return the result and the files written to `out`.

    `command`: the command line as typed. Raises InputError.
    """
    from clutch_hil.discrepancy.outcome import find_discrepancy

    answer = find_discrepancy(
        [*report.runs, new], report.held_out, rig=report.rig, model=report.model, force=report.forced,
        progress=lambda what, share: progress(share, 1),
    )  # fmt: skip
    return answer, answer.write(out, command)
