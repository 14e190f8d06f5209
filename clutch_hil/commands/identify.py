"""`clutch-hil identify`: compute from recordings of a clutch the calibration for its controller and its model."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from clutch_hil.command import format_json, report
from clutch_hil.commands.identify_friction import run_friction
from clutch_hil.commands.identify_lift_up import run_lift_up
from clutch_hil.commands.many_paths import ManyPaths
from clutch_hil.commands.options import JSON, OVERWRITE
from protocols.errors import InputError

if TYPE_CHECKING:
    from clutch_hil.identify.identification import Identification

FILES = ("calibration.toml", "identification.json", "report.html", "fit.png", "maps.png", "frequency_response.png")
MAPS_OF_TWO = ("maps_a.png", "maps_b.png")  # for a power shift, instead of the last two
LIFT_UP_LAWS = ("lift-up", "lift-height")
TO = typer.Option(..., "--out", help=f"folder for {', '.join(FILES)}, or friction.toml and friction.png")


_COLUMN = "COLUMN, or COLUMN:UNIT; a minus before the unit reverses the sign"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(cls=ManyPaths)(identify)


def identify(
    runs: list[Path] = typer.Argument(..., metavar="RUN...", help="recorded runs of one rig"),
    rig: str = typer.Option("", help="rig of the runs; the rig of the first run if not given"),
    hold: list[str] = typer.Option(
        [], metavar="NAME[=VALUE]", help="a parameter that is not fitted, of the clutch or of a lift-up's contact"
    ),
    bounds: list[str] = typer.Option([], metavar="NAME=LOW:HIGH", help="bounds of a parameter, in its unit"),
    tie: list[str] = typer.Option([], metavar="NAME=OTHER", help="a parameter with its declared ratio to another"),
    force_checks: bool = typer.Option(
        False, "--force-checks", help="continue although hard checks failed, with a note"
    ),
    friction: str | None = typer.Option(
        None,
        "--friction",
        metavar="LAW",
        help="only this law, of any rig: stribeck, maxwell-slip, gms, xgms, lugre; lift-up or lift-height of an oil film",
    ),
    holdout: list[Path] = typer.Option([], "--holdout", metavar="RUN...", help="runs used to check the law"),
    position: str = typer.Option("", help=f"of the law, position: {_COLUMN}; by its name if not given"),
    speed: str = typer.Option("", help=f"speed, where there is no position: {_COLUMN}"),
    force: str = typer.Option("", help=f"force or torque: {_COLUMN}"),
    load: str = typer.Option("", help=f"normal load or pressure: {_COLUMN}"),
    gap: str = typer.Option("", help=f"of a lift-up, gap or lift: {_COLUMN}"),
    time: str = typer.Option("", help="time: COLUMN or COLUMN:UNIT; time_s if not given"),
    map_name: str | None = typer.Option(None, "--map", help="map for foreign files, as of clutch-hil import"),
    low_pass: float = typer.Option(0.0, help="low-pass of all columns without delay, in Hz; 0 for none"),
    rate: float = typer.Option(0.0, help="rate to resample to, in Hz; 0 leaves it"),
    elements: int | None = typer.Option(None, help="elements of the law; held-out stretches decide if not given"),
    terms: str | None = typer.Option(
        None,
        metavar="A,B,...",
        help="terms of law and rig: mass,offset,viscous; held-out stretches decide if not given",
    ),
    starts: int | None = typer.Option(None, help="searches from different starts; 8 if not given"),
    seed: int | None = typer.Option(None, min=0, help="seed of the starts; 0 if not given"),
    out: Path = TO,
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Identify a clutch, or both of a power shift, from recorded runs. With --friction: the friction law of any rig."""
    if friction in LIFT_UP_LAWS:
        wrong = {
            "holdout": holdout, "speed": speed, "force": force, "map": map_name, "rate": rate, "elements": elements,
            "terms": terms, "bounds": bounds, "tie": tie, "starts": starts, "seed": seed,
        }  # fmt: skip
        if odd := [name for name, given in wrong.items() if _is_given(given)]:
            raise InputError(f"--{odd[0]} is not an option of --friction {friction}; leave it out")
        known = {name: _parse_number("hold", name, text) for name, text in _parse_pairs("hold", hold)}
        run_lift_up(
            runs, friction, {"position": position, "load": load, "time": time}, gap, known, low_pass, rig, out, overwrite,
            json_output,
        )  # fmt: skip
        return
    if gap:
        raise InputError(f"--gap is only for --friction {' or '.join(LIFT_UP_LAWS)}; leave it out")
    if friction is not None:
        if odd := [name for name, given in (("hold", hold), ("bounds", bounds), ("tie", tie)) if given]:
            raise InputError(
                f"--{odd[0]} is for a clutch, --friction for a friction law alone; only one of them is allowed"
            )
        columns = {"position": position, "speed": speed, "force": force, "load": load, "time": time}
        run_friction(
            runs, friction, holdout, columns, map_name, low_pass, rate, elements, terms,
            8 if starts is None else starts, seed or 0, rig, out, overwrite, json_output,
        )  # fmt: skip
        return
    law_only = {
        "holdout": holdout, "position": position, "speed": speed, "force": force, "load": load, "time": time, "map": map_name,
        "low-pass": low_pass, "rate": rate, "elements": elements, "terms": terms,
        "starts": starts, "seed": seed,
    }  # fmt: skip
    if odd := [name for name, given in law_only.items() if _is_given(given)]:
        raise InputError(f"--{odd[0]} is only for --friction; a clutch is identified from columns with fixed names")
    _run_clutch(runs, rig, hold, bounds, tie, force_checks, out, overwrite, json_output)


def _run_clutch(
    runs: list[Path], rig: str, hold: list[str], bounds: list[str], tie: list[str], force: bool, out: Path, overwrite: bool,
    json_output: bool,
) -> None:  # fmt: skip
    """Identify a clutch and write its files."""
    from clutch_hil.bench.progress import progress_bar
    from clutch_hil.bench.recording import writable_folder
    from clutch_hil.identify import identification, thesis_quantities
    from clutch_hil.identify.report.picture import format_table
    from clutch_hil.identify.two_clutches.power_shift import ShiftIdentification
    from protocols.files.output_file import check_new_files, whole_files

    held = {
        name: _parse_number("hold", name, text) if text else None for name, text in _parse_pairs("hold", hold, False)
    }
    limits = {name: _parse_range(name, text) for name, text in _parse_pairs("bounds", bounds)}
    ties = dict(_parse_pairs("tie", tie))
    check_new_files(out, (*FILES, *MAPS_OF_TWO), overwrite, runs)
    with writable_folder(out), progress_bar("identify", json_output) as progress:
        result = identification.identify_clutch(
            runs, rig=rig, hold=held, bounds=limits, ties=ties, force=force,
            progress=lambda what, share: progress(round(100 * share), 100),
        )  # fmt: skip
        calibration = result.calibration
        document = {
            **calibration.make_document(),
            "misfit": dict(result.misfit),
            "seconds": result.seconds,
            "verdict": str(result),
        }
        document["quantities"] = [quantity.make_document() for quantity in result.quantities]
        document["frequency_response"] = result.response.make_document() if result.response else None
        hand_overs = result.hand_overs if isinstance(result, ShiftIdentification) else ()
        if isinstance(result, ShiftIdentification):
            document["hand_overs"] = [one.make_document() for one in hand_overs]
        with whole_files(out) as parts:
            _write_files(result, document, parts)
            written = [name for name in (*FILES[:4], *MAPS_OF_TWO, *FILES[4:]) if (parts / name).exists()]
    lines = [
        *format_table(result),
        "",
        *thesis_quantities.format_table(result.quantities),
        "",
        *([f"pressure loop: {result.response}"] if result.response else []),
        *(f"hand-over: {one}" for one in hand_overs),
        *(f"not identified: {name}: {why}" for name, why in calibration.held.items()),
        *(f"warning: {text}" for text in calibration.warnings),
        *calibration.notes,
        f"read:    {', '.join(map(str, runs))}",
        f"wrote:   {', '.join(str(out / name) for name in written)}",
    ]
    report(document, "\n".join(lines), str(result), True, json_output)


def _write_files(result: "Identification", document: Mapping[str, Any], folder: Path) -> None:
    """Write calibration, report, pictures and the result `document` to a folder."""
    from clutch_hil.identify.report.picture import draw_identification
    from clutch_hil.identify.report.quantity_pictures import draw_maps, draw_response
    from clutch_hil.identify.report.report_page import compose_report
    from clutch_hil.identify.two_clutches.power_shift import ShiftIdentification

    result.calibration.write(folder / FILES[0])
    (folder / FILES[1]).write_text(format_json(document, indent=1), encoding="utf-8")
    draw_identification(result, folder / FILES[3])
    if isinstance(result, ShiftIdentification):
        for file, one in zip(MAPS_OF_TWO, result.parts.values(), strict=True):
            draw_maps(one.propagation, one.highest_pressure, folder / file)
    else:
        draw_maps(result.propagation, result.highest_pressure, folder / FILES[4])
    if result.response:
        draw_response(result.response, folder / FILES[5])
    beside = [name for name in (*FILES[:4], *MAPS_OF_TWO, *FILES[4:]) if (folder / name).exists()]
    page = compose_report(result, beside, shlex.join(["clutch-hil", *sys.argv[1:]]))
    (folder / FILES[2]).write_text(page, encoding="utf-8")


def _is_given(value: Any) -> bool:
    """Return whether an option was given, as far as its value shows: a float that was not given is 0.0."""
    return value is not None and (bool(value) or type(value) is int)


def _parse_pairs(option: str, texts: Sequence[str], needed: bool = True) -> list[tuple[str, str]]:
    """Return (name, value) of each NAME=VALUE. Raises InputError."""
    pairs = []
    for text in texts:
        name, mark, value = text.partition("=")
        if not name or (needed and not value) or (mark and not value):
            raise InputError(f"--{option} is {text!r}; allowed is NAME{'=VALUE' if needed else ' or NAME=VALUE'}")
        pairs.append((name, value))
    return pairs


def _parse_number(option: str, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < float("inf"):
        raise InputError(f"--{option} {name} has the value {text!r}; allowed is a number")
    return value


def _parse_range(name: str, text: str) -> tuple[float, float]:
    low, mark, high = text.partition(":")
    if not mark:
        raise InputError(f"--bounds {name} is {text!r}; allowed is LOW:HIGH")
    return _parse_number("bounds", name, low), _parse_number("bounds", name, high)
