"""`clutch-hil identify --friction`: a friction law of any rig from recordings of position or speed, force and load."""

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from clutch_hil.command import report
from protocols.errors import InputError, suggest_closest

if TYPE_CHECKING:
    from clutch_hil.identify.friction.result import IdentifiedFriction

FILES = ("friction.toml", "friction.png")


def run_friction(
    runs: list[Path],
    friction: str,
    holdout: list[Path],
    columns: Mapping[str, str],
    map_name: str | None,
    low_pass: float,
    rate: float,
    elements: int | None,
    terms: str | None,
    starts: int,
    seed: int,
    rig: str,
    out: Path,
    overwrite: bool,
    json_output: bool,
) -> None:
    """Identify a friction law and write its files. columns: by quantity, "" to find it by name; others as in `identify`."""
    from clutch_hil.bench.progress import ActivityLine
    from clutch_hil.bench.recording import writable_folder
    from clutch_hil.identify.friction import butterflies
    from clutch_hil.identify.friction.identification import identify_friction as identify
    from clutch_hil.identify.friction.law import LAWS
    from clutch_hil.identify.friction.picture import draw_friction
    from clutch_hil.identify.friction.slide_record import Columns, read_records
    from clutch_hil.recordings.import_map import load_map
    from clutch_hil.recordings.rasters import Sampling
    from protocols.files.output_file import check_new_files, whole_files

    if friction not in LAWS:
        known = suggest_closest(friction, [*LAWS, *butterflies.LAWS])
        raise InputError(f"friction law {friction!r} is unknown; {known}")
    check_new_files(out, FILES, overwrite, [*runs, *holdout, *([Path(map_name)] if map_name else [])])
    with writable_folder(out), ActivityLine("reading", json_output) as line:
        law = identify(
            runs, friction, holdout=holdout, **columns,
            map_name=map_name, low_pass=low_pass, rate=rate, elements=elements, starts=starts, seed=seed, rig=rig,
            terms=None if terms is None else [name.strip() for name in terms.split(",") if name.strip()],
            progress=lambda what, share: line.update(f"{100.0 * share:.0f} %: {what}"),
        )  # fmt: skip
        line.update("drawing")
        mapped = load_map(map_name) if map_name else None
        records = read_records(runs, Columns(**columns), mapped, Sampling(low_pass, rate, low_pass_name="low-pass"))
        figure = draw_friction(law, records)
        with whole_files(out) as parts:
            figure.savefig(parts / FILES[1], dpi=110, format="png")
            law.write(parts / FILES[0])

    wrote = [out / name for name in FILES]
    read, written = (", ".join(map(str, paths)) for paths in ((*runs, *holdout), wrote))
    text = "\n".join([_format_law(law), f"read:    {read}", f"wrote:   {written}"])
    document = {**law.as_json(), "read": [*map(str, (*runs, *holdout))], "wrote": [*map(str, wrote)]}
    report(document, text, law.verdict, True, json_output)


def _format_law(law: "IdentifiedFriction") -> str:
    """Format the steps of the selection, the parameters with their intervals, and the warnings."""
    from clutch_hil.bench.progress import format_table

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
    return "\n".join([format_table(steps), "", format_table(values), "", *warnings])
