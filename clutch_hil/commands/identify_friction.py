"""`clutch-hil identify --friction`: a friction law of any rig from recordings of position or speed, force and load."""

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from clutch_hil.command import report
from clutch_hil.commands.many_paths import ManyPaths
from clutch_hil.commands.options import JSON, OVERWRITE

if TYPE_CHECKING:
    from clutch_hil.identify.friction.result import IdentifiedFriction

FILES = ("friction.toml", "friction.png")
_OUT_HELP = f"folder for {' and '.join(FILES)}"
_COLUMN = "COLUMN, or COLUMN:UNIT; a unit with a minus turns the sign"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="identify", cls=ManyPaths)(identify_friction)


def identify_friction(
    runs: list[Path] = typer.Argument(
        ..., metavar="RUN...", help="recordings of one rig: .parquet, .mf4, .csv, .mat, or by --map"
    ),
    friction: str = typer.Option(..., "--friction", metavar="LAW", help="stribeck, maxwell-slip, gms, xgms or lugre"),
    holdout: list[Path] = typer.Option(
        [], "--holdout", metavar="RUN...", help="runs that are not fitted, on which the law is judged"
    ),
    position: str = typer.Option("", help=f"position: {_COLUMN}; recognised by its name if not given"),
    speed: str = typer.Option("", help=f"speed, where there is no position: {_COLUMN}"),
    force: str = typer.Option("", help=f"force or torque: {_COLUMN}"),
    load: str = typer.Option("", help=f"normal load or pressure: {_COLUMN}"),
    time: str = typer.Option("", help="time: COLUMN or COLUMN:UNIT; time_s if not given"),
    map_name: str | None = typer.Option(None, "--map", help="map for foreign files, as of clutch-hil import"),
    low_pass: float = typer.Option(0.0, help="low-pass of all columns without delay, in Hz; 0 for none"),
    rate: float = typer.Option(0.0, help="rate to resample to, in Hz; 0 leaves it"),
    elements: int | None = typer.Option(None, help="number of elements; held-out stretches decide if not given"),
    terms: str | None = typer.Option(
        None,
        metavar="A,B,...",
        help="terms of law and rig, such as mass,offset,viscous; held-out stretches decide if not given",
    ),
    starts: int = typer.Option(8, help="searches from different starts"),
    seed: int = typer.Option(0, min=0, help="seed of the starts"),
    rig: str = typer.Option("", help="name of the rig, for the file"),
    out: Path = typer.Option(..., help=_OUT_HELP),
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Identify a friction law from recordings of any rig: its terms by held-out stretches, its values with 95 % intervals."""
    from clutch_hil.bench.progress import ActivityLine
    from clutch_hil.bench.recording import writable
    from clutch_hil.identify.friction.identification import identify_friction as identify
    from clutch_hil.identify.friction.law import law_named
    from clutch_hil.identify.friction.picture import draw_friction
    from clutch_hil.identify.friction.slide_record import Columns, read_records
    from clutch_hil.recordings.import_map import load_map
    from clutch_hil.recordings.rasters import Sampling
    from protocols.files.output_file import new_files, whole_file

    law_named(friction)
    made = not out.exists()
    new_files(writable(out), FILES, overwrite, [*runs, *holdout, *([Path(map_name)] if map_name else [])])
    try:
        with ActivityLine("reading", json_output) as line:
            law = identify(
                runs, friction, holdout=holdout, position=position, speed=speed, force=force, load=load, time=time,
                map_name=map_name, low_pass=low_pass, rate=rate, elements=elements, starts=starts, seed=seed, rig=rig,
                terms=None if terms is None else [name.strip() for name in terms.split(",") if name.strip()],
                progress=lambda what, share: line.update(f"{100.0 * share:.0f} %: {what}"),
            )  # fmt: skip
            line.update("drawing")
            columns = Columns(position=position, force=force, load=load, speed=speed, time=time)
            records = read_records(runs, columns, load_map(map_name) if map_name else None, Sampling(low_pass, rate))
            figure = draw_friction(law, records)
            with whole_file(out / FILES[1]) as picture:
                figure.savefig(picture, dpi=110, format="png")
            law.write(out / FILES[0])
    except BaseException:
        if made and not any(out.iterdir()):
            out.rmdir()
        raise
    wrote = [out / name for name in FILES]
    read, written = (", ".join(map(str, paths)) for paths in ((*runs, *holdout), wrote))
    text = "\n".join([_format_law(law), f"read:    {read}", f"wrote:   {written}"])
    document = {**law.as_json(), "read": [*map(str, (*runs, *holdout))], "wrote": [*map(str, wrote)]}
    report(document, text, law.verdict, True, json_output)


def _format_law(law: "IdentifiedFriction") -> str:
    """Format the steps of the selection, the parameters with their intervals, and the warnings."""
    from clutch_hil.bench.progress import table_text

    unit = law.units[1]
    steps = [["", "tried", "parameters", f"fitted [{unit}]", f"held out [{unit}]"]]
    steps += [
        ["*" if one.chosen else "", one.structure, str(one.parameters), f"{one.fitted:.4g}", f"{one.held_out:.4g}"]
        for one in law.steps
    ]
    values = [["parameter", "value", "95 % interval", "unit"]]
    for one in law.parameters:
        interval = f"{one.low:.5g} to {one.high:.5g}" if isfinite(one.low) else "not determined"
        values.append([one.name, f"{one.value:.5g}", interval, one.unit])
    warnings = [f"warning: {line}" for line in law.warnings]
    return "\n".join([table_text(steps), "", table_text(values), "", *warnings])
