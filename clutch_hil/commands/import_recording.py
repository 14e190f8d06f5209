"""`clutch-hil import`: converts a foreign recording into a run file."""

from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import JSON


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="import")(import_run)


def import_run(
    recording: Path = typer.Argument(..., help="MATLAB .mat, MF4, Parquet or text"),
    map_name: str = typer.Option(
        ..., "--map", help="TOML file that says which column is which, or emps, microtribometer, pneumatic_seal"
    ),
    from_s: float | None = typer.Option(None, "--from", help="first time to keep, in s; the map's if not given"),
    to_s: float | None = typer.Option(None, "--to", help="last time to keep, in s; the map's if not given"),
    out: Path = typer.Option(..., help="run file to write: .parquet, .mf4 or .csv"),
    json_output: bool = JSON,
) -> None:
    """Map names and units of a foreign recording onto ours and write it as a run; what was done to it is told, and kept in the
    file's metadata."""
    from clutch_hil.recordings.checks.every_check import check_columns_alone
    from clutch_hil.recordings.import_map import load_map
    from protocols.files.runs import write_run

    run = load_map(map_name).cut(from_s, to_s).read(recording)
    checks = check_columns_alone(str(out), run.columns, run.units)
    run.metadata["import"]["checks"] = [finding.as_json() for finding in checks]
    write_run(run, out)
    time = run["time_s"]
    done = run.metadata["import"]["done"]
    document = {
        "read": str(recording),
        "wrote": str(out),
        "rows": len(time),
        "columns": list(run.columns),
        "done": done,
        "checks": [finding.as_json() for finding in checks],
    }
    text = "\n".join([f"read {recording}", *done, *map(str, checks), f"wrote {out}: {', '.join(run.columns)}"])
    rate = (len(time) - 1) / (time[-1] - time[0])
    report(document, text, f"{len(time)} rows at {rate:.6g} Hz", True, json_output)
