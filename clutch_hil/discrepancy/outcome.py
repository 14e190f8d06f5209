"""Outcome: find what a model lacks to explain recorded runs, for Python and for the command; write the files on request."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from clutch_hil.bench.arguments import (
    take_flag,
    take_function,
    take_list,
    take_name,
    take_number,
    take_path,
    take_runs,
)
from clutch_hil.bench.recording import make_writable
from clutch_hil.bench.sealed import compute_checksum
from clutch_hil.discrepancy.model_file import read_model, write_model
from clutch_hil.discrepancy.models.missing_sensors import choose_model
from clutch_hil.discrepancy.models.model_check import check_simulation
from clutch_hil.discrepancy.models.named import (
    declare_parameters,
    find_model,
    find_models,
    list_required_columns,
    select_evidence,
    set_calibration,
)
from clutch_hil.discrepancy.part_of_rig import name_as_rig, note_part, take_part
from clutch_hil.discrepancy.regimes import Regimes
from clutch_hil.discrepancy.report import REPORT_FILES, write_report
from clutch_hil.discrepancy.result import IDENTIFY_FIRST, NAMED, NONE_OF_THESE, ONE_OF, Result
from clutch_hil.discrepancy.search import investigate
from clutch_hil.discrepancy.selection import Progress
from clutch_hil.fitting.model import Columns, Model
from clutch_hil.fitting.run_checks import check_evidence, list_findings
from clutch_hil.recordings.checks.finding import Finding, refuse_hard
from clutch_hil.recordings.checks.timing import cut_at_fault
from protocols.errors import InputError, join_names
from protocols.files.output_file import whole_files
from protocols.files.run import Run
from protocols.files.runs import read_columns

_MODEL_FILE = "model.toml"
FILES = (*REPORT_FILES, _MODEL_FILE)  # the files that `Discrepancy.write` writes


@dataclass(frozen=True)
class Discrepancy:
    """The outcome of a search. `str` gives the verdict in one line.

    `result`: verdict, effects, confidence, locations of the disagreement, parameters with intervals, gaps, and `experiment`,
    the proposed experiment or None. `known`: the searched model of this `rig`, as changed by the file `model`.
    """

    result: Result
    known: Model
    rig: str
    model: Path | None

    def __str__(self) -> str:
        """Return the verdict in one line."""
        hard = sum(finding.hard for finding in self.result.checks)
        return (
            f"{self._describe_verdict()}; {hard} hard checks were overruled by --force"
            if self.result.forced
            else self._describe_verdict()
        )

    def _describe_verdict(self) -> str:
        result = self.result
        sure = f"confidence {result.confidence:.2f}"
        if result.equal_calibration:
            sure += "; another calibration explains as much: see the notes"
        if result.verdict == NAMED:
            named = f"named: {' + '.join(result.effects)} ({sure})"
            if (column := result.main_output) is None:
                return named
            gap = result.gap[column]
            return (
                f"{named}; {column} on runs not fitted: {gap.before:.3g} before, {gap.after:.3g} after,"
                f" floor {gap.floor:.3g} {result.units[column]}"
            )
        if result.verdict == ONE_OF:
            return f"one of {' | '.join(join_names(group) for group in result.alternatives)} ({sure})"
        if result.verdict == IDENTIFY_FIRST and result.recalibration:
            return f"identify first: {result.recalibration}; {result.recalibration.advice} ({sure})"
        if result.verdict == NONE_OF_THESE:
            what = (result.surrogate or {}).get("sentence", "something is missing that no candidate explains")
            return f"none of these: {what} ({sure})"
        return f"nothing missing ({sure})"

    def write(self, folder: str | Path, command: str = "") -> list[Path]:
        """Write report.html, report.json, model.toml, atlas.png, gap.png and evidence.rrd to `folder`; return their paths.

        All files appear at once. `command` is shown in the report as the command that was typed. Raises InputError, which names
        a file that cannot be written.
        """
        folder = make_writable(Path(folder))
        start = {name: p.value for name, p in self.known.parameters.items()}
        regimes = Regimes(self.known, [trace.columns for trace in self.result.traces], start)
        shipped = declare_parameters(find_model(self.rig))
        begun_from = read_model(self.model, shipped) if self.model else None
        with whole_files(folder) as parts:
            write_model(name_as_rig(self.result, self.known), shipped, parts / _MODEL_FILE, begun_from)
            report = write_report(self.result, parts, regimes, command)
        return [*(folder / part.name for part in report), folder / _MODEL_FILE]


def find_discrepancy(
    runs: Sequence[Run | str | Path],
    held_out: Sequence[Run | str | Path] = (),
    *,
    rig: str = "wet_clutch",
    model: str | Path | None = None,
    calibration: float | None = None,
    effects: Sequence[str] | None = None,
    force: bool = False,
    progress: Progress = lambda what, share: None,
) -> Discrepancy:
    """Find where runs and simulation disagree, and which effects the model lacks, as `clutch-hil discrepancy` does.

    `runs` are fitted, and `held_out` runs evaluate the fit; without any, whole runs are left out in turn. A run is a Run in
    memory or the path of its file. `rig` is the name of a model or PATH.py:CLASS. `model` is a model file to start from.
    `calibration` is how far the baseline may be re-fitted, in stated uncertainties. `effects` are the candidates; None takes
    all of the rig.

    All runs are checked first (`clutch_hil/recordings/checks`). Hard findings raise InputError; with `force` they are listed in
    the result like the others. Of a run that ends in a fault of the controller, only the rows before the fault are used.

    `progress(what, share)` is called from time to time, with share from 0 to 1.

    The search takes seconds to minutes; no file is written before `Discrepancy.write`. Raises InputError.
    """
    runs, held_out = take_runs("runs", runs), take_runs("held_out", held_out)
    rig, force, progress = take_name("rig", rig), take_flag("force", force), take_function("progress", progress)
    if effects is not None:
        effects = [take_name("effects", name) for name in take_list("effects", effects)]
    if not runs:
        raise InputError("the discrepancy search has no runs; one or more are needed")
    if effects == []:
        raise InputError("the discrepancy search has no candidates; give names of effects, or None for all")
    changed = take_path("model", model) if model is not None else None
    models = find_models(rig, changed)
    if calibration is not None:
        share = take_number("calibration", calibration)
        models = [set_calibration(one, share) for one in models]
    _check_paths([*runs, *held_out])
    named = {f"number {k}" if isinstance(run, Run) else str(run): run for k, run in enumerate([*runs, *held_out], 1)}
    read = {name: run if isinstance(run, Run) else read_columns(Path(run)) for name, run in named.items()}
    read = {name: take_part(models[0], name, run) for name, run in read.items()}
    known, missing = choose_model(models, read)
    evidence = {name: select_evidence(Path(name), run, known) for name, run in read.items()}
    check_simulation(known, rig, next(iter(evidence.values())))
    hashes = {name: _compute_hash(run, evidence[name], known) for name, run in named.items()}
    fitted = {name: evidence[name] for name in [*named][: len(runs)]}
    held = {name: columns for name, columns in evidence.items() if name not in fitted}
    findings: list[Finding] = []
    fitted, held = ({n: _cut_at_fault(n, run, findings) for n, run in one.items()} for one in (fitted, held))
    findings += check_evidence(known, {**fitted, **held})
    if not force:
        refuse_hard(findings)
    result = investigate(known, fitted, held, effects, progress)
    forced = any(finding.hard for finding in findings)
    overruled = ["hard checks were overruled by --force: the results below cannot be relied on"] if forced else []
    result = replace(
        result, hashes=hashes, holdout=list(held), model=str(changed) if changed else None, checks=findings, forced=forced,
        notes=[*overruled, *note_part(known), *missing, *list_findings(findings), *result.notes],
    )  # fmt: skip
    return Discrepancy(result, known, rig, changed)


def _cut_at_fault(name: str, run: Columns, findings: list[Finding]) -> Columns:
    """Return the rows of a run before its first fault; add the cut to `findings`. Raises InputError where no rows are left."""
    kept, cut = cut_at_fault(run)
    if cut:
        findings.append(replace(cut, run=name))
        if len(kept["time_s"]) < 2:
            raise InputError(f"run {name} is in a fault from its first rows on ({cut.column}); it cannot be used")
    return kept


def _check_paths(runs: Sequence[Run | str | Path]) -> None:
    """Raise InputError for a file that is given twice."""
    seen: set[Path] = set()
    for path in (Path(run) for run in runs if not isinstance(run, Run)):
        if (resolved := path.resolve()) in seen:
            raise InputError(f"run {path} was given twice; each run can be fitted or held out only once")
        seen.add(resolved)


def _compute_hash(run: Run | str | Path, columns: Columns, model: Model) -> str:
    """Return the SHA-256 of a file, or of the compared columns of a run in memory."""
    if not isinstance(run, Run):
        return compute_checksum(Path(run))
    content = b"".join(name.encode() + columns[name].tobytes() for name in list_required_columns(model))
    return hashlib.sha256(content).hexdigest()
