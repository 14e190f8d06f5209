"""Commands about effects."""

from pathlib import Path

import typer

from clutch_hil.command import report

_WHOLE = 1_000_000  # characters a line may have where there is no terminal: nothing is cut


def register(app: typer.Typer) -> None:
    """Add the commands of this file."""
    app.command()(effects)


def effects(
    name: str | None = typer.Argument(None, help="an effect; all of them are listed if not given"),
    out: Path = typer.Option(Path("runs"), help="folder for the picture of NAME"),
    json_output: bool = typer.Option(False, "--json", help="print the result as JSON"),
) -> None:
    """List the physical effects that the rig can be given, or tell and draw what one does to it."""
    import shutil
    import sys

    from clutch_hil.bench.demonstration import demonstrate
    from clutch_hil.bench.effect_picture import draw_effects
    from clutch_hil.bench.effect_text import document, in_order, list_text, sheet_text
    from clutch_hil.bench.recording import writable
    from plant_sim.effects import catalogue

    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else _WHOLE
    if name is None:
        found = in_order(catalogue.effects().values())
        folders = dict.fromkeys(str(effect.path.parent) for effect in found)
        candidates = sum(effect.candidate for effect in found)
        text = f"{list_text(found, columns)}\n\nread:    {', '.join(folders)}\nwrote:   nothing"
        verdict = f"{len(found)} effects, {candidates} of them candidates of `clutch-hil discrepancy`"
        report([document(effect) for effect in found], text, verdict, True, json_output)
        return
    effect = catalogue.effect(name)
    picture = writable(out) / f"effect-{effect.name}.png"
    shown = demonstrate(effect)
    draw_effects(picture, [(f"{effect.name}: {effect.title}", shown)])
    seen = shown.times_resolution >= 1.0
    verdict = (
        f"at typical values the {shown.what} changes by up to {shown.largest:.3g} {shown.unit},"
        f" {shown.times_resolution:.3g} times what the measurement resolves"
        if seen
        else "at typical values nothing changes that the measurement resolves"
    )
    described = document(effect) | {
        "shown": {
            "excitation": shown.excitation.title,
            "column": shown.column,
            "largest": shown.largest,
            "unit": shown.unit,
            "times_resolution": shown.times_resolution,
        },
        "picture": str(picture),
        "verdict": verdict,
    }
    text = f"{sheet_text(effect, shown, columns)}\n\nread:    {effect.path}\nwrote:   {picture}"
    report(described, text, verdict, seen, json_output)
