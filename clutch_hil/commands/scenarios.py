"""`clutch-hil scenarios`: the scenarios that come with the bench."""

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import JSON


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(scenarios)


def scenarios(json_output: bool = JSON) -> None:
    """List the scenarios that come with the bench, with their limits."""
    from clutch_hil.bench.scenario import FOLDER, load_scenario, shipped

    lines, document = [f"read:    {FOLDER}"], []
    for found in map(load_scenario, shipped()):
        limits = list(map(str, found.limits))
        lines += [
            f"{found.name} ({found.rig.name}, {found.duration:.1f} s): {found.title}",
            f"    {', '.join(limits) or '-'}",
        ]
        said = {"name": found.name, "title": found.title, "about": found.about, "rig": found.rig.name}
        document.append(said | {"seconds": found.duration, "limits": limits, "file": str(found.path)})
    told = f"{len(document)} scenarios; run them with clutch-hil simulate NAME or clutch-hil up NAME"
    report(document, "\n".join(lines), told, True, json_output)
