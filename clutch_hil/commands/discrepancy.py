"""`clutch-hil discrepancy`: find where runs and model disagree, what the model lacks, and the model that includes it."""

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from clutch_hil.command import report
from clutch_hil.commands.many_paths import ManyPaths
from clutch_hil.commands.options import OVERWRITE
from protocols.errors import InputError

if TYPE_CHECKING:
    from clutch_hil.discrepancy.result import Result


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(cls=ManyPaths)(discrepancy)


def discrepancy(
    runs: list[Path] = typer.Argument(..., metavar="RUN...", help="recorded runs: .parquet, .mf4, .csv, .mat"),
    holdout: list[Path] = typer.Option(
        [], "--holdout", metavar="RUN...", help="runs that are not fitted but used to check the result"
    ),
    rig: str = typer.Option(
        "wet_clutch",
        help="wet_clutch, power_shift.a or .b, position_axis, tribometer, pneumatic_cylinder, one of yours, or PATH.py:CLASS",
    ),
    model: Path | None = typer.Option(None, help="model file to begin from, as an earlier search wrote it"),
    calibration: str | None = typer.Option(
        None,
        metavar="FILE",
        help="calibration.toml of `clutch-hil identify`: the model to begin from, and its uncertainties",
    ),
    refit_within: float | None = typer.Option(
        None,
        help="how far the baseline may be re-fitted, in multiples of its stated uncertainties; the rig's default if not given",
    ),
    effects: str = typer.Option(
        "", metavar="A,B,...", help="candidate effects, separated by commas; all of the rig if not given"
    ),
    force: bool = typer.Option(
        False, "--force", help="continue although hard checks failed, with a note in the report"
    ),
    out: Path = typer.Option(
        ..., help="folder for report.html, report.json, model.toml, atlas.png, gap.png, evidence.rrd"
    ),
    overwrite: bool = OVERWRITE,
    json_output: bool = typer.Option(False, "--json", help="print report.json"),
) -> None:
    """Find where runs and simulation disagree, name the missing effect, and show how far it closes the gap."""
    from clutch_hil.bench.progress import progress_bar
    from clutch_hil.bench.recording import writable_folder
    from clutch_hil.discrepancy.models.named import check_refit
    from clutch_hil.discrepancy.outcome import FILES, find_discrepancy
    from protocols.files.output_file import check_new_files

    if refit_within is not None:
        check_refit(refit_within, "--refit-within")
    model, refit_within = _begin(model, calibration, refit_within)
    names = [name.strip() for name in effects.split(",") if name.strip()]
    if effects and not names:
        raise InputError(f"--effects is {effects!r}; allowed are names separated by commas, or leave it out")
    check_new_files(out, FILES, overwrite, [*runs, *holdout, *([model] if model else [])])
    with writable_folder(out), progress_bar("discrepancy", json_output) as progress:
        outcome = find_discrepancy(
            runs, holdout, rig=rig, model=model, calibration=refit_within, effects=names or None,
            force=force, progress=lambda what, share: progress(round(100 * share), 100),
        )  # fmt: skip
        files = outcome.write(out, shlex.join(["clutch-hil", *sys.argv[1:]]))
    read, wrote = (", ".join(map(str, paths)) for paths in ((*runs, *holdout), files))
    text = "\n".join([_format_result(outcome.result), f"read:    {read}", f"wrote:   {wrote}"])
    report(outcome.result.as_json(), text, str(outcome), True, json_output)


def _begin(model: Path | None, calibration: str | None, within: float | None) -> tuple[Path | None, float | None]:
    """Return the model file to start from, and how far the baseline may be re-fitted. Raises InputError."""
    if calibration is None:
        return model, within
    try:
        number = float(calibration)
    except ValueError:
        number = None
    if number is not None:
        raise InputError(f"--calibration needs a file; the limit of the re-fit is set by --refit-within {calibration}")
    if model:
        raise InputError("--calibration and --model were both given; only one of them is allowed")
    return Path(calibration), 3.0 if within is None else within  # 95 % intervals are +-1.96 of their uncertainties


def _format_result(result: "Result") -> str:
    """Format where runs and model disagree, or what an effect acts on, the fitted parameters, and the notes."""
    from clutch_hil.discrepancy.result import NAMED, ONE_OF
    from clutch_hil.fitting.run_checks import list_findings
    from protocols.files.units import space_unit

    rows = [
        f"  {c.block:<11} {c.output:<22} {c.regime:<20} {c.size:8.3g} {c.unit:<6}"
        f" {c.times_floor:5.2f} floors, p {c.p_value:.2g}"
        for c in result.where
    ]
    acts = result.verdict in (NAMED, ONE_OF)
    where = (
        ["where it has an effect:" if acts else "where model and measurement disagree:", *rows]
        if rows
        else ["model and measurement disagree nowhere"]
    )
    fitted = [
        f"  {e.name} = {e.value:.5g}{space_unit(e.unit)}  (95 %: {e.ci95[0]:.5g}..{e.ci95[1]:.5g})"
        for e in result.parameters
    ]
    findings = list_findings(result.checks)
    checks = ["checks:", *(f"  {finding}" for finding in findings)] if findings else []
    others = [note for note in result.notes if note not in findings]
    notes = ["notes:", *(f"  {note}" for note in others)] if others else []
    return "\n".join(
        [*checks, *where, *(["fitted:", *fitted] if fitted else []), *notes, f"search took {result.seconds:.1f} s"]
    )
