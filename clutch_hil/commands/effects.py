"""`clutch-hil effects`: list, describe and draw the physical effects of the rig."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import JSON, OVERWRITE
from protocols.errors import InputError

if TYPE_CHECKING:
    from plant_sim.effects.effect import Effect

_UNLIMITED = 1_000_000  # characters of a line where stdout is no terminal: nothing is cut


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(effects)


def effects(
    name: str | None = typer.Argument(None, help="an effect; all of them are listed if not given"),
    out: Path = typer.Option(Path("runs"), help="folder for the picture of NAME"),
    write: Path | None = typer.Option(None, help="Markdown page whose tables of effects and picture are updated"),
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """List the physical effects that the rig can be given, or describe and draw what one does to it."""
    import shutil
    import sys

    from clutch_hil.bench.effect_sheets.effect_text import sort_effects
    from plant_sim.effects import catalogue

    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else _UNLIMITED
    if name and write:
        raise InputError(f"effect {name} and --write {write} were both given; only one of them is allowed")
    if name:
        _describe(catalogue.find_effect(name), out, overwrite, columns, json_output)
    elif write:
        _write_page(write, sort_effects(catalogue.load_effects().values()), json_output)
    else:
        _list(sort_effects(catalogue.load_effects().values()), columns, json_output)


def _list(effects: Sequence["Effect"], columns: int, json_output: bool) -> None:
    """List all effects, in lines of `columns` characters."""
    from clutch_hil.bench.effect_sheets.effect_text import list_text, make_document

    folders = dict.fromkeys(str(effect.path.parent) for effect in effects)
    candidates = sum(effect.candidate for effect in effects)
    text = f"{list_text(effects, columns)}\n\nread:    {', '.join(folders)}\nwrote:   nothing"
    verdict = f"{len(effects)} effects, {candidates} of them candidates of `clutch-hil discrepancy`"
    report([make_document(effect) for effect in effects], text, verdict, True, json_output)


def _describe(effect: "Effect", out: Path, overwrite: bool, columns: int, json_output: bool) -> None:
    """Describe an effect in lines of `columns` characters, and draw it into the folder `out`."""
    from clutch_hil.bench.effect_sheets.demonstration import demonstrate
    from clutch_hil.bench.effect_sheets.effect_picture import draw_effects
    from clutch_hil.bench.effect_sheets.effect_text import format_sheet, make_document
    from clutch_hil.bench.recording import writable_folder
    from protocols.files.output_file import check_new_file, whole_file

    picture = out / f"effect-{effect.name}.png"
    kept = os.path.isfile(picture) and not overwrite
    with writable_folder(out):
        if not kept:
            check_new_file(picture, overwrite)
        demonstration = demonstrate(effect)
        if not kept:
            with whole_file(picture) as part:
                draw_effects(part, {effect: demonstration})
    visible = demonstration.times_resolution >= 1.0
    verdict = (
        f"at typical values the {demonstration.what} changes by up to {demonstration.largest:.3g} {demonstration.unit},"
        f" {demonstration.times_resolution:.3g} times the resolution of the measurement"
        if visible
        else "at typical values no change exceeds the resolution of the measurement"
    )
    described = make_document(effect) | {
        "shown": {
            "excitation": demonstration.excitation.title,
            "column": demonstration.column,
            "largest": demonstration.largest,
            "unit": demonstration.unit,
            "times_resolution": demonstration.times_resolution,
        },
        "picture": str(picture),
        "verdict": verdict,
    }
    wrote = f"nothing; {picture} exists already, --overwrite replaces it" if kept else str(picture)
    text = f"{format_sheet(effect, demonstration, columns)}\n\nread:    {effect.path}\nwrote:   {wrote}"
    report(described, text, verdict, visible, json_output)


def _write_page(page: Path, effects: Sequence["Effect"], json_output: bool) -> None:
    """Write the parts of a page that are made from the effects of this package, and its picture beside it, as a PNG."""
    from clutch_hil.bench.effect_sheets.demonstration import demonstrate
    from clutch_hil.bench.effect_sheets.effect_page import list_pictured_names, rewrite_page
    from clutch_hil.bench.effect_sheets.effect_picture import draw_effects
    from clutch_hil.bench.effect_sheets.effect_text import is_ours
    from plant_sim.effects import catalogue
    from protocols.files.output_file import whole_file
    from protocols.input_file import read_text

    ours = [effect for effect in effects if is_ours(effect)]
    if page.suffix.lower() != ".md":
        raise InputError(f"page {page} has the suffix {page.suffix or '-'}; a Markdown page ends with .md")
    before = read_text(page, "page")
    try:
        text = rewrite_page(before, ours)
        drawn = [catalogue.find_effect(name) for name in list_pictured_names(text)]
    except InputError as error:
        raise InputError(f"page {page}: {error}") from None
    wrote = [page]
    with whole_file(page) as part:  # the page is replaced last: it stays unchanged where the picture cannot be written
        part.write_text(text, encoding="utf-8")
        if drawn:
            wrote.append(page.with_suffix(".png"))
            with whole_file(wrote[-1]) as picture:
                draw_effects(picture, {effect: demonstrate(effect) for effect in drawn}, columns=2)
    paths = [str(path) for path in wrote]
    verdict = f"{len(ours)} effects written, {len(drawn)} of them drawn"
    document = {"read": str(page), "wrote": paths, "effects": [effect.name for effect in ours], "verdict": verdict}
    report(document, f"read:    {page}\nwrote:   {', '.join(paths)}", verdict, True, json_output)
