"""`clutch-hil identify`: from recordings of a clutch to the calibration that its controller and its model run on."""

import json
from collections.abc import Sequence
from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import JSON, OVERWRITE
from protocols.errors import InputError

FILES = ("calibration.toml", "identification.json", "fit.png")
TO = typer.Option(..., "--out", help=f"folder for {', '.join(FILES)}")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(identify)


def identify(
    runs: list[Path] = typer.Argument(..., metavar="RUN...", help="recorded runs of one clutch"),
    rig: str = typer.Option("wet_clutch", help="rig of the runs"),
    hold: list[str] = typer.Option(
        [], metavar="NAME[=VALUE]", help="a parameter that is not fitted; repeat the option"
    ),
    bounds: list[str] = typer.Option([], metavar="NAME=LOW:HIGH", help="bounds of a parameter, in its unit"),
    tie: list[str] = typer.Option(
        [], metavar="NAME=OTHER", help="a parameter that keeps its declared ratio to another"
    ),
    force: bool = typer.Option(False, "--force", help="go on in spite of hard checks, with a note"),
    out: Path = TO,
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Identify a clutch's friction, hydraulics, oil and drive from recorded runs."""
    from clutch_hil.bench.progress import progress_bar
    from clutch_hil.bench.recording import writable
    from clutch_hil.identify import identification
    from clutch_hil.identify.picture import draw_identification, table_lines
    from protocols.files.output_file import new_files, whole_file

    held = {name: _number("hold", name, text) if text else None for name, text in _pairs("hold", hold, False)}
    limits = {name: _range(name, text) for name, text in _pairs("bounds", bounds)}
    ties = dict(_pairs("tie", tie))
    new_files(writable(out), FILES, overwrite, runs)
    with progress_bar("identify", json_output) as progress:
        found = identification.identify(
            runs, rig=rig, hold=held, bounds=limits, ties=ties, force=force,
            progress=lambda what, share: progress(round(100 * share), 100),
        )  # fmt: skip
    calibration = found.calibration
    document = {**calibration.document(), "misfit": dict(found.misfit), "seconds": found.seconds, "verdict": str(found)}
    calibration.write(out / FILES[0])
    with whole_file(out / FILES[1]) as part:
        part.write_text(json.dumps(document, indent=1), encoding="utf-8")
    draw_identification(found, out / FILES[2])
    lines = [
        *table_lines(found),
        *(f"held: {name}: {why}" for name, why in calibration.held.items()),
        *(f"warning: {text}" for text in calibration.warnings),
        *calibration.notes,
        f"read:    {', '.join(map(str, runs))}",
        f"wrote:   {', '.join(str(out / name) for name in FILES)}",
    ]
    report(document, "\n".join(lines), str(found), True, json_output)


def _pairs(option: str, texts: Sequence[str], needed: bool = True) -> list[tuple[str, str]]:
    """(name, value) of each NAME=VALUE. Raises InputError."""
    pairs = []
    for text in texts:
        name, mark, value = text.partition("=")
        if not name or (needed and not value) or (mark and not value):
            raise InputError(f"--{option} is {text!r}; allowed is NAME{'=VALUE' if needed else ' or NAME=VALUE'}")
        pairs.append((name, value))
    return pairs


def _number(option: str, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < float("inf"):
        raise InputError(f"--{option} {name} has the value {text!r}; allowed is a number")
    return value


def _range(name: str, text: str) -> tuple[float, float]:
    low, mark, high = text.partition(":")
    if not mark:
        raise InputError(f"--bounds {name} is {text!r}; allowed is LOW:HIGH")
    return _number("bounds", name, low), _number("bounds", name, high)
